"""Unit-exponential coordinates of smooth laws, and segments that only group results.

The first coordinate of a cut-in with inverse range r is -log P(R^-1 > r | v_L). The second coordinate of a
cut-in with closing speed c is -log P(C > c | v_L, R). Each coordinate increases with its variable. Both have
a unit exponential distribution, and they are independent of each other and of v_L (Rosenblatt 1952).
"""

import math

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.distributions import BoundedExponential, Empirical, PiecewiseMixture
from accelerated_evaluation.laws.paper.models import recorded_lead_speeds
from accelerated_evaluation.laws.strata import Factors

COORDINATES = Factors(BoundedExponential(1.0), BoundedExponential(1.0))
TAIL = 0.05  # probability of the upper piece of a coordinate, as for the tail of TTC^-1 in the paper
KNOT = -math.log(TAIL)
# The unit exponential distribution as a piecewise mixture of two pieces. Both pieces have the rate 1, because
# the exponential distribution is memoryless.
CUT = PiecewiseMixture((1 - TAIL, TAIL), (BoundedExponential(1.0, 0.0, KNOT), BoundedExponential(1.0, KNOT)))


def recorded_segments(encounters: pd.DataFrame) -> tuple[dict[str, int], dict[str, Empirical]]:
    """Return the number of rows and the recorded lead speeds [m/s] of each segment of an encounter table.

    Both are mappings by name of the segment, in order of lead speed.
    """
    segments = encounters.groupby("segment")["lead_speed"].agg(["min", "size"]).sort_values("min")
    counts = {segment: int(size) for segment, size in segments["size"].items()}
    return counts, recorded_lead_speeds(encounters, counts)


def floats(*arrays: ArrayLike) -> list[Array]:
    """Return the arguments as arrays of floats with at least one dimension."""
    return [np.atleast_1d(np.asarray(array, dtype=float)) for array in arrays]
