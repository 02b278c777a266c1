"""The subcommand ``replay``, which simulates one encounter and writes its states over time."""

import argparse
from pathlib import Path

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.commands import (
    COMMANDS,
    add_scenario,
    add_seed,
    csv_file,
    refuse_options,
    require_seed,
)
from accelerated_evaluation.scenarios import SCENARIOS
from accelerated_evaluation.scenarios.protocol import Scenario
from accelerated_evaluation.vehicles.lead_motion import lead_speeds_of
from accelerated_evaluation.vehicles.replay import trace_encounter, write_trace

VALUES = "\n".join(f"  {name:<12}{' '.join(each.names)}" for name, each in SCENARIOS.items())
DESCRIPTION = f"""\
Simulate one encounter with a built-in vehicle, and write its states over time to OUT.csv.

variables of an encounter by scenario, in this order:
{VALUES}

columns of a cut-in:
  time_s, lead_position_m (its rear), host_position_m (its front, 0 at the start), lateral_distance_m,
  lead_speed_m_per_s, host_speed_m_per_s, host_acceleration_m_per_s2 (of the step before), range_m,
  time_to_collision_s (inf if the host does not close in),
  emergency (1 while the AEB is on, or while a reference driver sees danger)

columns of a left turn and of a pedestrian:
  time_s, ahead_m and aside_m (position of the target relative to the host, along its path and across it),
  host_speed_m_per_s, host_acceleration_m_per_s2 (until the next row), emergency (1 while the AEB is on)

The states agree with the outcomes that the command simulate computes for the same encounter.

example: a lead vehicle at 20 m/s cuts in 15 m ahead of a host that is 6 m/s faster
  accelerated-evaluation replay 20 15 6 states.csv --figure states.svg"""


@COMMANDS.add("replay")
class Replay:
    """Write the states of both cars over time in one encounter."""

    help = "write the states over time in one encounter"
    description = DESCRIPTION

    @staticmethod
    def add_arguments(command: argparse.ArgumentParser) -> None:
        """Add the encounter, the files to write and the vehicle to the parser."""
        command.add_argument(
            "values",
            metavar="VALUE",
            type=float,
            nargs="+",
            help="variables of the encounter, in the units of the scenario",
        )
        command.add_argument("target", metavar="OUT.csv", type=csv_file, help="table of the states to write")
        command.add_argument(
            "--figure", metavar="FILE", type=Path, help="figure to write: .png, .pdf or .svg"
        )
        command.add_argument(
            "--motion",
            metavar="MOTION",
            help="lead speed over time in a cut-in: ngsim, drawn with the statistics of NGSIM; a CSV table "
            "with the columns time_s, from 0 to 8, and lead_speed_m_per_s; or a Parquet table of recorded "
            "cut-ins with lead speeds over time, of which a similar one is drawn (default: constant)",
        )
        add_seed(command)
        add_scenario(command)

    @staticmethod
    def run(arguments: argparse.Namespace) -> None:
        """Simulate the encounter, and write the states over time as a table and, on demand, a figure."""
        scenario, encounter = SCENARIOS[arguments.scenario], arguments.values
        if len(encounter) != scenario.dimension:
            raise InputError(
                "the encounter",
                seen=f"{len(encounter)} values",
                expected=f"{scenario.dimension}, the values of {', '.join(scenario.names)}",
                change="Give the values in this order, and then the table to write.",
            )
        vehicle = arguments.vehicle or scenario.default_vehicle
        speeds = None if arguments.motion is None else _lead_speeds(arguments, scenario)
        trace = trace_encounter(vehicle, *encounter, scenario=scenario, lead_speeds=speeds)
        numbers = ", ".join(
            f"{each.in_title} {value:g} {each.unit}"
            for each, value in zip(scenario.variables, encounter, strict=True)
        )
        write_trace(trace, arguments.target, arguments.figure, f"{vehicle}: {numbers}", scenario.panels)


def _lead_speeds(arguments: argparse.Namespace, scenario: Scenario) -> Array:
    """Return the lead speeds over time [m/s] that the option ``--motion`` specifies."""
    if "lead_speed" not in scenario.names:
        refuse_options(arguments, scenario.name, "motion")
    require_seed(arguments.seed)
    encounter = scenario.checked(*([value] for value in arguments.values))[:, 0]
    return lead_speeds_of(arguments.motion, encounter, child_generator(arguments.seed, "replay"))
