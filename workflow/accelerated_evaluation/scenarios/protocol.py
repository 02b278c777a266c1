"""Interface of a scenario: variables, limits, outcomes, events, records and vehicles of a kind of encounter.

One module defines a `Scenario`, and each of its vehicles has a further module. Problems, methods, stores,
commands and figures take the names, units and limits from the scenario, and therefore work for every
scenario.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.checking import checked
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.tables import CLUSTER as CLUSTER
from accelerated_evaluation.records.named import NamedRecords
from accelerated_evaluation.scenarios.events import Event
from accelerated_evaluation.scenarios.outcomes import Outcome
from accelerated_evaluation.scenarios.variables import Variable

FITTED = "fitted"  # flag in every table of records: laws are fitted to the row; see also `CLUSTER`

Fault = tuple[NDArray[np.bool_], str, str]
"""Flags of the rows that break a rule, name of the column for the message, and what was expected."""

ReportedRule = tuple[Callable[[float], bool], str]
"""Function that returns whether a reported outcome is possible, and a text that says what was expected."""


@dataclass(frozen=True)
class Panel:
    """A panel of the figure of one simulated encounter, over time."""

    label: str  # label of the vertical axis, with the unit
    lines: Mapping[str, str]  # names in the legend of the columns of the trace that are drawn
    zero: bool = False  # whether a horizontal line is drawn at 0
    limits: tuple[float, float] | None = None  # of the vertical axis; None to show all values


class Simulating(Protocol):
    """A vehicle of any scenario, which only needs to simulate encounters."""

    def simulate(self, *columns: Array) -> Any:  # noqa: ANN401
        """Return the outcomes of n encounters, given the scenario's variables, each of shape (n,)."""


@checked()
@dataclass(frozen=True)
class Rules:
    """Rules of a scenario that the limits of its variables do not cover.

    Attributes
    ----------
    inputs
        Function that takes the columns of encounters by name, and returns their faults.
    outcomes
        Function that takes the columns of encounters and outcomes by name, and returns the faults of the
        outcomes of a user's vehicle.
    reported
        Function that takes whether there was a crash, and the variables of a run on a proving ground by name.
        It returns rules for the outcomes that are reported for this run, by name of the outcome. Any outcome
        may be missing in the report.
    """

    inputs: Callable[[Mapping[str, Array]], list[Fault]] = lambda columns: []
    outcomes: Callable[[Mapping[str, NDArray]], list[Fault]] = lambda columns: []
    reported: Callable[[bool, Mapping[str, float]], Mapping[str, ReportedRule]] = lambda crash, encounter: {}


@checked()
@dataclass(frozen=True)
class Recorded:
    """The records of a scenario: those that come with the project, and how a table of records is read.

    Attributes
    ----------
    file, verdicts
        File of the records that come with the project, and file of published outcomes of a vehicle, relative
        to the root of the project; None if there are none. The file of outcomes has the columns of the
        variables, ``crash`` and ``fragile`` (1 if rounding errors decide whether there is a crash).
    cluster
        Name of the column of a table of records that identifies who or what made a record.
    read
        Function that reads a table of records and checks it. The result has the columns of the variables,
        `CLUSTER` (driver or device, as text) and `FITTED` (whether laws are fitted to the row). If it is
        None, `record_table.read_record_table` reads the table.
    named
        Function that returns the records that a configuration names; None if they are one table with the
        variables, which `record_table.TableRecords` reads.
    """

    file: Path | None = None
    verdicts: Path | None = None
    cluster: str = "driver"
    read: Callable[[Path], pd.DataFrame] | None = None
    named: Callable[[Mapping[str, Any]], NamedRecords] | None = None


@checked()
@dataclass(frozen=True)
class Scenario:
    """A kind of encounter, with its variables, outcomes, events, records and vehicles.

    Attributes
    ----------
    name
        Name in the registry, in configurations and on the command line.
    description
        A sentence that says what happens in the encounter.
    variables
        The variables, in the order in which a vehicle receives them: ``vehicle.simulate(*columns)``.
    outcome_type
        Frozen dataclass of the outcomes, whose fields are made by `outcome`, each an array of shape (n,). The
        first field is ``crash``. If there is a flag `ENDED`, it is false for a run without a crash that was
        stopped at its longest duration.
    events
        The events; the first one is the crash.
    vehicles
        Registry of the built-in vehicles.
    default_vehicle
        Name of the vehicle that is simulated if the user names no vehicle.
    records
        What is known about records of the scenario.
    rules
        Rules for encounters and outcomes that the limits of the variables do not cover.
    restrictions
        Subsets of the encounters for which results are also given, by name. Each is a function that takes
        points of a law, shape (n, d), and returns whether each point is in the subset, shape (n,).
    divided_by
        Name of a variable, and limits of its absolute value by which crashes are divided into groups; see
        `answer.crash_shares`. It is used if crashes at small values are artefacts of the
        simulation; otherwise None.
    noun
        Word for an encounter in texts.
    scope
        The encounters whose probabilities the laws give, in words, if these are not all encounters.
    derived
        Quantities that follow from the variables and help to run an encounter, by name. Each is a function
        of the mapping from names of variables to values.
    panels
        Panels of the figure of one simulated encounter; by default one for every column of the trace.
    references
        Names of vehicles to compare with, by the prefix of their columns.
    upper_set_in
        Name of a variable above some value of which, for given other variables, every event happens. A
        sampler then need not look for further parts of an event. None if this is not known.
    scanned
        Name of a variable along which, for given other variables, every event happens in a few intervals, so
        that a scan finds them. None if this is not known. For laws that are a `SlicedLaw`, this gives exact
        answers.
    host_speed
        Names of the variables whose sum is the speed of the vehicle under test at the start.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> ae.SCENARIOS["left_turn"].names[-1], ae.CUT_IN.names
    ('distance_to_conflict_m', ('lead_speed', 'range', 'closing_speed'))
    """

    name: str
    description: str
    variables: Sequence[Variable]
    outcome_type: type
    events: Sequence[Event]
    vehicles: Mapping[str, type]
    default_vehicle: str
    records: Recorded = Recorded()
    rules: Rules = Rules()
    restrictions: Mapping[str, Callable[[Array], NDArray[np.bool_]]] = field(default_factory=dict)
    divided_by: tuple[str, tuple[float, ...]] | None = None
    noun: str = "encounter"
    scope: str = ""
    references: Mapping[str, str] = field(default_factory=dict)
    upper_set_in: str | None = None
    scanned: str | None = None
    host_speed: Sequence[str] = ()
    derived: Mapping[str, Callable[[Mapping[str, Any]], Any]] = field(default_factory=dict)
    panels: Sequence[Panel] = ()

    def __post_init__(self) -> None:
        names = [each.name for each in self.variables]
        chosen = [self.upper_set_in, self.scanned, *self.host_speed, *(self.divided_by or ())[:1]]
        unknown = [each for each in chosen if each is not None and each not in names]
        is_described = is_dataclass(self.outcome_type) and all(
            {"unit", "description"} <= each.metadata.keys() for each in fields(self.outcome_type)
        )
        for wrong, seen, expected in (
            (not names, "no variables", "at least one Variable"),
            (len({*names}) < len(names), f"the variables {', '.join(names)}", "a name of its own for each"),
            (
                not is_described or self.outcome_names[:1] != ("crash",),
                f"the outcomes {self.outcome_type.__name__}",
                "a frozen dataclass with fields that `outcome` makes, of which the first is crash",
            ),
            (not self.events, "no events", "at least one Event, the crash"),
            (unknown, f"the variable {', '.join(unknown)}", f"one of its variables, {', '.join(names)}"),
        ):
            if wrong:
                change = "Correct the scenario; docs/your_scenario.md has an example."
                raise InputError(f"Scenario {self.name}", seen=seen, expected=expected, change=change)

    @property
    def has_support(self) -> bool:
        """Whether its records have limits for smooth laws of a closing speed in segments of the lead speed.

        The workflow then has crash maps with the paper's methods, and replays of simulated crashes.
        """
        return self.records.named is not None

    @property
    def one(self) -> str:
        """The word for an encounter with its article, such as "a cut-in"."""
        return f"{'an' if self.noun[0] in 'aeiou' else 'a'} {self.noun}"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the variables, which are the columns of a table of encounters."""
        return tuple(variable.name for variable in self.variables)

    @property
    def dimension(self) -> int:
        """Number d of variables."""
        return len(self.variables)

    @property
    def limits(self) -> Array:
        """Smallest and largest value of each variable, shape (d, 2)."""
        return np.array([[variable.low, variable.high] for variable in self.variables], dtype=float)

    @property
    def law_limits(self) -> Array:
        """Limits of each variable in a law, shape (d, 2).

        They differ from `limits` for a variable whose sign does not matter: its lower limit is 0, and the
        upper limit is the largest absolute value.
        """
        limits = self.limits
        for k, each in enumerate(self.variables):
            if not each.sign_matters:
                limits[k] = 0.0, max(-each.low, each.high)
        return limits

    def as_in_law(self, x: Array) -> Array:
        """Return encounters x, shape (n, d), with absolute values of variables whose sign does not matter."""
        unsigned = [not each.sign_matters for each in self.variables]
        return np.where(unsigned, np.abs(x), x)

    def settable(self, encounters: Array) -> Array:
        """Return encounters, shape (n, d), rounded to the steps in which their variables can be set.

        A variable that is not 0 is rounded to at least one step, because an encounter without any distance or
        without any motion is of another kind. If rounding breaks a rule of the scenario, all variables of the
        encounter are rounded towards 0 instead.
        """
        steps = np.array([each.step for each in self.variables])
        counts = np.abs(encounters) / steps
        # The last rounding removes the digits that the multiplication adds, as in 3 * 0.1.
        nearest, below = (
            np.sign(encounters) * np.round(np.maximum(rounded, encounters != 0) * steps, 9)
            for rounded in (np.round(counts), np.floor(counts))
        )
        broken = np.any([wrong for wrong, *_ in self._faults(nearest.T)], axis=0)
        return np.where(broken[:, None], below, nearest)

    @property
    def outcomes(self) -> tuple[Outcome, ...]:
        """Descriptions of the outcomes, in the order of the fields of `outcome_type`."""
        return tuple(Outcome(each.name, **each.metadata) for each in fields(self.outcome_type))

    @property
    def outcome_names(self) -> tuple[str, ...]:
        """Names of the outcomes, which are columns of a table of simulated encounters."""
        return tuple(each.name for each in fields(self.outcome_type))

    def known_vehicle(self) -> Any:  # noqa: ANN401
        """Return the default vehicle, a built-in one, with the default values of its parameters."""
        return self.vehicles[self.default_vehicle]()

    @property
    def measured(self) -> tuple[str, ...]:
        """Names of the outcomes that are numbers, not flags."""
        return tuple(each.name for each in self.outcomes if not each.is_flag)

    def with_derived(self, encounter: Mapping[str, Any]) -> dict[str, Any]:
        """Return the variables of an encounter by name, followed by the derived quantities."""
        return {**encounter, **{name: quantity(encounter) for name, quantity in self.derived.items()}}

    def event(self, quantity: str, threshold: float = 0.0) -> Event:
        """Return the event that refers to an outcome, with the given threshold.

        Parameters
        ----------
        quantity
            Name of the outcome.
        threshold
            Threshold in the unit of the outcome; not used for an event without a threshold.

        Raises
        ------
        KeyError
            If no event of the scenario refers to this outcome.
        """
        event = {each.quantity: each for each in self.events}[quantity]
        return event if event.at is None else event.at(threshold)

    def event_in_words(self, event: Event) -> str:
        """Return an event as text with its unit, such as ``impact speed above 5 m/s``."""
        unit = next((each.unit for each in self.outcomes if each.name == event.quantity), "")
        words = event.words
        if words is None:
            words = event.quantity.replace("_", " ")
            if event.at is not None:
                words += f" {'above' if event.is_above else 'at most'} {{threshold:g}} {{unit}}"
        return words.format(threshold=event.threshold, unit=unit)

    def outcomes_of(self, columns: Iterable[ArrayLike]) -> Any:  # noqa: ANN401
        """Return the outcomes of n encounters as an instance of `outcome_type`, from columns of numbers.

        Parameters
        ----------
        columns
            One column of shape (n,) for each outcome, in order. A flag is true if its number is above 0.
        """
        return self.outcome_type(
            *(
                np.asarray(column) > 0 if each.is_flag else np.ascontiguousarray(column, dtype=np.float64)
                for each, column in zip(self.outcomes, columns, strict=True)
            )
        )

    def checked(
        self, *columns: ArrayLike, source: str = "encounters", rows: Sequence[int] | None = None
    ) -> Array:
        """Check encounters, and return them as one new array of shape (d, n).

        Parameters
        ----------
        *columns
            The variables, in order, each of shape (n,).
        source, rows
            Name of the encounters, and their row numbers, for messages. By default rows are counted from 0.

        Raises
        ------
        InputError
            If shapes differ, a value is not finite or is outside the limits of its variable, or a rule of the
            scenario is broken. The message names the first such row.
        """
        encounters = self._stacked(columns, source)
        with np.errstate(over="ignore", invalid="ignore"):
            faults = self._faults(encounters)
        first = [(int(np.argmax(wrong)), name, expected) for wrong, name, expected in faults if wrong.any()]
        if first:
            row, name, expected = min(first, key=lambda fault: fault[0])
            raise InputError(
                f"{source}, row {row if rows is None else rows[row]}, column {name}",
                seen=repr(encounters[self.names.index(name), row].item()),
                expected=expected,
                change="Correct or remove this encounter.",
            )
        return encounters

    def _stacked(self, columns: Sequence[ArrayLike], source: str) -> Array:
        """Return the variables as one array of numbers, shape (d, n)."""
        arrays = [np.asarray(column) for column in columns]
        shapes = [array.shape for array in arrays]
        if len(arrays) != self.dimension or arrays[0].ndim != 1 or len(set(shapes)) > 1:
            raise InputError(
                source,
                seen=f"arrays of shapes {', '.join(map(str, shapes))}",
                expected=f"{', '.join(self.names)}, arrays of one dimension and of equal length",
                change="Pass one value of each variable for every encounter.",
            )
        try:
            return np.array(arrays, dtype=np.float64)
        except (TypeError, ValueError) as error:
            change = "Pass arrays of floating-point numbers."
            raise InputError(source, seen=str(error), expected="numbers", change=change) from error

    def _faults(self, encounters: Array) -> list[Fault]:
        """Return the faults: values that are not finite or outside the limits, and broken rules."""
        pairs = list(zip(self.variables, encounters, strict=True))
        return [
            *((~np.isfinite(values), each.name, "a finite number") for each, values in pairs),
            *self.rules.inputs(dict(zip(self.names, encounters, strict=True))),
            *(
                ((values < each.low) | (values > each.high), each.name, each.in_words)
                for each, values in pairs
            ),
        ]

    def described(self, encounter: Iterable[float]) -> str:
        """Return a description of one encounter, shape (d,), for messages."""
        numbers = (f"{name} {value:g}" for name, value in zip(self.names, encounter, strict=True))
        return f"the encounter {', '.join(numbers)}"

    def described_batch(self, encounters: Array) -> str:
        """Return a description of a batch, shape (d, n), for messages; it names at most three encounters."""
        count = encounters.shape[1]
        if count == 1:
            return self.described(encounters[:, 0])
        first = [self.described(encounter).removeprefix("the encounter ") for encounter in encounters.T[:3]]
        return f"a batch of {count} encounters ({'; '.join(first)}{'; ...' if count > 3 else ''})"
