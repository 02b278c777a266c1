"""The array type of the whole library."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
