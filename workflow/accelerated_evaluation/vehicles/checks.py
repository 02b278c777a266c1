"""Checks of the inputs and the outcomes of vehicles."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.scenarios.protocol import Outcome, Scenario

INPUTS = CUT_IN.names
OUTCOMES = CUT_IN.outcome_names
checked_encounters = CUT_IN.checked


def checked_outcomes(
    outcomes: object, encounters: Array, *, vehicle: str, scenario: Scenario = CUT_IN
) -> Any:  # noqa: ANN401
    """Check what ``simulate`` of a user's vehicle returned, and return it as the scenario's outcome type.

    InputError names the first encounter for which an outcome is missing, has a wrong shape or type, or breaks
    a rule of the scenario.
    """
    columns = {
        each.name: _checked_column(outcomes, each, encounters.shape[1], vehicle, scenario)
        for each in scenario.outcomes
    }
    rules = scenario.outcome_rules(dict(zip(scenario.names, encounters, strict=True)) | columns)
    rules += [(np.isnan(column), name, "a number") for name, column in columns.items()]
    for wrong, name, expected in rules:
        if wrong.any():
            row = int(np.argmax(wrong))
            what = f"{name}[{row}] of {scenario.described(encounters[:, row])}"
            raise outcome_error(vehicle, what, repr(columns[name][row].item()), expected)
    return scenario.outcome_type(**columns)


def outcome_error(
    vehicle: str, what: str, seen: str, expected: str, change: str = "Correct the vehicle."
) -> InputError:
    """Return the error for a user's vehicle whose outcomes (``what`` names the part) are not as expected."""
    advice = f"{change} See accelerated_evaluation.vehicles.protocol for the outcomes that are expected."
    return InputError(f"vehicle {vehicle}, {what}", seen=seen, expected=expected, change=advice)


def _checked_column(
    outcomes: object, outcome: Outcome, count: int, vehicle: str, scenario: Scenario
) -> NDArray:
    """Return one outcome of a user's vehicle as an array of booleans or floats, shape (count,)."""
    name = outcome.name
    try:
        column = np.asarray(getattr(outcomes, name))
    except AttributeError as error:
        seen = type(outcomes).__name__
        expected = f"Outcomes with {', '.join(scenario.outcome_names)}"
        raise outcome_error(vehicle, "simulate", seen, expected) from error
    except Exception as error:  # for example a property of the user's class that raises an error
        seen = f"{type(error).__name__}: {' '.join(str(error).split())}"
        raise outcome_error(vehicle, name, seen, f"an array of shape ({count},)") from error
    if column.shape != (count,):
        raise outcome_error(vehicle, name, f"shape {column.shape}", f"shape ({count},)")
    kinds, meaning = ("b", "booleans") if outcome.is_flag else ("fiu", "real numbers")
    if column.dtype.kind not in kinds:
        raise outcome_error(vehicle, name, f"an array of {column.dtype}", f"an array of {meaning}")
    # A copy, because a vehicle may use the same arrays for its next batch.
    return np.array(column, dtype=bool if outcome.is_flag else np.float64)
