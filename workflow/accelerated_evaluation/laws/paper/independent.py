"""The paper's law of cut-ins: v_L, R^-1 and TTC^-1 are independent within each segment of v_L."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Self

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws import LAWS
from accelerated_evaluation.laws.distributions import Described, Empirical, from_dict
from accelerated_evaluation.laws.protocol import Box
from accelerated_evaluation.laws.strata import Factors, StratifiedLaw, Stratum

UNITS = {"inverse_range": "1/m", "inverse_ttc": "1/s"}


@dataclass(frozen=True)
class IndependentStratum(Stratum):
    """A segment of the paper's law, whose two coordinates are R^-1 [1/m] and TTC^-1 [1/s]."""

    lead_speed: Empirical
    factors: Factors

    def points(self, lead_speed: Array, first: Array, second: Array) -> Array:
        """Return the cut-ins, shape (n, 3), with given v_L [m/s], R^-1 [1/m] and TTC^-1 [1/s]."""
        return np.column_stack([lead_speed, 1 / first, second / first])

    def first(self, lead_speed: ArrayLike, inverse_range: ArrayLike) -> Array:
        """Return the first coordinate, which is R^-1 [1/m] itself; it does not depend on v_L."""
        return np.asarray(inverse_range)

    def second(self, lead_speed: ArrayLike, inverse_range: ArrayLike, closing_speed: ArrayLike) -> Array:
        """Return the second coordinate TTC^-1 [1/s], which is the closing speed times R^-1."""
        return np.asarray(closing_speed) * inverse_range

    @property
    def range_max(self) -> float:
        """The inverse of the smallest R^-1 in the support of its distribution [m]."""
        lowest = self.factors.first.lower
        return 1 / lowest if lowest > 0 else math.inf


@LAWS.add("independent")
@dataclass(frozen=True)
class IndependentLaw(StratifiedLaw):
    """The paper's law, in which v_L, R^-1 and TTC^-1 are independent within each segment of v_L.

    R^-1 has the same distribution in all segments, and TTC^-1 has one distribution for each segment (paper,
    section VI.A). ValueError is raised if counts, distributions and lead speeds have different segments, or a
    count is not positive.
    """

    kind: ClassVar[str] = "independent"

    description: str
    # Lane changes in each segment, in order of speed; their shares are the weights of the segments.
    counts: Mapping[str, int]
    inverse_range: Described  # of R^-1 [1/m]
    inverse_ttc: Mapping[str, Described]  # of TTC^-1 [1/s], by segment
    # The recorded v_L [m/s] by segment, which are read from the encounter table and not stored in the law
    # file.
    lead_speeds: Mapping[str, Empirical] = field(compare=False)
    closing_speed_max: float = math.inf  # cap on closing speeds [m/s]

    def __post_init__(self) -> None:
        segments = {name: [*part] for name, part in vars(self).items() if isinstance(part, Mapping)}
        if not self.counts or any(set(names) != set(self.counts) for names in segments.values()):
            raise ValueError(f"all parts of a law must have the same segments, got {segments}")
        if not all(isinstance(count, int) and count > 0 for count in self.counts.values()):
            raise ValueError(f"counts must be positive whole numbers, got {dict(self.counts)}")

    @property
    def segments(self) -> tuple[str, ...]:
        """Names of the segments, in order of speed."""
        return tuple(self.counts)

    @property
    def shares(self) -> dict[str, float]:
        """Share of the lane changes in each segment, by name of the segment."""
        total = sum(self.counts.values())
        return {segment: count / total for segment, count in self.counts.items()}

    @property
    def strata(self) -> dict[str, IndependentStratum]:
        """The distribution in each segment, by name of the segment."""
        return {
            segment: IndependentStratum(
                self.lead_speeds[segment], Factors(self.inverse_range, self.inverse_ttc[segment])
            )
            for segment in self.segments
        }

    @property
    def n_parameters(self) -> int:
        """Number of fitted parameters without the knots.

        In table II of the paper it is 18 for the piecewise law and 4 for the single law.
        """
        return self.inverse_range.n_parameters + sum(law.n_parameters for law in self.inverse_ttc.values())

    def only(self, stratum: str) -> Self:
        """Return the law restricted to one segment, given by its name, whose share is then one."""
        parts = {name: {stratum: getattr(self, name)[stratum]} for name in ("counts", "inverse_ttc")}
        return type(self)(
            self.description,
            **parts,
            inverse_range=self.inverse_range,
            lead_speeds={stratum: self.lead_speeds[stratum]},
            closing_speed_max=self.closing_speed_max,
        )

    def content(self) -> dict[str, Any]:
        """Return the content of the law file for JSON: counts, and distributions with their units."""
        laws = {segment: law.to_dict() for segment, law in self.inverse_ttc.items()}
        return {
            "counts": dict(self.counts),
            "inverse_range": {"unit": UNITS["inverse_range"], "distribution": self.inverse_range.to_dict()},
            "inverse_ttc": {"unit": UNITS["inverse_ttc"], "distributions": laws},
        }

    @classmethod
    def from_content(cls, content: Mapping[str, Any], box: Box, records: pd.DataFrame) -> Self:
        """Build a law from the content of its file, its limits, and the records, which supply v_L."""
        counts, laws = content["counts"], content["inverse_ttc"]["distributions"]
        return cls(
            description=content["description"],
            counts=counts,
            inverse_range=from_dict(content["inverse_range"]["distribution"]),
            inverse_ttc={segment: from_dict(law) for segment, law in laws.items()},
            lead_speeds=recorded_lead_speeds(records, counts),
            closing_speed_max=box.upper[2],
        )


def recorded_lead_speeds(encounters: pd.DataFrame, segments: Mapping[str, Any]) -> dict[str, Empirical]:
    """Return the recorded v_L [m/s] of each segment by name; ValueError if a segment has no encounter."""
    speeds = encounters.groupby("segment", observed=True)["lead_speed"]
    missing = [segment for segment in segments if segment not in speeds.groups]
    if missing:
        raise ValueError(f"the encounter table has no rows in segment {', '.join(missing)}")
    return {segment: Empirical(speeds.get_group(segment)) for segment in segments}
