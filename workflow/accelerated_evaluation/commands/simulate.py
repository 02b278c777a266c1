"""The subcommand ``simulate``, which simulates the encounters of a table."""

import argparse
import csv
import gzip
import math
import os
import sys
import zlib
from collections.abc import Iterable, Iterator, Mapping
from itertools import islice
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, TextIO

import numpy as np
import yaml
from tqdm import tqdm

from accelerated_evaluation.base import strict_yaml
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import atomic_path
from accelerated_evaluation.commands import COMMANDS, add_scenario, number_option, positive_integer
from accelerated_evaluation.laws.motion import course_columns
from accelerated_evaluation.scenarios import SCENARIOS
from accelerated_evaluation.scenarios.cut_in import CUT_IN
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

CHUNK = 100_000  # number of rows in memory at a time
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
POSITIVE = number_option("a positive number", lambda value: 0 < value < math.inf)


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


class Row(NamedTuple):
    """One record of a CSV file, with the number of its last line."""

    number: int
    fields: list[str]


@COMMANDS.add("simulate")
class Simulate:
    """Simulate the encounters of a table."""

    help = "simulate the encounters of a table"
    description = _description()

    @staticmethod
    def add_arguments(command: argparse.ArgumentParser) -> None:
        """Add the tables, the scenario, the vehicle and the cap on closing speeds to the parser."""
        command.add_argument("source", metavar="IN.csv", type=Path, help="table of encounters, with a header")
        command.add_argument(
            "target", metavar="OUT.csv", type=Path, help="table to write, when all rows are simulated"
        )
        add_scenario(command)
        command.add_argument(
            "--parameter",
            metavar="NAME=VALUE",
            action="append",
            default=[],
            help="parameter of the vehicle, with its value as in YAML, such as headway=1.5; may be repeated",
        )
        command.add_argument(
            "--closing-speed-max",
            metavar="SPEED",
            type=POSITIVE,
            help="for cut-ins, cap on the closing speed [m/s]: larger closing speeds are replaced by it; the "
            "study uses 23.49 (default: no cap)",
        )
        slow = command.add_argument_group(
            "commands, FMUs and other slow vehicles",
            "Outcomes are stored in results/vehicles, so that no encounter is simulated twice.",
        )
        slow.add_argument(
            "--again",
            action="store_true",
            help="simulate all rows, also those in the store; the outcomes are not stored",
        )
        slow.add_argument("--keep", action="store_true", help="store the outcomes of a Python class, too")
        slow.add_argument(
            "--batch-size",
            metavar="N",
            type=positive_integer,
            default=100,
            help="largest number of encounters for which a program is started once (default: %(default)s)",
        )
        slow.add_argument(
            "--time-limit",
            metavar="SECONDS",
            type=POSITIVE,
            default=600.0,
            help="longest time for a batch (default: %(default)g)",
        )
        slow.add_argument(
            "--workers",
            metavar="N",
            type=positive_integer,
            default=1,
            help="number of batches that run at the same time (default: %(default)s)",
        )

    @staticmethod
    def run(arguments: argparse.Namespace) -> None:
        """Simulate the encounters of the table, and write the table with their outcomes."""
        parameters = _parameters(arguments.parameter)
        scenario = SCENARIOS[arguments.scenario]
        name = arguments.vehicle or scenario.default_vehicle
        caps = {} if arguments.closing_speed_max is None else {"closing_speed": arguments.closing_speed_max}
        if not {*caps} <= {*scenario.names}:
            change = "Leave the option out, because it limits the closing speeds of cut-ins."
            raise InputError(
                "--closing-speed-max",
                seen=f"the scenario {scenario.name}",
                expected="one with a closing speed",
                change=change,
            )

        settings = {
            "keep_class": arguments.keep,
            "batch_size": arguments.batch_size,
            "time_limit": arguments.time_limit,
            "workers": arguments.workers,
            "executor": PROCESSES,
            "options": {},
        }
        named = NamedVehicle.of(section_of(name, {"parameters": parameters}), settings, scenario)
        is_stored = not arguments.again and (":" not in name or arguments.keep)

        def simulate() -> None:
            if not is_stored:
                vehicle = named.load()
                if isinstance(vehicle, CheckedVehicle):
                    vehicle.was_repeated = True  # a row is one run
                    if isinstance(vehicle.vehicle, ForeignVehicle):
                        vehicle.vehicle.time_limit = arguments.time_limit
                simulate_table(arguments.source, arguments.target, vehicle, scenario, caps)
                return
            with named.loaded(is_tested=False) as vehicle:
                simulate_table(arguments.source, arguments.target, vehicle, scenario, caps)
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
    scenario: Scenario = CUT_IN,
    caps: Mapping[str, float] = MappingProxyType({}),
) -> None:
    """Simulate the encounters of a CSV file, and write them with their outcomes to another CSV file.

    The files are processed in chunks of `CHUNK` rows. Both files have a header; the source may be compressed
    (.gz). Values above ``caps`` are simulated with these, but the table keeps the original values. InputError
    names file, row and column.
    """
    if target.suffix != ".csv":
        change = "Write an uncompressed CSV table, and convert it afterwards."
        raise InputError("OUT.csv", seen=str(target), expected="a name that ends in .csv", change=change)
    with _opened(source) as file:
        rows = _rows(file, source)
        header = [name.strip() for name in next(rows, Row(0, [])).fields]
        inputs = [_position(header, name, source, scenario) for name in scenario.names]
        carried = [column for column, name in enumerate(header) if name not in scenario.outcome_names]
        courses = _courses(header, scenario, source)
        if courses:
            require_motion(vehicle, getattr(vehicle, "name", type(vehicle).__name__))
        highest = np.array([[caps.get(name, math.inf)] for name in scenario.names])
        not_ended = 0
        with atomic_path(target) as temporary, temporary.open("w", encoding="utf-8", newline="") as out:
            writer = csv.writer(out, lineterminator="\n")
            writer.writerow([header[column] for column in carried] + list(scenario.outcome_names))
            while chunk := list(islice(rows, CHUNK)):
                columns = [_numbers(chunk, column, header, source) for column in inputs]
                numbers = [row.number for row in chunk]
                encounters = scenario.checked(*columns, source=str(source), rows=numbers)
                capped = np.minimum(encounters, highest)
                if courses:
                    speeds = {header[k]: _numbers(chunk, k, header, source) for k in courses}
                    outcomes = vehicle.simulate_moving(*capped, speeds_in(speeds, numbers, str(source)))
                else:
                    outcomes = vehicle.simulate(*capped)
                not_ended += np.count_nonzero(~getattr(outcomes, ENDED, np.array([], bool)))
                kept = ([row.fields[column] for column in carried] for row in chunk)
                added = _records(outcomes, scenario)
                writer.writerows(old + list(new) for old, new in zip(kept, added, strict=True))
    if not_ended:
        runs = "1 run" if not_ended == 1 else f"{not_ended:,} runs"
        print(f"warning: {runs} did not end; see the column {ENDED} of {target}", file=sys.stderr)


def _courses(header: list[str], scenario: Scenario, source: Path) -> list[int]:
    """Return the places of the columns with lead speeds over time; an empty list if there are none."""
    if "lead_speed" not in scenario.names:
        return []
    return [header.index(name) for name in course_columns(header, str(source))]


def _opened(source: Path) -> TextIO:
    opened = gzip.open if source.suffix == ".gz" else open
    try:
        return opened(source, "rt", encoding="utf-8-sig", newline="")
    except OSError as error:
        seen = "a folder" if source.is_dir() else (error.strerror or str(error)).lower()
        raise InputError(str(source), seen=seen, expected="a CSV file", change="Correct its path.") from error


def _rows(file: TextIO, source: Path) -> Iterator[Row]:
    """Yield the records of a CSV file, the header first, without blank lines."""
    reader = csv.reader(_with_progress(file))
    width = None
    try:
        for fields in reader:
            if not fields:
                continue
            width = width or len(fields)
            if len(fields) != width:
                raise InputError(
                    f"{source}, row {reader.line_num}",
                    seen=f"{len(fields)} fields",
                    expected=f"{width}, as in the header",
                    change="Correct this row.",
                )
            yield Row(reader.line_num, fields)
    except (csv.Error, UnicodeDecodeError, gzip.BadGzipFile, EOFError, zlib.error) as error:
        where = f"{source}, row {reader.line_num + 1}"
        raise InputError(
            where,
            seen=str(error),
            expected="CSV text in UTF-8, or a complete .gz file of it",
            change="Export it again.",
        ) from error


def _with_progress(file: TextIO) -> Iterator[str]:
    """Yield the lines of a file, and show a progress bar on a terminal after one second."""
    size = os.fstat(file.fileno()).st_size or None
    size = None if isinstance(getattr(file, "buffer", None), gzip.GzipFile) else size
    with tqdm(desc="simulate", total=size, unit="B", unit_scale=True, delay=1, disable=None) as progress:
        for line in file:
            progress.update(len(line))
            yield line


def _position(header: list[str], name: str, source: Path, scenario: Scenario) -> int:
    """Return the index of the column ``name`` in the header; raise InputError unless it is there once."""
    if header.count(name) != 1:
        from accelerated_evaluation.base.tables import header_fault, names_in_words

        if fault := header_fault(header):
            raise InputError(
                f"{source}, row 1",
                seen=fault,
                expected=f"a comma-separated header with {', '.join(scenario.names)}",
                change="Export the table with commas, points as decimal marks, and a header.",
            )
        times = "more than one" if name in header else "no"
        raise InputError(
            f"{source}, row 1",
            seen=f"{times} column {name} among: {names_in_words(header, name) if header else 'none'}",
            expected=f"a header with {', '.join(scenario.names)}",
            change="Correct the header.",
        )
    return header.index(name)


def _numbers(chunk: list[Row], column: int, header: list[str], source: Path) -> list[float]:
    """Return one column of some rows as numbers; raise InputError for a cell that is not a number."""
    numbers = []
    for row in chunk:
        try:
            if "_" in row.fields[column]:  # Python would interpret 1_0 as 10
                raise ValueError
            numbers.append(float(row.fields[column]))
        except ValueError as error:
            from accelerated_evaluation.base.tables import number_fault

            raise InputError(
                f"{source}, row {row.number}, column {header[column]}",
                seen=repr(row.fields[column]),
                expected="a number",
                change=f"{number_fault(row.fields[column])}Correct or remove this row.",
            ) from error
    return numbers


def _records(outcomes: Any, scenario: Scenario) -> Iterator[tuple[float, ...]]:  # noqa: ANN401
    """Return an iterator over the outcomes of the encounters, with flags as 0 or 1."""
    pairs = ((getattr(outcomes, each.name), each.is_flag) for each in scenario.outcomes)
    columns = (values.astype(int) if is_flag else values for values, is_flag in pairs)
    return zip(*(column.tolist() for column in columns), strict=True)
