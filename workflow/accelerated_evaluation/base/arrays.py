"""The array type of the whole library, and arrays in files."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def numbers_in(value: Any) -> Array:  # noqa: ANN401
    """Return nested lists from a file as an array; raise ValueError if a value is not a finite number."""
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"a table of numbers in which a value is no number: {error}") from error
    if not np.isfinite(array).all():
        raise ValueError("a table of numbers in which a value is infinite or not a number")
    return array
