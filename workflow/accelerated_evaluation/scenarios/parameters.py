"""Names and checks of the parameters of built-in vehicles."""

from dataclasses import MISSING, field, fields
from typing import Any

import numpy as np

from accelerated_evaluation.base.errors import InputError


def parameter_names(vehicle_class: type) -> list[str]:
    """Return the names of the parameters of a built-in vehicle: the init fields of its dataclass."""
    return [each.name for each in fields(vehicle_class) if each.init]


def required_names(vehicle_class: type) -> list[str]:
    """Return the names of the parameters of a built-in vehicle that have no default."""
    required = (each for each in fields(vehicle_class) if each.init and each.default is MISSING)
    return [each.name for each in required if each.default_factory is MISSING]


def zero_or_more(default: float) -> Any:  # noqa: ANN401
    """Return a dataclass field for a parameter that must be 0 or positive.

    A parameter with a plain number as default must be positive.
    """
    return field(default=default, metadata={"least": 0.0})


def check_number(name: str, value: object, *, least: float | None = None) -> None:
    """Raise InputError if a parameter is not a finite number of at least ``least``, or above 0 for None."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not np.isfinite(value):
        raise parameter_error(name, value, "a finite number")
    if least is None and value <= 0:
        raise parameter_error(name, value, "a positive number")
    if least is not None and value < least:
        raise parameter_error(name, value, f"a number of {least:g} or more")


def parameter_error(name: str, value: object, expected: str) -> InputError:
    """Return the error for an invalid parameter of a built-in vehicle."""
    return InputError(
        f"vehicle parameter {name}",
        seen=repr(value),
        expected=expected,
        change=f"Set {name} in the vehicle's parameters, or leave it out for the published value.",
    )
