"""The array type of the whole library, and arrays in files."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Chosen = NDArray[np.intp] | NDArray[np.bool_]  # indices, or a mask
Units = Mapping[str, float]
SPEED: Units = {"m/s": 1.0, "km/h": 1 / 3.6, "mph": 0.44704, "ft/s": 0.3048}
LENGTH: Units = {"m": 1.0, "km": 1000.0, "ft": 0.3048}
INVERSE_LENGTH: Units = {"1/m": 1.0, "1/ft": 1 / 0.3048}
TIME: Units = {"s": 1.0, "ms": 0.001}
INVERSE_TIME: Units = {"1/s": 1.0}
ACCELERATION: Units = {"m/s^2": 1.0, "m/s2": 1.0, "ft/s^2": 0.3048, "g": 9.80665}


def numbers_in(value: Any) -> Array:  # noqa: ANN401
    """Return nested lists from a file as an array; raise ValueError if a value is not a finite number."""
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"a table of numbers in which a value is no number: {error}") from error
    if not np.isfinite(array).all():
        raise ValueError("a table of numbers in which a value is infinite or not a number")
    return array
