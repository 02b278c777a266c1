"""The subcommand ``simulate``."""

import argparse
import csv
import math
import os
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple, TextIO

import numpy as np
import yaml
from tqdm import tqdm

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import atomic_path
from accelerated_evaluation.commands import COMMANDS
from accelerated_evaluation.vehicles.checks import INPUTS, OUTCOMES, checked_encounters
from accelerated_evaluation.vehicles.external.apart import run_apart
from accelerated_evaluation.vehicles.loading import load_vehicle
from accelerated_evaluation.vehicles.protocol import Outcomes, Vehicle
from accelerated_evaluation.vehicles.registry import VEHICLES

CHUNK = 100_000  # rows in memory at a time
DESCRIPTION = """\
Simulate cut-ins, one a row of IN.csv, and write the table with their outcomes.

columns read:
  lead_speed      speed of the lead vehicle, constant [m/s], 0 or more
  range           distance to it at the start [m], above 0
  closing_speed   host speed minus lead speed at the start [m/s]

columns added at the end (replacing any of the same name):
  crash           1 if the range reached 0, else 0
  min_range       smallest range [m]; 0 or less after a crash
  min_ttc         smallest time to collision [s]; inf if the host never closed in
  impact_speed    closing speed at the crash [m/s]; 0 without one

All other columns are carried through unchanged."""


class Row(NamedTuple):
    """One record of a CSV file, and the number of its last line."""

    number: int
    fields: list[str]


def _speed(text: str) -> float:
    speed = float(text)
    if not (math.isfinite(speed) and speed > 0):
        raise ValueError
    return speed


_speed.__name__ = "positive speed"  # argparse names the type in its message


@COMMANDS.add("simulate")
class Simulate:
    """Simulate the cut-ins of a table."""

    help = "simulate the cut-ins of a table"
    description = DESCRIPTION

    @staticmethod
    def add_arguments(command: argparse.ArgumentParser) -> None:
        """Add the files, the vehicle and its cap."""
        command.add_argument("source", metavar="IN.csv", type=Path, help="table of cut-ins, with a header")
        command.add_argument(
            "target", metavar="OUT.csv", type=Path, help="table to write, whole or not at all"
        )
        command.add_argument(
            "--vehicle",
            metavar="NAME",
            default="acc_aeb",
            help=f"{', '.join(VEHICLES)}, or path/to/file.py:ClassName for your own (default: %(default)s)",
        )
        command.add_argument(
            "--parameter",
            metavar="NAME=VALUE",
            action="append",
            default=[],
            help="parameter of the vehicle, its value as in YAML, such as headway=1.5; for each another one",
        )
        command.add_argument(
            "--closing-speed-max",
            metavar="SPEED",
            type=_speed,
            help="simulate larger closing speeds as this one [m/s]; the study uses 23.49 (default: no limit)",
        )

    @staticmethod
    def run(arguments: argparse.Namespace) -> None:
        """Simulate the table."""
        parameters = _parameters(arguments.parameter)
        limit = math.inf if arguments.closing_speed_max is None else arguments.closing_speed_max

        def simulate() -> None:
            vehicle = load_vehicle(arguments.vehicle, **parameters)
            simulate_table(arguments.source, arguments.target, vehicle, closing_speed_max=limit)

        if ":" in arguments.vehicle or arguments.vehicle == "fmu":
            run_apart(simulate, f"vehicle {arguments.vehicle}")
        else:
            simulate()


def _parameters(texts: Iterable[str]) -> dict[str, Any]:
    """Return the vehicle's parameters of the command line."""
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
            parameters[name] = yaml.safe_load(value)
        except yaml.YAMLError as error:
            raise InputError(
                f"--parameter {name}",
                seen=repr(value),
                expected="a value as in YAML",
                change="Put a text with special characters in quotes.",
            ) from error
    return parameters


def simulate_table(
    source: Path, target: Path, vehicle: Vehicle, *, closing_speed_max: float = math.inf
) -> None:
    """Simulate the cut-ins of a CSV file, and write them with their outcomes to another one.

    The files are processed in chunks.

    Parameters
    ----------
    source
        CSV file with a header and the columns lead_speed [m/s], range [m] and closing_speed [m/s].
    target
        CSV file to write; the columns crash (0 or 1), min_range [m], min_ttc [s] and impact_speed [m/s] are
        added.
    vehicle
        The car under test.
    closing_speed_max
        Larger closing speeds are simulated as this one [m/s]; the table keeps the original values.

    Raises
    ------
    InputError
        If a column is missing or a value cannot be simulated. The message names file, row and column.
    """
    with _opened(source) as file:
        rows = _rows(file, source)
        header = [name.strip() for name in next(rows, Row(0, [])).fields]
        inputs = [_position(header, name, source) for name in INPUTS]
        carried = [column for column, name in enumerate(header) if name not in OUTCOMES]
        with atomic_path(target) as temporary, temporary.open("w", encoding="utf-8", newline="") as out:
            writer = csv.writer(out, lineterminator="\n")
            writer.writerow([header[column] for column in carried] + list(OUTCOMES))
            while chunk := list(islice(rows, CHUNK)):
                columns = [_numbers(chunk, column, header, source) for column in inputs]
                numbers = [row.number for row in chunk]
                lead_speed, range_, closing_speed = checked_encounters(
                    *columns, source=str(source), rows=numbers
                )
                outcomes = vehicle.simulate(lead_speed, range_, np.minimum(closing_speed, closing_speed_max))
                kept = ([row.fields[column] for column in carried] for row in chunk)
                writer.writerows(old + list(new) for old, new in zip(kept, _records(outcomes), strict=True))


def _opened(source: Path) -> TextIO:
    try:
        return source.open(encoding="utf-8-sig", newline="")
    except OSError as error:
        seen = (error.strerror or str(error)).lower()
        raise InputError(str(source), seen=seen, expected="a CSV file", change="Correct its path.") from error


def _rows(file: TextIO, source: Path) -> Iterator[Row]:
    """Yield the records of a CSV file, the header first, blank lines left out."""
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
    except (csv.Error, UnicodeDecodeError) as error:
        where = f"{source}, row {reader.line_num + 1}"
        raise InputError(
            where, seen=str(error), expected="CSV text in UTF-8", change="Export it again."
        ) from error


def _with_progress(file: TextIO) -> Iterator[str]:
    """Yield the lines of a file; a bar on a terminal shows how much is read, from one second on."""
    size = os.fstat(file.fileno()).st_size or None
    with tqdm(desc="simulate", total=size, unit="B", unit_scale=True, delay=1, disable=None) as progress:
        for line in file:
            progress.update(len(line))
            yield line


def _position(header: list[str], name: str, source: Path) -> int:
    """Return where the header has the column ``name``, which must be there once."""
    if header.count(name) != 1:
        from accelerated_evaluation.base.tables import listed

        times = "more than one" if name in header else "no"
        raise InputError(
            f"{source}, row 1",
            seen=f"{times} column {name} among: {listed(header, name) if header else 'none'}",
            expected=f"a header with {', '.join(INPUTS)}",
            change="Correct the header.",
        )
    return header.index(name)


def _numbers(chunk: list[Row], column: int, header: list[str], source: Path) -> list[float]:
    """Return one column of ``chunk`` as numbers."""
    numbers = []
    for row in chunk:
        try:
            if "_" in row.fields[column]:  # Python would take 1_0 for 10
                raise ValueError
            numbers.append(float(row.fields[column]))
        except ValueError as error:
            raise InputError(
                f"{source}, row {row.number}, column {header[column]}",
                seen=repr(row.fields[column]),
                expected="a number",
                change="Correct or remove this row.",
            ) from error
    return numbers


def _records(outcomes: Outcomes) -> Iterator[tuple[int, float, float, float]]:
    """Iterate over the encounters' outcomes, in the order of OUTCOMES."""
    crash = outcomes.crash.astype(int)
    columns = (crash, outcomes.min_range, outcomes.min_ttc, outcomes.impact_speed)
    return zip(*(column.tolist() for column in columns), strict=True)
