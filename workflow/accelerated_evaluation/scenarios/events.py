"""Events of an encounter, given by functions of its outcomes: whether they happened, and how nearly."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from accelerated_evaluation.base.arguments import described
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.checking import checked
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.users_code import running

FILLED = 0.25  # share of the encounters in a part of an event in which the event happens, unless stated


@checked()
@dataclass(frozen=True, order=True)
class Event:
    """An event of an encounter, given by two functions of the outcomes: whether it happened, and how nearly.

    `Event.flag`, `Event.above` and `Event.at_most` make the usual events. Two events are equal if their names
    and thresholds are.

    Attributes
    ----------
    quantity
        Name of the event; for the usual events the name of an outcome.
    threshold
        Threshold in the unit of the outcome; 0 for an event without a threshold.
    happens
        Function of the outcomes of n encounters, an instance of `Scenario.outcome_type`, that returns whether
        the event happened in each of them, shape (n,).
    score
        Function of the outcomes that returns a number for each encounter, shape (n,), which is smaller the
        closer the encounter came to the event.
    at
        Function of a threshold that returns the same event with this threshold; None for an event without
        a threshold.
    scored_by
        Name of the outcome that is the score of encounters without the event; None if it is no single one.
    is_above
        Whether the event is a value above the threshold, as an impact speed, and happens only in crashes.
    filled
        Smallest share of the encounters in a separate part of the event in which the event happens. It is
        small if rounding errors decide in a part of the encounters. The surrogate-guided sampler then makes
        more simulations before it excludes parts that it has not met. It is not used for cut-ins.
    words
        The event in words, with ``{threshold:g}`` and ``{unit}`` in place of the threshold and its unit.

    Examples
    --------
    An event of one's own, from two outcomes of the scenario:

    >>> from accelerated_evaluation import Event
    >>> creeping = Event(
    ...     "creeping",
    ...     happens=lambda outcomes: (outcomes.clearance < 1) & (outcomes.run_time > 30),
    ...     score=lambda outcomes: outcomes.clearance,
    ... )
    """

    quantity: str
    threshold: float = 0.0
    happens: Callable[[Any], NDArray[np.bool_]] = field(kw_only=True, repr=False, compare=False)
    score: Callable[[Any], Array] = field(kw_only=True, repr=False, compare=False)
    at: Callable[[float], "Event"] | None = field(default=None, kw_only=True, repr=False, compare=False)
    scored_by: str | None = field(default=None, kw_only=True, repr=False, compare=False)
    is_above: bool = field(default=False, kw_only=True, repr=False, compare=False)
    filled: float = field(default=FILLED, kw_only=True, repr=False, compare=False)
    words: str | None = field(default=None, kw_only=True, repr=False, compare=False)

    def __post_init__(self) -> None:
        for name in ("happens", "score"):
            function = getattr(self, name)
            if getattr(function, "func", None) is not _values:  # as it is in a copy of an event
                object.__setattr__(self, name, partial(_values, self.quantity, name, function))

    @classmethod
    @checked()
    def flag(cls, name: str, *, scored_by: str, **more: Any) -> "Event":  # noqa: ANN401
        """Return the event that an outcome is true, such as a crash, scored by another outcome.

        ``more`` are further attributes, `filled` and `words`.
        """
        happens, score = partial(_is_true, name), partial(_outcome, scored_by)
        return cls(name, happens=happens, score=score, scored_by=scored_by, **more)

    @classmethod
    @checked()
    def above(cls, name: str, threshold: float, *, scored_by: str, **more: Any) -> "Event":  # noqa: ANN401
        """Return the event that an outcome which is 0 without a crash is above a threshold in a crash.

        The score of a crash is minus the outcome, so that crashes have smaller scores than all other
        encounters, which are scored by the outcome ``scored_by``. ``more`` is as for `flag`.
        """
        return cls(
            name,
            float(threshold),
            happens=partial(_is_above, name, threshold),
            score=partial(_score_above, name, scored_by),
            at=partial(cls.above, name, scored_by=scored_by, **more),
            scored_by=scored_by,
            is_above=True,
            **more,
        )

    @classmethod
    @checked()
    def at_most(cls, name: str, threshold: float, **more: Any) -> "Event":  # noqa: ANN401
        """Return the event that an outcome is at or below a threshold; the outcome is also the score.

        All crashes are such events, or the outcome is not a measure of how near a crash was. ``more`` is as
        for `flag`.
        """
        return cls(
            name,
            float(threshold),
            happens=partial(_is_at_most, name, threshold),
            score=partial(_outcome, name),
            at=partial(cls.at_most, name, **more),
            scored_by=name,
            **more,
        )


def _values(event: str, name: str, function: Callable[[Any], NDArray], outcomes: Any) -> NDArray:  # noqa: ANN401
    """Return what a function of an event returns; InputError if it fails, or returns something else."""
    where, change = f"event {event}, function {name}", "Correct the function."
    known = ", ".join(getattr(outcomes, "__dict__", ()))
    with running(where, f"a function of the outcomes {known}", change):
        values = function(outcomes)
    array, shape = np.asarray(values), np.shape(getattr(outcomes, "crash", values))
    kinds, what = ("b", "flags") if name == "happens" else ("fiu", "numbers")
    if array.shape != shape or array.dtype.kind not in kinds or np.isnan(array).any():
        raise InputError(
            where,
            seen=f"{described(values)} with values such as {array.ravel()[:1]}",
            expected=f"an array of {what} without NaN, of the shape {shape}",
            change=change,
        )
    return array


def _outcome(name: str, outcomes: Any) -> NDArray:  # noqa: ANN401
    """Return an outcome by name; InputError if the vehicle does not have this optional outcome."""
    values = getattr(outcomes, name)
    if values is None or (values.dtype.kind == "f" and np.isnan(values).any()):
        raise InputError(
            "event",
            seen=f"outcomes of a vehicle without {name}",
            expected=f"the optional outcome {name}, on which the event depends",
            change="Add it to the outcomes of the vehicle, or choose another event.",
        )
    return values


def _is_true(name: str, outcomes: Any) -> NDArray[np.bool_]:  # noqa: ANN401
    values = _outcome(name, outcomes)
    if values.dtype != bool:
        raise InputError(
            f"event {name}",
            seen=f"the outcome {name}, a number, without a threshold",
            expected="an outcome that is true or false, or a threshold",
            change=f'Use Event.above("{name}", ...) or Event.at_most("{name}", ...).',
        )
    return values


def _is_above(name: str, threshold: float, outcomes: Any) -> NDArray[np.bool_]:  # noqa: ANN401
    return _outcome(name, outcomes) > threshold


def _is_at_most(name: str, threshold: float, outcomes: Any) -> NDArray[np.bool_]:  # noqa: ANN401
    return _outcome(name, outcomes) <= threshold


def _score_above(name: str, scored_by: str, outcomes: Any) -> Array:  # noqa: ANN401
    return np.where(outcomes.crash, -_outcome(name, outcomes), _outcome(scored_by, outcomes))
