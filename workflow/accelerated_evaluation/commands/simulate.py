"""The subcommand ``simulate``, which simulates the encounters of a table."""

import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import yaml

from accelerated_evaluation.base import strict_yaml
from accelerated_evaluation.base.arguments import Argument, if_it
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.options import argument, option, positive_integer, read_from, switch
from accelerated_evaluation.base.tables import column_of_numbers, read_csv, require_file
from accelerated_evaluation.commands import COMMANDS
from accelerated_evaluation.commands.shared import OfVehicle
from accelerated_evaluation.laws.motion import course_columns
from accelerated_evaluation.scenarios import SCENARIOS
from accelerated_evaluation.scenarios.outcomes import ENDED
from accelerated_evaluation.scenarios.protocol import Scenario
from accelerated_evaluation.vehicles.external.checked import CheckedVehicle, ForeignVehicle
from accelerated_evaluation.vehicles.external.slow import SlowVehicle
from accelerated_evaluation.vehicles.external.watched import run_apart
from accelerated_evaluation.vehicles.external.workers import PROCESSES
from accelerated_evaluation.vehicles.loading import section_of
from accelerated_evaluation.vehicles.moving import require_motion, speeds_in
from accelerated_evaluation.vehicles.named import NamedVehicle
from accelerated_evaluation.vehicles.protocol import Vehicle

INTRODUCTION = "Simulate the encounters in the rows of IN.csv, and write the table with their outcomes."
RULES = """\
If the lead vehicle of a cut-in changes its speed, further columns contain the lead speed [m/s] 0.1, 0.2, ...
s after the start: speed_0.1, speed_0.2, ..., up to speed_8.0. Speeds in between are interpolated.

The outcomes of a command or an FMU are stored in results/vehicles. An encounter that is in the store is not
simulated again, unless --again is given.

The added columns are at the end, and replace columns of the same name. All other columns are copied
unchanged. Simulations that were stopped at their time limit have 0 in the column ended, and a warning gives
their number.

example:
  accelerated-evaluation simulate cut_ins.csv outcomes.csv --vehicle my_vehicle.py:MyVehicle"""
SLOW = (
    "commands, FMUs and other slow vehicles",
    "Outcomes are stored in results/vehicles, so that no encounter is simulated twice.",
)
POSITIVE = read_from(Argument("a positive number", if_it(lambda value: 0 < value < math.inf)))


def _description() -> str:
    """Return the description of the command, with the columns of every scenario."""
    parts = [INTRODUCTION]
    for scenario in SCENARIOS.values():
        width = max(map(len, (*scenario.names, *scenario.outcome_names))) + 2
        lines = [f"columns read for the scenario {scenario.name} ({scenario.description}):"]
        lines += [
            f"  {each.name:<{width}}{each.description} [{each.in_words}]" for each in scenario.variables
        ]
        lines += ["columns added:"]
        lines += [f"  {each.name:<{width}}{each.description} [{each.unit}]" for each in scenario.outcomes]
        parts.append("\n".join(lines))
    return "\n\n".join([*parts, RULES])


@COMMANDS.add("simulate")
@dataclass(frozen=True)
class Simulate(OfVehicle, description=_description()):
    """Simulate the encounters of a table."""

    source: Path = argument("IN.csv", "table of encounters, with a header")
    target: Path = argument("OUT.csv", "table to write, when all rows are simulated")
    parameter: Sequence[str] = option(
        "NAME=VALUE",
        "parameter of the vehicle, with its value as in YAML, such as headway=1.5; may be repeated",
        (),
    )
    closing_speed_max: float | None = option(
        "SPEED",
        "for cut-ins, cap on the closing speed [m/s]: larger closing speeds are replaced by it; the study "
        "uses 23.49 (default: no cap)",
        type=POSITIVE,
    )
    again: bool = switch(
        "simulate all rows, also those in the store; the outcomes are not stored", group=SLOW
    )
    keep: bool = switch("store the outcomes of a Python class, too", group=SLOW)
    batch_size: int = option(
        "N",
        "largest number of encounters for which a program is started once (default: %(default)s)",
        100,
        type=positive_integer,
        group=SLOW,
    )
    time_limit: float = option(
        "SECONDS", "longest time for a batch [s] (default: %(default)g)", 600.0, type=POSITIVE, group=SLOW
    )
    workers: int = option(
        "N",
        "number of batches that run at the same time (default: %(default)s)",
        1,
        type=positive_integer,
        group=SLOW,
    )

    def start(self) -> None:
        """Simulate the encounters of the table, and write the table with their outcomes."""
        parameters = _parameters(self.parameter)
        scenario = SCENARIOS[self.scenario]
        name = self.vehicle or scenario.default_vehicle
        caps = {} if self.closing_speed_max is None else {"closing_speed": self.closing_speed_max}
        if not {*caps} <= {*scenario.names}:
            change = "Leave the option out, because it limits the closing speeds of cut-ins."
            raise InputError(
                "--closing-speed-max",
                seen=f"the scenario {scenario.name}",
                expected="one with a closing speed",
                change=change,
            )

        settings = {
            "keep_class": self.keep,
            "batch_size": self.batch_size,
            "time_limit": self.time_limit,
            "workers": self.workers,
            "executor": PROCESSES,
            "options": {},
        }
        named = NamedVehicle.of(section_of(name, {"parameters": parameters}), settings, scenario)
        is_stored = not self.again and (":" not in name or self.keep)

        def simulate() -> None:
            if not is_stored:
                vehicle = named.load()
                if isinstance(vehicle, CheckedVehicle):
                    vehicle.was_repeated = True  # a row is one run
                    if isinstance(vehicle.vehicle, ForeignVehicle):
                        vehicle.vehicle.time_limit = self.time_limit
                simulate_table(self.source, self.target, vehicle, scenario, caps)
                return
            with named.loaded(is_tested=False) as vehicle:
                simulate_table(self.source, self.target, vehicle, scenario, caps)
                if isinstance(vehicle, SlowVehicle):
                    print(
                        f"{vehicle.simulated:,} encounters simulated, {vehicle.found:,} taken from "
                        f"{vehicle.store.path}"
                    )

        if not is_stored and (":" in name or name == "fmu"):
            run_apart(simulate, f"vehicle {name}")
        else:
            simulate()


def _parameters(texts: Iterable[str]) -> dict[str, Any]:
    """Return the parameters of the vehicle from texts NAME=VALUE."""
    parameters = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if name in parameters:
            raise InputError(
                "--parameter", seen=f"{name} twice", expected="each parameter once", change="Leave one out."
            )
        if not (name and equals):
            change = "Write, for example, --parameter headway=1.5."
            raise InputError("--parameter", seen=repr(text), expected="NAME=VALUE", change=change)
        try:
            parameters[name] = strict_yaml.load(value)
        except yaml.YAMLError as error:
            raise InputError(
                f"--parameter {name}",
                seen=repr(value),
                expected="a value as in YAML",
                change="Put a text with special characters in quotes. Write numbers without leading 0 and _.",
            ) from error
    return parameters


def simulate_table(
    source: Path,
    target: Path,
    vehicle: Vehicle,
    scenario: Scenario,
    caps: Mapping[str, float] = MappingProxyType({}),
) -> None:
    """Simulate the encounters of a CSV file, and write them with their outcomes to another CSV file.

    Both files have a header; the source may be compressed (.gz). Values above ``caps`` are simulated with
    these, but the table keeps the original values. InputError names file, row and column.
    """
    if target.suffix != ".csv":
        change = "Write an uncompressed CSV table, and convert it afterwards."
        raise InputError("OUT.csv", seen=str(target), expected="a name that ends in .csv", change=change)
    require_file(source, "Correct its path.")
    table = read_csv(source, {name: name for name in scenario.names}, whole=True)
    where, rows = str(source), range(2, len(table) + 2)
    courses = course_columns(table.columns, where) if "lead_speed" in scenario.names else []
    if courses:
        require_motion(vehicle, getattr(vehicle, "name", type(vehicle).__name__))
    numbers = {
        name: column_of_numbers(table[name], lambda row: f"{where}, row {rows[row]}", "Correct this row.")
        for name in dict.fromkeys((*scenario.names, *courses))
    }
    encounters = scenario.checked(*(numbers[name] for name in scenario.names), source=where, rows=rows)
    capped = np.minimum(encounters, [[caps.get(name, math.inf)] for name in scenario.names])
    if courses:
        speeds = speeds_in({name: numbers[name].tolist() for name in courses}, rows, where)
        outcomes = vehicle.simulate_moving(*capped, speeds)
    else:
        outcomes = vehicle.simulate(*capped)
    kept = table.drop(columns=[*scenario.outcome_names], errors="ignore")
    flags = {each.name for each in scenario.outcomes if each.is_flag}
    added = {name: values.astype(int) if name in flags else values for name, values in vars(outcomes).items()}
    write_csv(target, kept.assign(**added))
    if not_ended := np.count_nonzero(~getattr(outcomes, ENDED, np.array([], bool))):
        runs = "1 run" if not_ended == 1 else f"{not_ended:,} runs"
        print(f"warning: {runs} did not end; see the column {ENDED} of {target}", file=sys.stderr)
