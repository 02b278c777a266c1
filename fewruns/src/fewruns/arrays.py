"""Types of arrays, and of what is passed with them."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Indices = NDArray[np.int64]
Function = Callable[[Array], Array]  # of n points, shape (n, d); its result has n values or rows
Generator = np.random.Generator

# Number of elements of a matrix that are computed at once, so that they fit into the cache of a processor.
BLOCK = 32_768
