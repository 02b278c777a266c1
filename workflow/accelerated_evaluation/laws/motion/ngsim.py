"""The law of lead motion that was fitted to courses of speed in NGSIM."""

from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np
from scipy.interpolate import PchipInterpolator

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.motion import MOTIONS, STATES, STEP

# Statistics of 13,602 overlapping speed profiles of 8 s that begin above 8 m/s, from US-101 and from
# car-following pairs (parts of NGSIM, recorded by the US Department of Transportation): the mean change of
# speed [m/s] after 1, 2, ..., 8 s; the first three principal components, which explain 98.6 % of the
# variance; and the quantiles of the scores at `LEVELS`, from the smallest to the largest score.
MEAN = np.array([0.016, -0.036, -0.117, -0.203, -0.268, -0.313, -0.36, -0.432])
COMPONENTS = np.array(
    [
        [-0.346, -0.746, -1.139, -1.495, -1.788, -2.009, -2.156, -2.219],
        [-0.363, -0.601, -0.666, -0.556, -0.312, 0.029, 0.428, 0.785],
        [0.254, 0.306, 0.165, -0.064, -0.277, -0.315, -0.056, 0.379],
    ]
)
LEVELS = (0, 0.001, 0.01, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99, 0.999, 1)
# fmt: off
SCORES = (
    (-4.331, -2.868, -2.251, -1.625, -1.28, -0.825, -0.492, -0.236, -0.021, 0.209, 0.454, 0.801, 1.276, 1.75,
     2.476, 3.2, 4.03),
    (-6.711, -4.447, -2.814, -1.648, -1.24, -0.759, -0.432, -0.177, 0.057, 0.266, 0.494, 0.789, 1.225, 1.544,
     2.188, 2.934, 4.864),
    (-7.603, -6.014, -3.102, -1.501, -1.088, -0.668, -0.401, -0.174, 0.042, 0.249, 0.459, 0.719, 1.069, 1.391,
     2.325, 4.332, 7.661),
)
# fmt: on
KNOTS = np.arange(9.0)  # [s]


@MOTIONS.add("ngsim")
@dataclass(frozen=True)
class Ngsim:
    """Random speed profiles, whose three inputs determine the scores of three principal components.

    The changes of speed at whole seconds are interpolated by monotone cubic polynomials, so that the
    acceleration is continuous. The scores are within the range of the recorded scores. Negative speeds are
    replaced by 0.
    """

    inputs: ClassVar[int] = 3

    scale: float = 1.0  # factor of the changes of speed; with 0 the lead vehicle keeps its speed

    def lead_speeds(self, encounters: Array, inputs: Array) -> Array:
        """Return the lead speeds [m/s] of n encounters at 0, 0.1, ..., 8 s, shape (n, 81).

        ``encounters`` contains lead speed [m/s], range [m] and closing speed [m/s] at the lane change, shape
        (3, n), and ``inputs`` contains uniform random numbers on [0, 1], shape (n, 3).
        """
        changes = _changes(np.asarray(inputs, dtype=float).tobytes())
        return np.maximum(encounters[0][:, None] + self.scale * changes, 0.0)


@lru_cache(maxsize=1)
def _changes(inputs: bytes) -> Array:
    """Return the changes of speed over time for inputs, which are given as the bytes of an array.

    The last result is kept, because the same motions are simulated at many closing speeds.
    """
    uniform = np.frombuffer(inputs).reshape(-1, len(SCORES))
    scores = np.column_stack([np.interp(uniform[:, k], LEVELS, values) for k, values in enumerate(SCORES)])
    knots = np.hstack([np.zeros((len(scores), 1)), MEAN + scores @ COMPONENTS])
    return PchipInterpolator(KNOTS, knots, axis=1)(STEP * np.arange(STATES))
