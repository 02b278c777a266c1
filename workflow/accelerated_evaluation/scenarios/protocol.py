"""The noun scenario: variables with limits, outcomes, events, records and vehicles of one kind of encounter.

A scenario is one file that defines one `Scenario`. Its records are read by a second file, and each of its
vehicles is a further file. Problems, methods, stores, commands and figures ask the scenario for the names,
the units and the limits, and therefore work for every scenario.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError

FLAG = "0 or 1"  # unit of an outcome that is true or false
ENDED = "ended"  # name of the flag that is false for a run that was stopped at its longest duration
UNLIMITED = 1e6  # limits this large are not worth mentioning
CLUSTER, FITTED = "cluster", "fitted"  # columns of every table of records, next to those of the variables

Fault = tuple[NDArray[np.bool_], str, str]
"""Rows that break a rule, the column to name in the message, and what was expected there."""

ReportedRule = tuple[Callable[[float], bool], str]
"""Whether a reported outcome is possible, and what was expected."""


@dataclass(frozen=True)
class Variable:
    """One variable of an encounter.

    Attributes
    ----------
    name
        Name of its column in tables, such as ``sdv_speed_mps``.
    unit
        Its unit.
    low, high
        Smallest and largest value that can be simulated, in this unit. Both are possible.
    role
        ``covariate`` if its law is the empirical distribution of the records, ``modelled`` if a law is
        fitted.
    description
        What it is, in words.
    sign_matters
        Whether the sign matters to the vehicle. If it does not, laws are fitted to the absolute value: values
        near zero are then a tail of the law, where a sampler in normal scores looks for events.
    """

    name: str
    unit: str
    low: float
    high: float
    role: Literal["covariate", "modelled"]
    description: str
    sign_matters: bool = True

    @property
    def in_title(self) -> str:
        """Return the name as text without the unit at its end, such as ``sdv speed``."""
        unit = self.unit.replace("/s", "ps")
        return self.name.removesuffix(f"_{unit}").replace("_", " ")

    @property
    def in_words(self) -> str:
        """Return the limits as text, such as ``0 to 30 m/s``; only the unit if they exclude nothing."""
        is_limited = max(abs(self.low), abs(self.high)) < UNLIMITED
        return f"{self.low:g} to {self.high:g} {self.unit}" if is_limited else self.unit


@dataclass(frozen=True)
class Outcome:
    """One outcome of a simulated encounter.

    Attributes
    ----------
    name
        Name of its column in tables, and of the attribute of the outcomes.
    unit
        Its unit, or `FLAG` if it is true or false.
    description
        What it is, in words.
    """

    name: str
    unit: str
    description: str

    @property
    def is_flag(self) -> bool:
        """Whether the outcome is true or false."""
        return self.unit == FLAG


def outcome(unit: str, description: str) -> Any:  # noqa: ANN401
    """Return a dataclass field for one outcome; the class with these fields is a scenario's outcome type."""
    return field(metadata={"unit": unit, "description": description})


@dataclass(frozen=True)
class Panel:
    """A panel of the figure of one simulated encounter, over time.

    Attributes
    ----------
    label
        Label of the vertical axis, with the unit.
    lines
        Columns of the trace that are drawn, and what they are called in the legend.
    zero
        Whether a line is drawn at 0.
    limits
        Limits of the vertical axis; None to show all values.
    """

    label: str
    lines: Mapping[str, str]
    zero: bool = False
    limits: tuple[float, float] | None = None


@dataclass(frozen=True, order=True)
class Event:
    """An event of an encounter: the crash, or an outcome above or below a threshold.

    Attributes
    ----------
    quantity
        Name of the outcome; a flag is an event without a threshold.
    threshold
        Threshold in the unit of the outcome.
    scored_by
        Name of the outcome that becomes smaller the closer an encounter came to the event.
    is_above
        Whether the event is a value above the threshold; otherwise it is a value at or below the threshold.
    """

    quantity: str
    threshold: float = 0.0
    scored_by: str = field(kw_only=True, repr=False)
    is_above: bool = field(default=False, kw_only=True, repr=False)

    @property
    def in_words(self) -> str:
        """Return the event as text, such as ``impact_speed above 5``."""
        limit = f" {'above' if self.is_above else 'at most'} {self.threshold:g}"
        return self.quantity + ("" if self.quantity == "crash" else limit)

    def happens(self, outcomes: Any) -> NDArray[np.bool_]:  # noqa: ANN401
        """Return whether the event happened in each simulated encounter."""
        values = getattr(outcomes, self.quantity)
        if values.dtype == bool:
            return values
        return values > self.threshold if self.is_above else values <= self.threshold

    def score(self, outcomes: Any) -> Array:  # noqa: ANN401
        """Return a score, shape (n,), that becomes smaller the closer an encounter came to the event.

        If the event is a value above a threshold, such as an impact speed, crashes get smaller scores than
        all other encounters, ordered by this value.
        """
        nearness = getattr(outcomes, self.scored_by)
        return (
            np.where(outcomes.crash, -getattr(outcomes, self.quantity), nearness)
            if self.is_above
            else nearness
        )


def _as_they_are(x: Array) -> Array:
    return x


def _no_rules(columns: Mapping[str, Array]) -> list[Fault]:
    return []


def _no_reported_rules(crash: bool, encounter: Mapping[str, float]) -> dict[str, ReportedRule]:
    return {}


@dataclass(frozen=True)
class Scenario:
    """One kind of encounter: what varies in it, and what its records, outcomes, events and vehicles are.

    Attributes
    ----------
    name
        Name in the registry, in configurations and on the command line.
    description
        What happens in the encounter, in a sentence.
    variables
        The variables, in the order in which a vehicle receives them: ``vehicle.simulate(*columns)``.
    outcome_type
        Frozen dataclass of the outcomes, one array of shape (n,) for each; its fields are made by `outcome`.
        The first is ``crash``. If it has the flag `ENDED`, a run that was stopped at its longest duration has
        neither crashed nor ended.
    events
        The events, the crash first.
    vehicles
        Registry of the built-in vehicles.
    default_vehicle
        Name of the vehicle that is simulated if none is named.
    read_records
        Function that reads a table of records and checks it. The result has the columns of the variables,
        `CLUSTER` (driver or device, as text) and `FITTED` (whether laws are fitted to the row).
    records, verdicts
        File of the records that come with the project, and of published verdicts on a vehicle, relative to
        the root of the project; None if there are none. Verdicts have the columns of the variables, ``crash``
        and ``fragile`` (1 where rounding decides).
    experiments
        File of the estimates of stored experiments by importance sampling, whose rows are among the verdicts;
        see `answer.stored_experiments`. None if there are none.
    restrictions
        Parts of the encounters for which the answer is also given, by name. Each is a function that returns
        whether points of a law, shape (n, d), are in the part.
    divided_by
        Variable and values of its size by which crashes are divided; see `answer.crash_shares`. None if the
        size of no variable says which crashes are artefacts.
    to_inputs
        Function that maps points in the space of the law, shape (n, d), to what a vehicle receives, in the
        order of the variables, shape (n, d).
    input_rules
        Function that returns rules for encounters beyond the limits of the variables; it receives the columns
        by name.
    outcome_rules
        Function that returns rules for the outcomes of a user's vehicle; it receives the columns of the
        encounters and of the outcomes by name.
    reported_rules
        Function that returns, by name, rules for the outcomes of a run on a proving ground, of which any may
        be missing; it receives whether there was a crash, and the variables of the run by name.
    noun
        What one encounter is called in texts.
    derived
        Quantities that follow from the variables and help those who run an encounter, by name. Each is a
        function of the variables by name.
    panels
        What the figure of one simulated encounter shows; by default every column of the trace.
    """

    name: str
    description: str
    variables: Sequence[Variable]
    outcome_type: type
    events: Sequence[Event]
    vehicles: Mapping[str, type]
    default_vehicle: str
    read_records: Callable[[Path], pd.DataFrame]
    records: Path | None = None
    verdicts: Path | None = None
    experiments: Path | None = None
    restrictions: Mapping[str, Callable[[Array], NDArray[np.bool_]]] = field(default_factory=dict)
    divided_by: tuple[str, tuple[float, ...]] | None = None
    to_inputs: Callable[[Array], Array] = _as_they_are
    input_rules: Callable[[Mapping[str, Array]], list[Fault]] = _no_rules
    outcome_rules: Callable[[Mapping[str, Array]], list[Fault]] = _no_rules
    reported_rules: Callable[[bool, Mapping[str, float]], Mapping[str, ReportedRule]] = _no_reported_rules
    noun: str = "encounter"
    derived: Mapping[str, Callable[[Mapping[str, Any]], Any]] = field(default_factory=dict)
    panels: Sequence[Panel] = ()

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
        return np.array([[variable.low, variable.high] for variable in self.variables])

    @property
    def law_limits(self) -> Array:
        """Limits of each variable of a law, shape (d, 2): from 0 up for variables without a sign."""
        limits = self.limits
        for k, each in enumerate(self.variables):
            if not each.sign_matters:
                limits[k] = 0.0, max(-each.low, each.high)
        return limits

    def as_in_law(self, x: Array) -> Array:
        """Return encounters, shape (n, d), with absolute values where the sign does not matter."""
        unsigned = [not each.sign_matters for each in self.variables]
        return np.where(unsigned, np.abs(x), x)

    @property
    def outcomes(self) -> tuple[Outcome, ...]:
        """The outcomes, in the order of the outcome type."""
        return tuple(Outcome(each.name, **each.metadata) for each in fields(self.outcome_type))

    @property
    def outcome_names(self) -> tuple[str, ...]:
        """Names of the outcomes, which are columns of a table of simulated encounters."""
        return tuple(each.name for each in fields(self.outcome_type))

    @property
    def measured(self) -> tuple[str, ...]:
        """Names of the outcomes that are numbers."""
        return tuple(each.name for each in self.outcomes if not each.is_flag)

    def with_derived(self, encounter: Mapping[str, Any]) -> dict[str, Any]:
        """Return the variables of an encounter by name, and after them the derived quantities."""
        return {**encounter, **{name: quantity(encounter) for name, quantity in self.derived.items()}}

    def event(self, quantity: str, threshold: float = 0.0) -> Event:
        """Return the event that refers to an outcome, with another threshold; KeyError if there is none."""
        return replace({each.quantity: each for each in self.events}[quantity], threshold=threshold)

    def event_in_words(self, event: Event) -> str:
        """Return an event as text with its unit, such as ``impact speed above 5 m/s``."""
        units = {each.name: "" if each.is_flag else f" {each.unit}" for each in self.outcomes}
        return event.in_words.replace("_", " ") + units[event.quantity]

    def outcomes_of(self, columns: Sequence[ArrayLike]) -> Any:  # noqa: ANN401
        """Return outcomes from their columns, in order, as numbers; flags become booleans."""
        return self.outcome_type(
            *(
                np.asarray(column) > 0 if each.is_flag else np.ascontiguousarray(column, dtype=np.float64)
                for each, column in zip(self.outcomes, columns, strict=True)
            )
        )

    def checked(
        self, *columns: ArrayLike, source: str = "encounters", rows: Sequence[int] | None = None
    ) -> Array:
        """Return the inputs of a simulation as one new array of shape (d, n), after checking them.

        Parameters
        ----------
        *columns
            The variables, in order, each of shape (n,).
        source, rows
            Name of the inputs, and number of each of their rows, for messages; by default rows are counted
            from 0.

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
                change="Pass one value of each for every encounter.",
            )
        try:
            return np.array(arrays, dtype=np.float64)
        except (TypeError, ValueError) as error:
            change = "Pass arrays of floating-point numbers."
            raise InputError(source, seen=str(error), expected="numbers", change=change) from error

    def _faults(self, encounters: Array) -> list[Fault]:
        """Return the rows that are not finite, break a rule, or are outside the limits of a variable."""
        pairs = list(zip(self.variables, encounters, strict=True))
        return [
            *((~np.isfinite(values), each.name, "a finite number") for each, values in pairs),
            *self.input_rules(dict(zip(self.names, encounters, strict=True))),
            *(
                ((values < each.low) | (values > each.high), each.name, each.in_words)
                for each, values in pairs
            ),
        ]

    def described(self, encounter: ArrayLike) -> str:
        """Return a description of one encounter for messages."""
        numbers = (f"{name} {value:g}" for name, value in zip(self.names, encounter, strict=True))
        return f"the encounter {', '.join(numbers)}"

    def described_batch(self, encounters: Array) -> str:
        """Return a description of the encounters of a batch, shape (d, n); at most three are named."""
        count = encounters.shape[1]
        if count == 1:
            return self.described(encounters[:, 0])
        first = [self.described(encounter).removeprefix("the encounter ") for encounter in encounters.T[:3]]
        return f"a batch of {count} encounters ({'; '.join(first)}{'; ...' if count > 3 else ''})"
