"""A law in which the closing speed depends smoothly on range and lead speed, without segments or cap."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.distributions import BoundedExponential, Empirical, PiecewiseMixture
from accelerated_evaluation.distributions.tails import interval_probability
from accelerated_evaluation.laws import LAWS
from accelerated_evaluation.laws.paper.independent import recorded_counts, recorded_lead_speeds
from accelerated_evaluation.laws.protocol import CutIns, Factors, Law, Stratum
from accelerated_evaluation.laws.smooth.conditional import (
    Places,
    SpeedLaw,
    Threshold,
    range_grid,
    speed_grid,
)
from accelerated_evaluation.laws.smooth.excess import Excess
from accelerated_evaluation.laws.smooth.family import LawFamily, Member
from accelerated_evaluation.laws.smooth.shapes import SHAPES
from accelerated_evaluation.laws.smooth.smooth_hazard import SmoothHazard
from accelerated_evaluation.laws.smooth.support import SUPPORT, Support

COORDINATES = Factors(BoundedExponential(1.0), BoundedExponential(1.0))
TAIL = 0.05  # share of the upper piece of a coordinate: the paper's for the tail of TTC^-1
KNOT = -math.log(TAIL)
# The exponential distribution is memoryless: both pieces have the same rate, wherever it is divided.
CUT = PiecewiseMixture((1 - TAIL, TAIL), (BoundedExponential(1.0, 0.0, KNOT), BoundedExponential(1.0, KNOT)))
PLACES_AT_ONCE = 50_000  # bounds the memory: about 100 MB


@dataclass(frozen=True)
class DependentStratum(Stratum):
    """One segment of the lead speed, with unit-exponential coordinates.

    The first coordinate is -log P(R^-1 > r | v_L), and the second is -log P(C > c | v_L, R) for the closing
    speed C. Each of them increases with its variable. They are independent of each other and of v_L
    (Rosenblatt 1952).
    """

    lead_speed: Empirical
    ranges: SmoothHazard
    speeds: SpeedLaw
    support: Support = SUPPORT
    factors: Factors = COORDINATES

    @property
    def pieces(self) -> Factors:
        """The unit-exponential distributions of the coordinates, each divided at its 95 % quantile."""
        return Factors(CUT, CUT)

    def cut_ins(self, lead_speed: Array, first: Array, second: Array) -> CutIns:
        """Return the cut-ins with given v_L and coordinates."""
        range_, speed = np.empty(first.size), np.empty(first.size)
        for part in _parts(first.size):
            farthest = self.support.range_max
            beside = self._places(lead_speed[part], np.full(first[part].size, farthest))
            range_[part] = farthest * np.exp(-beside.nearer(self.ranges).inverse(first[part]))
            places = self._places(lead_speed[part], range_[part])
            speed[part] = self.speeds.given(places).inverse(second[part])
        return CutIns(lead_speed, 1 / range_, speed / range_)

    def first(self, lead_speed: ArrayLike, inverse_range: ArrayLike) -> Array:
        """Return the coordinate of the range; it is infinite if R^-1 is infinite."""
        speed, inverse_range = np.broadcast_arrays(*_floats(lead_speed, inverse_range))
        coordinate = np.full(speed.shape, math.inf)
        near = np.isfinite(inverse_range)
        logarithm = np.maximum(np.log(self.support.range_max * inverse_range[near]), 0.0)
        coordinate[near] = (
            self._places(speed[near], 1 / inverse_range[near]).nearer(self.ranges).at(logarithm)
        )
        return coordinate

    def second(self, lead_speed: ArrayLike, inverse_range: ArrayLike, closing_speed: ArrayLike) -> Array:
        """Return the coordinate of the closing speed; it is infinite if the closing speed is infinite."""
        arrays = np.broadcast_arrays(*_floats(lead_speed, inverse_range, closing_speed))
        (coordinate,) = self._second_coordinates(*(array.ravel() for array in arrays))
        return coordinate.reshape(arrays[0].shape)

    def closing_speed_probability(
        self, lead_speed: Array, inverse_range: Array, start: Array, end: Array
    ) -> Array:
        """Return P(start <= closing speed < end) for given v_L and R^-1; see `Stratum`."""
        coordinates = self._second_coordinates(lead_speed, inverse_range, start, end)
        return interval_probability(self.factors.second, *coordinates)

    def _second_coordinates(self, lead_speed: Array, inverse_range: Array, *closing_speeds: Array) -> Array:
        """Return the coordinates of several closing speeds at each of n places, shape (speeds, n)."""
        coordinates = np.empty((len(closing_speeds), lead_speed.size))
        for part in _parts(lead_speed.size):
            given = self.speeds.given(self._places(lead_speed[part], 1 / inverse_range[part]))
            for coordinate, closing in zip(coordinates, closing_speeds, strict=True):
                coordinate[part] = given.cumulative(closing[part])
        return coordinates

    def log_first_slope(self, lead_speed: ArrayLike, inverse_range: ArrayLike) -> Array:
        """Return the log of the derivative of the first coordinate by R^-1."""
        speed, inverse_range = np.broadcast_arrays(*_floats(lead_speed, inverse_range))
        logarithm = np.maximum(np.log(self.support.range_max * inverse_range), 0.0)
        rate = self._places(speed, 1 / inverse_range).nearer(self.ranges).rate(logarithm)
        return np.log(rate) - np.log(inverse_range)

    @property
    def inverse_range_min(self) -> float:
        """The smallest R^-1 [1/m], the inverse of the largest recorded range."""
        return 1 / self.support.range_max

    def _places(self, lead_speed: Array, range_: Array) -> Places:
        return Places.of(lead_speed, range_, self.support)


@LAWS.add("dependent")
@dataclass(frozen=True)
class DependentLaw(Law):
    """A law with dependence: v_L as recorded, the range given v_L, and the closing speed given both.

    Attributes
    ----------
    description
        Description of the data to which the law was fitted.
    counts
        Number of lane changes in each segment of v_L, in order of speed. Segments only serve to group
        results: the conditional distributions are the same in all segments.
    ranges
        Smooth hazard of log(R_max / R) given v_L.
    speeds
        Distribution of the closing speed given v_L and R.
    lead_speeds
        The recorded v_L [m/s] by segment. They are read from the encounter table and not stored in the law
        file.
    closing_speed_max
        Cap on closing speeds [m/s]; infinity means no cap.
    support
        Limits of the records to which the law was fitted.
    """

    kind: ClassVar[str] = "dependent"

    description: str
    counts: Mapping[str, int]
    ranges: SmoothHazard = field(compare=False)
    speeds: SpeedLaw = field(compare=False)
    lead_speeds: Mapping[str, Empirical] = field(compare=False)
    closing_speed_max: float = math.inf
    support: Support = SUPPORT

    @classmethod
    def fitted(cls, family: LawFamily, member: Member, encounters: pd.DataFrame, support: Support) -> Self:
        """Return one law of a fitted family; its description is the name of the member.

        Parameters
        ----------
        family, member
            The fitted family, and the member of it.
        encounters
            Encounter table to which the family was fitted; it supplies segments and lead speeds.
        support
            Limits of the records.
        """
        segments = encounters.groupby("segment")["lead_speed"].agg(["min", "size"]).sort_values("min")
        counts = {segment: int(size) for segment, size in segments["size"].items()}
        speeds = recorded_lead_speeds(encounters, counts)
        return cls(member.name, counts, family.ranges, family.law(member), speeds, support=support)

    @property
    def shares(self) -> dict[str, float]:
        """Share of the lane changes that fall into each segment."""
        total = sum(self.counts.values())
        return {segment: count / total for segment, count in self.counts.items()}

    @property
    def strata(self) -> dict[str, DependentStratum]:
        """The distribution in each segment."""
        return {
            segment: DependentStratum(self.lead_speeds[segment], self.ranges, self.speeds, self.support)
            for segment in self.counts
        }

    def only(self, stratum: str) -> Self:
        """Return the law restricted to one segment, whose share is then one."""
        counts, lead_speeds = {stratum: self.counts[stratum]}, {stratum: self.lead_speeds[stratum]}
        return replace(self, counts=counts, lead_speeds=lead_speeds)

    def content(self) -> dict[str, Any]:
        """Return the content of the law file: coefficients of the splines, thresholds and the excess."""
        content = {
            "counts": dict(self.counts),
            "support": self.support.content(),
            "range": {"log_hazard": self.ranges.coefficients.tolist()},
            "closing_speed": {"log_hazard": self.speeds.body.coefficients.tolist()},
        }
        if (tail := self.speeds.tail) is not None:
            content["excess"] = {
                "shape": tail.shape.name,
                "parameters": tail.parameters.tolist(),
                "log_scale": tail.coefficients.tolist(),
                "threshold": {
                    "level": self.speeds.threshold.level,
                    "unit": "m/s",
                    "table": self.speeds.threshold.table.tolist(),
                },
            }
        return content

    @classmethod
    def from_content(
        cls, content: Mapping[str, Any], encounters: pd.DataFrame, description: str, closing_speed_max: float
    ) -> Self:
        """Build the law from the result of `content` and the lead speeds of an encounter table."""
        support = Support.of(content["support"])
        grids = range_grid(support), speed_grid(support)
        ranges, body = (
            SmoothHazard(grid, np.array(content[name]["log_hazard"]))
            for grid, name in zip(grids, ("range", "closing_speed"), strict=True)
        )
        speeds = SpeedLaw(body)
        if "excess" in content:
            tail, threshold = content["excess"], content["excess"]["threshold"]
            surface = Threshold(threshold["level"], *grids[1].edges[:2], np.array(threshold["table"]))
            excess = Excess(SHAPES[tail["shape"]], np.array(tail["log_scale"]), np.array(tail["parameters"]))
            speeds = SpeedLaw(body, surface, excess)
        counts = recorded_counts(content)
        lead_speeds = recorded_lead_speeds(encounters, counts)
        return cls(description, counts, ranges, speeds, lead_speeds, closing_speed_max, support)


def _floats(*arrays: ArrayLike) -> list[Array]:
    return [np.atleast_1d(np.asarray(array, dtype=float)) for array in arrays]


def _parts(size: int) -> list[slice]:
    return [slice(start, start + PLACES_AT_ONCE) for start in range(0, size, PLACES_AT_ONCE)]
