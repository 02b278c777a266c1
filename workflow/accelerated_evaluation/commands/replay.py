"""The subcommand ``replay``, which simulates one encounter and writes its states over time."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.options import argument, csv_file, option
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.commands import COMMANDS
from accelerated_evaluation.commands.shared import OfVehicle, Seeded, refuse_options
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
@dataclass(frozen=True)
class Replay(OfVehicle, Seeded, description=DESCRIPTION):
    """Write the states over time in one encounter."""

    values: Sequence[float] = argument(
        "VALUE", "variables of the encounter, in the units of the scenario", nargs="+"
    )
    target: Path = argument("OUT.csv", "table of the states to write", type=csv_file)
    figure: Path | None = option("FILE", "figure to write: .png, .pdf or .svg")
    motion: str | None = option(
        "MOTION",
        "lead speed over time in a cut-in: ngsim, drawn with the statistics of NGSIM; a CSV table with the "
        "columns time_s, from 0 to 8, and lead_speed_m_per_s; or a Parquet table of recorded cut-ins with "
        "lead speeds over time, of which a similar one is drawn (default: constant)",
    )

    def start(self) -> None:
        """Simulate the encounter, and write the states over time as a table and, on demand, a figure."""
        scenario, encounter = SCENARIOS[self.scenario], self.values
        if len(encounter) != scenario.dimension:
            raise InputError(
                "the encounter",
                seen=f"{len(encounter)} values",
                expected=f"{scenario.dimension}, the values of {', '.join(scenario.names)}",
                change="Give the values in this order, and then the table to write.",
            )
        vehicle = self.vehicle or scenario.default_vehicle
        speeds = None if self.motion is None else _lead_speeds(self, scenario)
        trace = trace_encounter(vehicle, *encounter, scenario=scenario, lead_speeds=speeds)
        numbers = ", ".join(
            f"{each.in_title} {value:g} {each.unit}"
            for each, value in zip(scenario.variables, encounter, strict=True)
        )
        write_trace(trace, self.target, self.figure, f"{vehicle}: {numbers}", scenario.panels)


def _lead_speeds(arguments: Replay, scenario: Scenario) -> Array:
    """Return the lead speeds over time [m/s] that the option ``--motion`` specifies."""
    if "lead_speed" not in scenario.names:
        refuse_options(arguments, scenario.name, "motion")
    encounter = scenario.checked(*([value] for value in arguments.values))[:, 0]
    return lead_speeds_of(arguments.motion, encounter, child_generator(arguments.seed, "replay"))
