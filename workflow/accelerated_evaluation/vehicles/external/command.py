"""A vehicle that is a program in any language, which reads encounters and writes their outcomes."""

import atexit
import csv
import json
import math
import shlex
import signal
import subprocess
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.numerals import number_in
from accelerated_evaluation.laws.motion import SPEED_COLUMNS, STATES
from accelerated_evaluation.scenarios.outcomes import FLAG
from accelerated_evaluation.scenarios.parameters import check_parameters, parameter_error
from accelerated_evaluation.scenarios.protocol import Scenario
from accelerated_evaluation.vehicles.external.checked import ForeignVehicle
from accelerated_evaluation.vehicles.external.processes import Printed, ended, started
from accelerated_evaluation.vehicles.external.staying import Conversation
from accelerated_evaluation.vehicles.moving import checked_lead_speeds
from accelerated_evaluation.vehicles.protocol import VEHICLES

FLAGS = {"1": 1.0, "0": 0.0, "true": 1.0, "false": 0.0, "1.0": 1.0, "0.0": 0.0}


@VEHICLES.add("command")
@dataclass
class Command(ForeignVehicle):
    """A vehicle that is run as ``COMMAND IN.csv OUT.csv``, once for each batch.

    IN.csv has the columns of the scenario's variables; those of a cut-in are lead_speed [m/s], range [m] and
    closing_speed [m/s]. The command writes OUT.csv with the columns of the outcomes; those of a cut-in are
    crash (0 or 1), min_range [m], min_ttc [s] and impact_speed [m/s]. OUT.csv has one row for each row of
    IN.csv, in the same order. Further columns and the printed output are ignored.

    If the lead vehicle changes its speed, IN.csv also has the columns speed_0.1, speed_0.2, ..., speed_8.0,
    with the lead speed [m/s] 0.1, 0.2, ..., 8 s after the start. After 8 s the lead vehicle keeps its speed.

    A program that ``stays`` is started once in each worker, without additional arguments, and answers one
    encounter after the other in lines of JSON (`Conversation`, docs/staying_program.md). InputError is raised
    if a parameter has the wrong type, or the command has no words.
    """

    # Its words, or one text that is split into words as in a shell. No shell is used.
    command: str | Sequence[str]
    # Whether the command reads the columns of lead speeds. If not, it cannot simulate cut-ins in which the
    # lead vehicle changes its speed.
    lead_motion: bool = False
    stays: bool = False  # whether the program is started once, and answers in lines of JSON
    _program: Conversation | None = field(default=None, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        check_parameters(self)
        try:
            self.words = shlex.split(self.command) if isinstance(self.command, str) else list(self.command)
        except ValueError as error:
            raise parameter_error("command", self.command, f"words as in a shell ({error})") from error
        if not self.words or not self.words[0]:
            raise parameter_error("command", self.command, "a program and its arguments")

    @property
    def name(self) -> str:
        """The command as it is typed in a shell."""
        return shlex.join(self.words)

    @property
    def files(self) -> list[Path]:
        """The words of the command that are names of files."""
        return [Path(word) for word in self.words if Path(word).is_file()]

    def simulate(self, *columns: ArrayLike) -> Any:  # noqa: ANN401
        """Run the command on n encounters, given by the variables of the scenario, (n,) each.

        InputError is raised if the command cannot be started, takes too long, fails, is killed, or does not
        write valid outcomes.
        """
        return self._outcomes(self.scenario.checked(*columns))

    @property
    def takes_motion(self) -> bool:
        """Whether the command reads lead speeds over time."""
        return self.lead_motion

    def simulate_moving(
        self, lead_speed: ArrayLike, range_: ArrayLike, closing_speed: ArrayLike, lead_speeds: Array
    ) -> Any:  # noqa: ANN401
        """Run the command on n cut-ins with lead speeds over time, and return their outcomes.

        The arguments are lead speed [m/s], range [m] and closing speed [m/s] at the start, each of shape
        (n,), and the lead speeds [m/s] at 0, 0.1, ... s, shape (n, states).
        """
        encounters = self.scenario.checked(lead_speed, range_, closing_speed)
        return self._outcomes(encounters, checked_lead_speeds(lead_speeds, encounters[0])[:, 1:STATES])

    def _outcomes(self, encounters: Array, later_speeds: Array | None = None) -> Any:  # noqa: ANN401
        """Return the outcomes of the command for checked encounters, shape (d, n).

        ``later_speeds`` are the lead speeds from 0.1 s on, shape (n, STATES - 1), if these change.
        """
        if not encounters.shape[1]:
            return self.scenario.outcomes_of(np.empty((len(self.scenario.outcomes), 0)))
        if self.stays:
            return self.scenario.outcomes_of(self._answers(encounters, later_speeds))
        with TemporaryDirectory(prefix="accelerated_evaluation_") as folder:
            source, target = Path(folder, "encounters.csv"), Path(folder, "outcomes.csv")
            _write_encounters(source, encounters, self.scenario, later_speeds)
            self._run([*self.words, str(source), str(target)], encounters)
            outcomes = _read_outcomes(target, encounters, self.scenario, self._error)
        return self.scenario.outcomes_of(outcomes)

    def longest(self, encounters: int) -> float:
        """Return the longest time for a batch [s]: for a program that stays, for its start and each run."""
        return self.time_limit * (1 + encounters if self.stays else 1)

    def _answers(self, encounters: Array, later_speeds: Array | None) -> Array:
        """Return the outcomes of a program that stays, shape (m, n); it is started if it is not running."""
        outcomes = np.empty((len(self.scenario.outcomes), encounters.shape[1]))
        for k, encounter in enumerate(encounters.T.tolist()):
            request: dict[str, Any] = dict(zip(self.scenario.names, encounter, strict=True))
            if later_speeds is not None:
                request["lead_speeds"] = [encounter[0], *later_speeds[k].tolist()]
            place = self.scenario.described(encounters[:, k])
            answer = self._talk(request, place)
            given = [_as_text(answer.get(name)) for name in self.scenario.outcome_names]
            columns = [j if text else None for j, text in enumerate(given)]
            where = f"outcome {{}} of {place}"
            outcomes[:, k] = list(_numbers(given, columns, self.scenario, where, self._error))
        return outcomes

    def _talk(self, request: Mapping[str, Any], place: str) -> Mapping[str, Any]:
        """Return the answer of the program to one encounter; a program that failed is started again."""
        program, self._program = self._program, None
        if program is None:
            program = Conversation(self.words, self.time_limit, self._error)
            atexit.register(program.end)
        answer = program.ask(request, place)
        self._program = program
        return answer

    def _run(self, words: Sequence[str], encounters: Array) -> None:
        """Run the command in its own process group, and end the whole group afterwards."""
        streams = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
        process = started(words, self._error, **streams)
        printed = Printed(process.stdout)
        try:
            status = process.wait(self.time_limit)
        except subprocess.TimeoutExpired as error:
            raise self._error(
                self.scenario.described_batch(encounters),
                f"no end after {self.time_limit:g} s{printed.last_line()}",
                "outcomes within this time limit of a batch",
                "Make the command faster, raise simulations.time_limit, or lower simulations.batch_size.",
            ) from error
        finally:
            ended(process, printed)
        if status:
            how = f"exit status {status}" if status > 0 else f"killed by {signal.Signals(-status).name}"
            batch = self.scenario.described_batch(encounters)
            raise self._error(batch, f"{how}{printed.last_line()}", "exit status 0")

    def _error(self, what: str, seen: str, expected: str, change: str = "Correct the command.") -> InputError:
        page = "staying_program" if self.stays else "your_vehicle"
        advice = f"{change} docs/{page}.md describes what a program reads and writes."
        return InputError(f"vehicle {self.name}, {what}", seen=seen, expected=expected, change=advice)


def _write_encounters(path: Path, encounters: Array, scenario: Scenario, later_speeds: Array | None) -> None:
    rows, names = encounters.T, scenario.names
    if later_speeds is not None:
        rows, names = np.hstack([rows, later_speeds]), (*names, *SPEED_COLUMNS)
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(names)
        writer.writerows(rows.tolist())


def _read_outcomes(
    path: Path, encounters: Array, scenario: Scenario, refuse: Callable[..., InputError]
) -> Array:
    """Return the m outcomes in a CSV file, shape (m, n).

    ``refuse`` is a function that makes the error for a fault of the file.
    """
    count = encounters.shape[1]
    if path.exists() and not path.is_file():  # opening a pipe would wait forever
        raise refuse("OUT.csv", "a folder, a device or a pipe", "a file with the outcomes")
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = [row for row in csv.reader(file) if row]
    except FileNotFoundError as error:
        raise refuse(scenario.described_batch(encounters), "no file OUT.csv", "the outcomes in it") from error
    except (csv.Error, UnicodeDecodeError, OSError) as error:
        raise refuse("OUT.csv", str(error), "CSV text in UTF-8") from error
    header = [name.strip() for name in rows[0]] if rows else []
    expected = [each.name for each in scenario.outcomes if not each.optional or each.name in header]
    if any(header.count(name) != 1 for name in expected):
        raise refuse("OUT.csv, row 1", ", ".join(header) or "no header", f"the columns {', '.join(expected)}")
    if len(rows) - 1 != count:
        raise refuse("OUT.csv", f"{len(rows) - 1} rows", f"{count}, one for each row of IN.csv")
    columns = [header.index(name) if name in header else None for name in scenario.outcome_names]
    outcomes = np.empty((len(columns), count))
    for k, row in enumerate(rows[1:]):
        if len(row) > len(header):
            raise refuse(f"OUT.csv, row {k + 2}", f"{len(row)} cells", f"{len(header)}, as in the header")
        where = f"OUT.csv, row {k + 2}, column {{}}, {scenario.described(encounters[:, k])}"
        outcomes[:, k] = list(_numbers(row, columns, scenario, where, refuse))
    return outcomes


def _numbers(
    row: list[str],
    columns: list[int | None],
    scenario: Scenario,
    where: str,
    refuse: Callable[..., InputError],
) -> Iterator[float]:
    """Yield the outcomes of a row as numbers; `checked_outcomes` checks for NaN and contradictions later.

    ``columns`` is None for an outcome that is not given, which only an optional one may be.
    """
    for outcome, column in zip(scenario.outcomes, columns, strict=True):
        if column is None and outcome.optional:
            yield math.nan
            continue
        text = row[column].strip() if column is not None and column < len(row) else ""
        try:
            yield FLAGS[text.lower()] if outcome.is_flag else number_in(text)
        except (KeyError, ValueError) as error:
            expected = FLAG if outcome.is_flag else "a number"
            raise refuse(where.format(outcome.name), repr(text), expected) from error


def _as_text(value: Any) -> str:  # noqa: ANN401
    """Return a value of JSON as a text that `_numbers` understands; empty for null and a missing value."""
    return "" if value is None else value if isinstance(value, str) else json.dumps(value)
