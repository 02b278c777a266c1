"""Types of arrays."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Indices = NDArray[np.int64]

# Number of elements of a matrix that are computed at once, so that they fit into the cache of a processor.
BLOCK = 32_768
