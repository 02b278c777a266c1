"""A law in which the distribution of the closing speed depends smoothly on range and lead speed."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
import pandas as pd

from accelerated_evaluation.base.arrays import Array, numbers_in
from accelerated_evaluation.laws import LAWS
from accelerated_evaluation.laws.distributions import Empirical
from accelerated_evaluation.laws.paper.models import recorded_lead_speeds
from accelerated_evaluation.laws.protocol import Box
from accelerated_evaluation.laws.smooth.conditional import SpeedLaw, Threshold, range_grid, speed_grid
from accelerated_evaluation.laws.smooth.excess import Excess
from accelerated_evaluation.laws.smooth.family import LawFamily, Member
from accelerated_evaluation.laws.smooth.far_tail import FarTail
from accelerated_evaluation.laws.smooth.segments import (
    SmoothLaw,
    SmoothStratum,
    parts,
    recorded_segments,
)
from accelerated_evaluation.laws.smooth.smooth_hazard import SmoothHazard
from accelerated_evaluation.laws.smooth.support import SUPPORT, Support

PLACES_AT_ONCE = 50_000  # limits the memory to about 100 MB


@dataclass(frozen=True)
class DependentStratum(SmoothStratum):
    """One segment of `DependentLaw`: a `Stratum` with unit-exponential coordinates."""

    lead_speed: Empirical
    ranges: SmoothHazard
    speeds: SpeedLaw
    support: Support = SUPPORT

    def points(self, lead_speed: Array, first: Array, second: Array) -> Array:
        """Return the n cut-ins with given v_L [m/s], first and second coordinates, each of shape (n,)."""
        range_, speed = np.empty(first.size), np.empty(first.size)
        for part in parts(first.size, PLACES_AT_ONCE):
            farthest = self.support.range_max
            at_farthest = self.places(lead_speed[part], np.full(first[part].size, farthest))
            range_[part] = farthest * np.exp(-at_farthest.range_hazards(self.ranges).inverse(first[part]))
            places = self.places(lead_speed[part], range_[part])
            speed[part] = self.speeds.given(places).inverse(second[part])
        return np.column_stack([lead_speed, range_, speed])

    def range_coordinate(self, lead_speed: Array, inverse_range: Array) -> tuple[Array, Array]:
        """Return the first coordinate, and its derivative with respect to log(R_max / R).

        The coordinate is the cumulative hazard of log(R_max / R), where R_max is the largest range. The
        arguments are v_L [m/s] and R^-1 [1/m]. Arguments and results have shape (n,).
        """
        hazards = self.places(lead_speed, 1 / inverse_range).range_hazards(self.ranges)
        logarithm = self.logarithm(inverse_range)
        return hazards.at(logarithm), hazards.rate(logarithm)

    def second_at(self, lead_speed: Array, inverse_range: Array, closing_speeds: Array) -> Array:
        """Return the second coordinate of m closing speeds for each of n pairs of v_L and R^-1, (n, m)."""
        coordinates = np.empty(closing_speeds.shape)
        for part in parts(lead_speed.size, PLACES_AT_ONCE):
            given = self.speeds.given(self.places(lead_speed[part], 1 / inverse_range[part]))
            for column, speed in enumerate(closing_speeds[part].T):
                coordinates[part, column] = given.cumulative(speed)
        return coordinates

    def log_second_slope(self, lead_speed: Array, inverse_range: Array, closing_speed: Array) -> Array:
        """Return the log of the derivative of the second coordinate with respect to the closing speed.

        The second coordinate is the cumulative hazard of the closing speed, so its derivative is the hazard.
        The arguments are v_L [m/s], R^-1 [1/m] and closing speed [m/s]. Arguments and result have shape (n,).
        """
        slope = np.empty(lead_speed.size)
        for part in parts(lead_speed.size, PLACES_AT_ONCE):
            given = self.speeds.given(self.places(lead_speed[part], 1 / inverse_range[part]))
            slope[part] = given.log_density(closing_speed[part]) + given.cumulative(closing_speed[part])
        return slope


@LAWS.add("dependent")
@dataclass(frozen=True)
class DependentLaw(SmoothLaw):
    """A law in which v_L is as recorded, the range depends on v_L, and the closing speed on v_L and range."""

    description: str
    # Lane changes by segment, in order of speed; segments only group results, as all have the same
    # conditional distributions.
    counts: Mapping[str, int]
    ranges: SmoothHazard = field(compare=False)  # of log(R_max / R) given v_L
    speeds: SpeedLaw = field(compare=False)  # of the closing speed given v_L and R
    # The recorded v_L [m/s] by segment, which are read from the encounter table and not stored in the law
    # file.
    lead_speeds: Mapping[str, Empirical] = field(compare=False)
    closing_speed_max: float = math.inf  # cap on closing speeds [m/s]
    support: Support = SUPPORT  # limits of the records to which the law was fitted

    @classmethod
    def fitted(cls, family: LawFamily, member: Member, encounters: pd.DataFrame, support: Support) -> Self:
        """Return the law of one member of a family that was fitted to the encounter table.

        Its description is the name of the member.
        """
        counts, lead_speeds = recorded_segments(encounters)
        return cls(member.name, counts, family.ranges, family.law(member), lead_speeds, support=support)

    @property
    def strata(self) -> dict[str, DependentStratum]:
        """The distribution in each segment, by name of the segment."""
        return {
            segment: DependentStratum(self.lead_speeds[segment], self.ranges, self.speeds, self.support)
            for segment in self.counts
        }

    def content(self) -> dict[str, Any]:
        """Return the content of the law file: coefficients of the splines, thresholds and the excess."""
        content = {
            "counts": dict(self.counts),
            "support": self.support.content(),
            "range": {"log_hazard": self.ranges.coefficients.tolist()},
            "closing_speed": {"log_hazard": self.speeds.body.coefficients.tolist()},
        }
        if (tail := self.speeds.tail) is not None:
            content["excess"] = tail.content() | {"threshold": self.speeds.threshold.content()}
        if (far := self.speeds.far) is not None:
            content["far_tail"] = far.content()
        return content

    @classmethod
    def from_content(cls, content: Mapping[str, Any], box: Box, records: pd.DataFrame) -> Self:
        """Build a law from the content of its file, its limits, and the records, which supply v_L."""
        support = Support.of(content["support"])
        grids = range_grid(support), speed_grid(support)
        ranges, body = (
            SmoothHazard(grid, numbers_in(content[name]["log_hazard"]))
            for grid, name in zip(grids, ("range", "closing_speed"), strict=True)
        )
        surface = tail = None
        if (excess := content.get("excess")) is not None:
            surface, tail = Threshold.from_content(excess["threshold"], grids[1]), Excess.from_content(excess)
        far = FarTail.from_content(content["far_tail"]) if "far_tail" in content else None
        speeds = SpeedLaw(body, surface, tail, far)
        counts, description = content["counts"], content["description"]
        lead_speeds = recorded_lead_speeds(records, counts)
        return cls(description, counts, ranges, speeds, lead_speeds, box.upper[2], support)
