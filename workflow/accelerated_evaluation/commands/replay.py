"""The subcommand ``replay``."""

import argparse
from pathlib import Path

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.commands import COMMANDS, add_scenario
from accelerated_evaluation.scenarios import SCENARIOS
from accelerated_evaluation.vehicles.replay import trace_encounter, write_trace

VALUES = "\n".join(f"  {name:<12}{' '.join(each.names)}" for name, each in SCENARIOS.items())
DESCRIPTION = f"""\
Simulate one encounter with a built-in vehicle, and write its states, one a row, to OUT.csv.

values of an encounter by scenario, in this order:
{VALUES}

columns of a cut-in:
  time_s, lead_position_m (its rear), host_position_m (its front, 0 at the start), lateral_distance_m,
  lead_speed_m_per_s, host_speed_m_per_s, host_acceleration_m_per_s2 (of the step before), range_m,
  time_to_collision_s (inf if the host does not close in),
  emergency (1 while the AEB is on, or while a reference driver sees danger)

columns of a left turn and of a pedestrian:
  time_s, ahead_m and aside_m (position of the target relative to the host, along its path and across it),
  host_speed_m_per_s, host_acceleration_m_per_s2 (until the next row), emergency (1 while the AEB is on)

The trace ends in the outcomes that the command simulate gives for the same encounter."""


@COMMANDS.add("replay")
class Replay:
    """Show what happens in one encounter."""

    help = "show what happens in one encounter"
    description = DESCRIPTION

    @staticmethod
    def add_arguments(command: argparse.ArgumentParser) -> None:
        """Add the encounter, the files to write and the vehicle."""
        command.add_argument(
            "values",
            metavar="VALUE",
            type=float,
            nargs="+",
            help="variables of the encounter, in the units of the scenario",
        )
        command.add_argument("target", metavar="OUT.csv", type=Path, help="table of the states to write")
        command.add_argument(
            "--figure", metavar="FILE", type=Path, help="figure to write: .png, .pdf or .svg"
        )
        add_scenario(command)

    @staticmethod
    def run(arguments: argparse.Namespace) -> None:
        """Simulate the encounter and write its trace."""
        scenario, encounter = SCENARIOS[arguments.scenario], arguments.values
        if len(encounter) != scenario.dimension:
            raise InputError(
                "the encounter",
                seen=f"{len(encounter)} values",
                expected=f"{scenario.dimension}, those of {', '.join(scenario.names)}",
                change="Write them in this order, and then the table to write.",
            )
        vehicle = arguments.vehicle or scenario.default_vehicle
        trace = trace_encounter(vehicle, *encounter, scenario=scenario)
        numbers = ", ".join(
            f"{each.in_title} {value:g} {each.unit}"
            for each, value in zip(scenario.variables, encounter, strict=True)
        )
        write_trace(trace, arguments.target, arguments.figure, f"{vehicle}: {numbers}", scenario.panels)
