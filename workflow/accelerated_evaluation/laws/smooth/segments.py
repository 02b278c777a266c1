"""The common part of all smooth laws: unit-exponential coordinates, and segments that only group results.

The first coordinate of a cut-in with inverse range r is -log P(R^-1 > r | v_L). The second coordinate of a
cut-in with closing speed c is -log P(C > c | v_L, R). Each coordinate increases with its variable. Both have
a unit exponential distribution, and they are independent of each other and of v_L (Rosenblatt 1952).
"""

import math
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import replace
from typing import Self

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.distributions import BoundedExponential, Empirical, PiecewiseMixture
from accelerated_evaluation.laws.paper.models import recorded_lead_speeds
from accelerated_evaluation.laws.smooth.conditional import Places
from accelerated_evaluation.laws.smooth.support import Support
from accelerated_evaluation.laws.strata import Factors, StratifiedLaw, Stratum

COORDINATES = Factors(BoundedExponential(1.0), BoundedExponential(1.0))
TAIL = 0.05  # probability of the upper piece of a coordinate, as for the tail of TTC^-1 in the paper
KNOT = -math.log(TAIL)
# The unit exponential distribution as a piecewise mixture of two pieces. Both pieces have the rate 1, because
# the exponential distribution is memoryless.
CUT = PiecewiseMixture((1 - TAIL, TAIL), (BoundedExponential(1.0, 0.0, KNOT), BoundedExponential(1.0, KNOT)))


class SmoothStratum(Stratum):
    """One segment of the lead speed, with unit-exponential coordinates."""

    support: Support
    factors = COORDINATES

    @property
    def pieces(self) -> Factors:
        """The unit exponential distributions of the coordinates, each divided into two pieces.

        The knot between the pieces is the 95 % quantile.
        """
        return Factors(CUT, CUT)

    @property
    def range_max(self) -> float:
        """The largest recorded range [m]."""
        return self.support.range_max

    def first(self, lead_speed: ArrayLike, inverse_range: ArrayLike) -> Array:
        """Return the first coordinate -log P(R^-1 > r | v_L), which is infinite for an infinite r.

        The arguments are v_L [m/s] and r [1/m], of shapes that broadcast.
        """
        speed, inverse_range = np.broadcast_arrays(*floats(lead_speed, inverse_range))
        coordinate = np.full(speed.shape, math.inf)
        near = np.isfinite(inverse_range)
        coordinate[near] = self.range_coordinate(speed[near], inverse_range[near])[0]
        return coordinate

    def log_first_slope(self, lead_speed: ArrayLike, inverse_range: ArrayLike) -> Array:
        """Return the log of the derivative of the first coordinate with respect to R^-1, for fixed v_L.

        The arguments are v_L [m/s] and R^-1 [1/m], of shapes that broadcast.
        """
        speed, inverse_range = np.broadcast_arrays(*floats(lead_speed, inverse_range))
        return np.log(self.range_coordinate(speed, inverse_range)[1]) - np.log(inverse_range)

    def second(self, lead_speed: ArrayLike, inverse_range: ArrayLike, closing_speed: ArrayLike) -> Array:
        """Return the second coordinate -log P(C > c | v_L, R), which is infinite for an infinite c.

        The arguments are v_L [m/s], R^-1 [1/m] and closing speed c [m/s], of shapes that broadcast.
        """
        arrays = np.broadcast_arrays(*floats(lead_speed, inverse_range, closing_speed))
        lead, inverse_range, closing = (array.ravel() for array in arrays)
        return self.second_at(lead, inverse_range, closing[:, None]).reshape(arrays[0].shape)

    def closing_speed_probability(
        self, lead_speed: Array, inverse_range: Array, start: Array, end: Array
    ) -> Array:
        """Return P(start <= closing speed < end) given v_L [m/s] and R^-1 [1/m], all of shape (n,)."""
        ends = self.second_at(lead_speed, inverse_range, np.column_stack([start, end]))
        return self.factors.second.interval_probability(*ends.T)

    @abstractmethod
    def second_at(self, lead_speed: Array, inverse_range: Array, closing_speeds: Array) -> Array:
        """Return the second coordinate of m closing speeds for each of n pairs of v_L and R^-1, (n, m)."""

    @abstractmethod
    def range_coordinate(self, lead_speed: Array, inverse_range: Array) -> tuple[Array, Array]:
        """Return the first coordinate and its derivative with respect to log(R_max / R), both (n,)."""

    def logarithm(self, inverse_range: Array) -> Array:
        """Return log(R_max / R) for R^-1 [1/m], with the largest range R_max; 0 if R is larger than R_max."""
        return np.maximum(np.log(self.support.range_max * inverse_range), 0.0)

    def places(self, lead_speed: Array, range_: Array) -> Places:
        """Return n pairs of lead speed [m/s] and range [m], with the values of the splines there."""
        return Places.of(lead_speed, range_, self.support)


class SmoothLaw(StratifiedLaw):
    """Base class of laws whose conditional distributions given v_L are the same in all segments of v_L."""

    lead_speeds: Mapping[str, Empirical]  # the recorded v_L [m/s] by segment

    def only(self, stratum: str) -> Self:
        """Return the law restricted to one segment, given by its name, whose share is then one."""
        counts, lead_speeds = {stratum: self.counts[stratum]}, {stratum: self.lead_speeds[stratum]}
        return replace(self, counts=counts, lead_speeds=lead_speeds)


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


def parts(size: int, at_once: int) -> list[slice]:
    """Return slices of at most ``at_once`` elements that together cover ``size`` elements."""
    return [slice(start, start + at_once) for start in range(0, size, at_once)]
