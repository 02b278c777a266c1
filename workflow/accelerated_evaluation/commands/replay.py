"""The subcommand ``replay``."""

import argparse
from pathlib import Path

from accelerated_evaluation.commands import COMMANDS
from accelerated_evaluation.vehicles.registry import VEHICLES
from accelerated_evaluation.vehicles.replay import trace_encounter, write_trace

DESCRIPTION = """\
Simulate one cut-in with a built-in vehicle, and write its states, one a row, to OUT.csv.

columns:
  time_s, lead_position_m (its rear), host_position_m (its front, 0 at the start), lateral_distance_m,
  lead_speed_m_per_s, host_speed_m_per_s, host_acceleration_m_per_s2 (of the step before), range_m,
  time_to_collision_s (inf if the host does not close in),
  emergency (1 while the AEB is on, or while a reference driver sees danger)

The trace ends in the outcomes that the command simulate gives for the same cut-in."""


@COMMANDS.add("replay")
class Replay:
    """Show what happens in one cut-in."""

    help = "show what happens in one cut-in"
    description = DESCRIPTION

    @staticmethod
    def add_arguments(command: argparse.ArgumentParser) -> None:
        """Add the cut-in, the files to write and the vehicle."""
        for name, meaning in (
            ("lead_speed", "speed of the lead vehicle, constant [m/s]"),
            ("range", "distance to it at the start [m]"),
            ("closing_speed", "host speed minus lead speed at the start [m/s]"),
        ):
            command.add_argument(name, type=float, help=meaning)
        command.add_argument("target", metavar="OUT.csv", type=Path, help="table of the states to write")
        command.add_argument(
            "--figure", metavar="FILE", type=Path, help="figure to write: .png, .pdf or .svg"
        )
        command.add_argument(
            "--vehicle",
            metavar="NAME",
            default="acc_aeb",
            help=f"{', '.join(VEHICLES)} (default: %(default)s)",
        )

    @staticmethod
    def run(arguments: argparse.Namespace) -> None:
        """Simulate the cut-in and write its trace."""
        encounter = arguments.lead_speed, arguments.range, arguments.closing_speed
        trace = trace_encounter(arguments.vehicle, *encounter)
        numbers = "lead speed {:g} m/s, range {:g} m, closing speed {:g} m/s".format(*encounter)
        write_trace(trace, arguments.target, arguments.figure, f"{arguments.vehicle}: {numbers}")
