"""The common part of all smooth laws: unit-exponential coordinates, and segments that only group results.

The first coordinate of a cut-in is -log P(R^-1 > r | v_L), and the second is -log P(C > c | v_L, R) for the
closing speed C. Each of them increases with its variable. They are independent of each other and of v_L
(Rosenblatt 1952).
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
from accelerated_evaluation.distributions import BoundedExponential, Empirical, PiecewiseMixture
from accelerated_evaluation.laws.paper.independent import recorded_lead_speeds
from accelerated_evaluation.laws.protocol import Factors, Law, Stratum
from accelerated_evaluation.laws.smooth.conditional import Places
from accelerated_evaluation.laws.smooth.support import Support

COORDINATES = Factors(BoundedExponential(1.0), BoundedExponential(1.0))
TAIL = 0.05  # share of the upper piece of a coordinate: the paper's for the tail of TTC^-1
KNOT = -math.log(TAIL)
# The exponential distribution is memoryless: both pieces have the same rate, wherever it is divided.
CUT = PiecewiseMixture((1 - TAIL, TAIL), (BoundedExponential(1.0, 0.0, KNOT), BoundedExponential(1.0, KNOT)))


class SmoothStratum(Stratum):
    """One segment of the lead speed, with unit-exponential coordinates.

    Attributes
    ----------
    support
        Limits of the records.
    """

    support: Support

    @property
    def pieces(self) -> Factors:
        """The unit-exponential distributions of the coordinates, each divided at its 95 % quantile."""
        return Factors(CUT, CUT)

    @property
    def inverse_range_min(self) -> float:
        """The smallest R^-1 [1/m], the inverse of the largest recorded range."""
        return 1 / self.support.range_max

    def first(self, lead_speed: ArrayLike, inverse_range: ArrayLike) -> Array:
        """Return the coordinate of the range; it is infinite if R^-1 is infinite."""
        speed, inverse_range = np.broadcast_arrays(*floats(lead_speed, inverse_range))
        coordinate = np.full(speed.shape, math.inf)
        near = np.isfinite(inverse_range)
        coordinate[near] = self.range_coordinate(speed[near], inverse_range[near])[0]
        return coordinate

    def log_first_slope(self, lead_speed: ArrayLike, inverse_range: ArrayLike) -> Array:
        """Return the log of the derivative of the first coordinate by R^-1."""
        speed, inverse_range = np.broadcast_arrays(*floats(lead_speed, inverse_range))
        return np.log(self.range_coordinate(speed, inverse_range)[1]) - np.log(inverse_range)

    @abstractmethod
    def range_coordinate(self, lead_speed: Array, inverse_range: Array) -> tuple[Array, Array]:
        """Return the first coordinate at n places, and its derivative by log(R_max / R), shape (n,)."""

    def logarithm(self, inverse_range: Array) -> Array:
        """Return log(R_max / R), which is 0 if a range is larger than the largest recorded one."""
        return np.maximum(np.log(self.support.range_max * inverse_range), 0.0)

    def places(self, lead_speed: Array, range_: Array) -> Places:
        """Return pairs of lead speed [m/s] and range [m], shape (n,), with the splines of the support."""
        return Places.of(lead_speed, range_, self.support)


class SmoothLaw(Law):
    """A law without segments of its own: the conditional distributions are the same in all segments of v_L.

    Attributes
    ----------
    counts
        Number of lane changes in each segment of v_L, in order of speed.
    lead_speeds
        The recorded v_L [m/s] by segment.
    """

    counts: Mapping[str, int]
    lead_speeds: Mapping[str, Empirical]

    @property
    def shares(self) -> dict[str, float]:
        """Share of the lane changes that fall into each segment."""
        total = sum(self.counts.values())
        return {segment: count / total for segment, count in self.counts.items()}

    def only(self, stratum: str) -> Self:
        """Return the law restricted to one segment, whose share is then one."""
        counts, lead_speeds = {stratum: self.counts[stratum]}, {stratum: self.lead_speeds[stratum]}
        return replace(self, counts=counts, lead_speeds=lead_speeds)


def recorded_segments(encounters: pd.DataFrame) -> tuple[dict[str, int], dict[str, Empirical]]:
    """Return counts and recorded lead speeds [m/s] of the segments of an encounter table, by rising speed."""
    segments = encounters.groupby("segment")["lead_speed"].agg(["min", "size"]).sort_values("min")
    counts = {segment: int(size) for segment, size in segments["size"].items()}
    return counts, recorded_lead_speeds(encounters, counts)


def floats(*arrays: ArrayLike) -> list[Array]:
    """Return arrays of floats with at least one dimension."""
    return [np.atleast_1d(np.asarray(array, dtype=float)) for array in arrays]


def parts(size: int, at_once: int) -> list[slice]:
    """Return slices of at most ``at_once`` elements, which together are ``size`` elements."""
    return [slice(start, start + at_once) for start in range(0, size, at_once)]
