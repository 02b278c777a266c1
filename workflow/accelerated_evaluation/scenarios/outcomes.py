"""Outcomes of a simulated encounter, with their units and descriptions."""

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from accelerated_evaluation.base.checking import checked

FLAG = "0 or 1"  # unit of an outcome that is true or false
ENDED = "ended"  # name of the flag that is false for a run that was stopped at its longest duration


@checked()
@dataclass(frozen=True)
class Outcome:
    """One outcome of a simulated encounter.

    Attributes
    ----------
    name
        Name of its column in tables, and of the attribute of the outcomes.
    unit
        Unit of the outcome, or `FLAG` if it is true or false.
    description
        Description of the outcome.
    optional
        Whether a vehicle may leave out the outcome, a number, which is then NaN for all encounters.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> [each.name for each in ae.CUT_IN.outcomes][0]
    'crash'
    """

    name: str
    unit: str
    description: str
    optional: bool = False

    @property
    def is_flag(self) -> bool:
        """Whether the outcome is true or false."""
        return self.unit == FLAG


@checked()
def outcome(unit: str, description: str, *, optional: bool = False) -> Any:  # noqa: ANN401
    """Return a dataclass field for an outcome, an array of shape (n,), with its unit and its description.

    A vehicle may leave out an ``optional`` outcome, a number. Optional outcomes are the last fields. An
    outcome that is added to a scenario later is optional, so that vehicles of users remain valid.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> ae.outcome("m", "smallest distance").metadata["unit"]
    'm'
    """
    described = {"unit": unit, "description": description, "optional": optional}
    return field(default=None, metadata=described) if optional else field(metadata=described)


def have_failed(outcomes: Any) -> NDArray[np.bool_]:  # noqa: ANN401
    """Return which of n runs have no outcome, shape (n,): all numbers that every run must have are NaN."""
    needed = [each for each in fields(outcomes) if each.metadata["unit"] != FLAG]
    numbers = [getattr(outcomes, each.name) for each in needed if not each.metadata["optional"]]
    failed = np.full(len(getattr(outcomes, fields(outcomes)[0].name)), bool(numbers))
    for values in numbers:
        failed &= np.isnan(values)
    return failed


def of_known(function: Callable[[Any], NDArray], outcomes: Any, otherwise: float) -> NDArray:  # noqa: ANN401
    """Return a function of the outcomes of n runs, shape (n,), with another value for failed runs."""
    failed = have_failed(outcomes)
    if not failed.any():
        return function(outcomes)
    values = np.full(len(failed), otherwise)
    if not failed.all():
        values[~failed] = function(without_failed(outcomes))
    return values


def without_failed(outcomes: Any) -> Any:  # noqa: ANN401
    """Return the outcomes of the runs that have not failed."""
    known = ~have_failed(outcomes)
    return type(outcomes)(**{name: values[known] for name, values in vars(outcomes).items()})
