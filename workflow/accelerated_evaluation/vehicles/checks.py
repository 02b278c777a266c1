"""Checks of the inputs and the outcomes of vehicles."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.vehicles.protocol import Outcomes

INPUTS = ("lead_speed", "range", "closing_speed")
OUTCOMES = ("crash", "min_range", "min_ttc", "impact_speed")

# The speed of light. Nothing drives as fast, so a larger number is an overflow or another quantity. The limit
# is no lower, because laws of cut-ins without a cap on the closing speed do draw absurd speeds at very long
# ranges, which are harmless; below this limit no square of a speed overflows in a vehicle's arithmetic.
SPEED_LIMIT = 299_792_458.0  # [m/s]


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
    encounters = _stacked(lead_speed, range_, closing_speed, source)
    fault = _first_fault(encounters)
    if fault:
        row, column, expected = fault
        raise InputError(
            f"{source}, row {row if rows is None else rows[row]}, column {INPUTS[column]}",
            seen=repr(encounters[column, row].item()),
            expected=expected,
            change="Correct or remove this encounter.",
        )
    return encounters


def _stacked(lead_speed: ArrayLike, range_: ArrayLike, closing_speed: ArrayLike, source: str) -> Array:
    """Return the inputs as one array of numbers."""
    columns = [np.asarray(column) for column in (lead_speed, range_, closing_speed)]
    shapes = [column.shape for column in columns]
    if columns[0].ndim != 1 or len(set(shapes)) > 1:
        raise InputError(
            source,
            seen=f"{', '.join(INPUTS)} of shapes {', '.join(map(str, shapes))}",
            expected="three arrays of one dimension and equal length",
            change="Pass one value of each for every encounter.",
        )
    try:
        return np.array(columns, dtype=np.float64)
    except (TypeError, ValueError) as error:
        change = "Pass arrays of floating-point numbers."
        raise InputError(source, seen=str(error), expected="numbers", change=change) from error


def _first_fault(encounters: Array) -> tuple[int, int, str] | None:
    """Return row, column and what is expected there, for the first encounter outside the model."""
    lead_speed, range_, closing_speed = encounters
    finite = np.isfinite(encounters)
    with np.errstate(over="ignore", invalid="ignore"):  # where a value is not finite, or overflows the sum
        rules = [
            (~finite[0], 0, "a finite number"),
            (~finite[1], 1, "a finite number"),
            (~finite[2], 2, "a finite number"),
            (lead_speed > SPEED_LIMIT, 0, f"at most {SPEED_LIMIT:.0f} m/s, the speed of light"),
            (np.abs(closing_speed) > SPEED_LIMIT, 2, f"at most {SPEED_LIMIT:.0f} m/s, the speed of light"),
            (lead_speed < 0, 0, "a speed of 0 m/s or more"),
            (range_ <= 0, 1, "a range above 0 m"),
            (lead_speed + closing_speed < 0, 2, "at least minus the lead speed: the host drives forwards"),
        ]
    faults = [(int(np.argmax(wrong)), column, expected) for wrong, column, expected in rules if wrong.any()]
    return min(faults, key=lambda fault: fault[0], default=None)


def described(encounter: ArrayLike) -> str:
    """Return a description of one encounter for messages."""
    numbers = (f"{name} {value:g}" for name, value in zip(INPUTS, encounter, strict=True))
    return f"the encounter {', '.join(numbers)}"


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
    crash, min_range, min_ttc, impact_speed = columns.values()
    rules = [
        ("min_range", ~np.isfinite(min_range), "a finite number"),
        ("min_range", min_range > encounters[1], "at most the initial range"),
        ("min_range", crash & (min_range > 0), "0 m or less where crash is true"),
        ("min_range", ~crash & (min_range <= 0), "above 0 m where crash is false"),
        ("min_ttc", ~(min_ttc > 0), "above 0 s, infinity if the host never closed in"),
        (
            "impact_speed",
            ~(np.isfinite(impact_speed) & (impact_speed >= 0)),
            "a finite speed of 0 m/s or more",
        ),
        ("impact_speed", ~crash & (impact_speed != 0), "0 m/s where crash is false"),
    ]
    for name, wrong, expected in rules:
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
