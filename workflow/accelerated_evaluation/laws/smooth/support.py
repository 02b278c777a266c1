"""The limits of the records, within which smooth laws have their splines."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from math import ceil
from typing import Any

import numpy as np

from accelerated_evaluation.laws.smooth.splines import Basis, Penalty

ROOT_MIN = 0.5  # root of the range [m^0.5] below which the splines are constant
RANGE_BOTTOM = 2.5  # [m]; below this range, P(range < r) is proportional to a power of r


@dataclass(frozen=True)
class Support:
    """The limits of the records; the defaults are those of the paper's records."""

    lead_speeds: tuple[float, float] = (5.0, 35.0)  # smallest and largest [m/s]
    range_max: float = 75.0  # m
    closing_top: float = 24.0  # closing speed [m/s] above which the hazard of the body is constant
    # Lead speeds at which segments meet [m/s]; only laws with segments use them.
    segment_edges: tuple[float, ...] = (15.0, 25.0)
    # Number of intervals between knots of the splines of lead speed and of the root of the range.
    splines: tuple[int, int] = (6, 5)

    @classmethod
    def of(cls, content: Mapping[str, Any]) -> "Support":
        """Build the support from the dictionary that `content` returned."""
        return cls(**{name: tuple(v) if isinstance(v, list) else v for name, v in content.items()})

    @classmethod
    def within(
        cls, filters: Mapping[str, Any], closing_speed_max: float, edges: Sequence[float]
    ) -> "Support":
        """Return the limits by filters of records, a closing speed and the edges of segments [m/s]."""
        return cls(
            (float(filters["lead_speed_min"]), float(filters["lead_speed_max"])),
            float(filters["range_max"]),
            float(ceil(closing_speed_max)),
            tuple(float(edge) for edge in edges[1:-1]),
        )

    def content(self) -> dict[str, Any]:
        """Return the limits as a dictionary for a law file."""
        return {
            name: list(value) if isinstance(value, tuple) else value for name, value in asdict(self).items()
        }

    @cached_property
    def bases(self) -> tuple[Basis, Basis]:
        """The spline bases of lead speed and of the square root of the range."""
        along_speed, along_root = self.splines
        ends = ROOT_MIN, float(np.sqrt(self.range_max))
        return Basis(*self.lead_speeds, along_speed), Basis(*ends, along_root)

    @cached_property
    def penalty(self) -> Penalty:
        """The roughness penalty of the coefficients of the tensor product of the two bases."""
        return Penalty.of(self.bases)

    @property
    def log_range_top(self) -> float:
        """The value of log(R_max / R), with the largest range R_max, above which its hazard is constant.

        It is the value at the range R = `RANGE_BOTTOM`, or at R = R_max / 2 if that is smaller.
        """
        return float(np.log(self.range_max / min(RANGE_BOTTOM, self.range_max / 2)))


SUPPORT = Support()
