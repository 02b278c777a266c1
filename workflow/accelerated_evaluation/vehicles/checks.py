"""Checks of the inputs and the outcomes of vehicles."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.vehicles.protocol import Outcomes

INPUTS = CUT_IN.names
OUTCOMES = tuple(each.name for each in CUT_IN.outcomes)
described = CUT_IN.described


def checked_encounters(
    lead_speed: ArrayLike,
    range_: ArrayLike,
    closing_speed: ArrayLike,
    *,
    source: str = "encounters",
    rows: Sequence[int] | None = None,
) -> Array:
    """Return the inputs of a simulation as one new array of shape (3, n), after checking them.

    Parameters
    ----------
    lead_speed, range_, closing_speed
        Lead speed [m/s], range [m], closing speed [m/s], each of shape (n,).
    source, rows
        Name of the inputs, and number of each of their rows, for messages; by default rows are counted from
        0.

    Raises
    ------
    InputError
        If shapes differ, a value is not finite, a range is not positive, a speed is above that of light, or a
        vehicle would start with a negative speed. The message names the first such row.
    """
    return CUT_IN.checked(lead_speed, range_, closing_speed, source=source, rows=rows)


def described_batch(encounters: Array) -> str:
    """Return a description of the encounters of a batch for messages; at most the first three are named."""
    count = encounters.shape[1]
    if count == 1:
        return described(encounters[:, 0])
    first = [described(encounter).removeprefix("the encounter ") for encounter in encounters.T[:3]]
    return f"a batch of {count} encounters ({'; '.join(first)}{'; ...' if count > 3 else ''})"


def checked_outcomes(outcomes: object, encounters: Array, *, vehicle: str) -> Outcomes:
    """Return the outcomes of a user's vehicle for n encounters with the types of the protocol, after checks.

    Parameters
    ----------
    outcomes
        The result of ``simulate``.
    encounters
        Lead speed [m/s], range [m] and closing speed [m/s], shape (3, n).
    vehicle
        The vehicle's name for messages.

    Raises
    ------
    InputError
        If an outcome is missing, has another shape or type, or contradicts itself. The message names the
        first such row.
    """
    columns = {name: _checked_column(outcomes, name, encounters.shape[1], vehicle) for name in OUTCOMES}
    encountered = dict(zip(INPUTS, encounters, strict=True))
    for wrong, name, expected in CUT_IN.outcome_rules(encountered | columns):
        if wrong.any():
            row = int(np.argmax(wrong))
            what = f"{name}[{row}] of {described(encounters[:, row])}"
            raise outcome_error(vehicle, what, repr(columns[name][row].item()), expected)
    return Outcomes(**columns)


def outcome_error(
    vehicle: str, what: str, seen: str, expected: str, change: str = "Correct the vehicle."
) -> InputError:
    """Return the error for a user's vehicle that does not follow the protocol.

    Parameters
    ----------
    vehicle, what
        The vehicle's name, and the faulty part of its result.
    seen, expected, change
        As in `InputError`.
    """
    advice = f"{change} See accelerated_evaluation.vehicles.protocol for the outcomes that are expected."
    return InputError(f"vehicle {vehicle}, {what}", seen=seen, expected=expected, change=advice)


def _checked_column(outcomes: object, name: str, count: int, vehicle: str) -> NDArray:
    """Return one attribute of a user's outcomes as an array of the protocol's type."""
    try:
        column = np.asarray(getattr(outcomes, name))
    except AttributeError as error:
        seen = type(outcomes).__name__
        raise outcome_error(vehicle, "simulate", seen, f"Outcomes with {', '.join(OUTCOMES)}") from error
    except Exception as error:  # a property of the user's that raises, or lists of unequal lengths
        seen = f"{type(error).__name__}: {' '.join(str(error).split())}"
        raise outcome_error(vehicle, name, seen, f"an array of shape ({count},)") from error
    if column.shape != (count,):
        raise outcome_error(vehicle, name, f"shape {column.shape}", f"shape ({count},)")
    kinds, meaning = ("b", "booleans") if name == "crash" else ("fiu", "real numbers")
    if column.dtype.kind not in kinds:
        raise outcome_error(vehicle, name, f"an array of {column.dtype}", f"an array of {meaning}")
    # A copy, because a vehicle may use the same arrays for its next batch.
    return np.array(column, dtype=bool if name == "crash" else np.float64)
