"""Where the records lie: the ends between which the smooth laws have their splines and bins."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from math import ceil
from typing import Any

import numpy as np

from accelerated_evaluation.laws.smooth.splines import Basis, Penalty

ROOT_MIN = 0.5  # square root of the range below which it has no further effect
RANGE_BOTTOM = 2.5  # [m], range below which its distribution function is a power of the range


@dataclass(frozen=True)
class Support:
    """The limits of the records; by default those of the paper's.

    Attributes
    ----------
    lead_speeds
        Smallest and largest lead speed [m/s].
    range_max
        Largest range [m].
    closing_top
        Closing speed above which the hazard of the body is constant [m/s].
    segment_edges
        Lead speeds between the segments [m/s], of which only the paper's law knows.
    """

    lead_speeds: tuple[float, float] = (5.0, 35.0)
    range_max: float = 75.0
    closing_top: float = 24.0
    segment_edges: tuple[float, ...] = (15.0, 25.0)

    @classmethod
    def of(cls, content: Mapping[str, Any]) -> "Support":
        """Make it from what `content` returned."""
        tuples = {name: tuple(value) for name, value in content.items() if isinstance(value, list)}
        return cls(**content | tuples)

    @classmethod
    def configured(cls, config: Mapping[str, Any]) -> "Support":
        """Return the limits within which a complete configuration keeps records."""
        filters = config["filters"]
        return cls(
            (float(filters["lead_speed_min"]), float(filters["lead_speed_max"])),
            float(filters["range_max"]),
            float(ceil(config["models"]["closing_speed_max"])),
            tuple(float(edge) for edge in config["segments"]["lead_speed_edges"][1:-1]),
        )

    def content(self) -> dict[str, Any]:
        """Return what a file holds of it."""
        return {
            name: list(value) if isinstance(value, tuple) else value for name, value in asdict(self).items()
        }

    @cached_property
    def bases(self) -> tuple[Basis, Basis]:
        """The splines of lead speed and square root of the range."""
        return Basis(*self.lead_speeds, 6), Basis(ROOT_MIN, float(np.sqrt(self.range_max)), 5)

    @cached_property
    def penalty(self) -> Penalty:
        """How rough the coefficients of their products are."""
        return Penalty.of(self.bases)

    @property
    def log_range_top(self) -> float:
        """The log(R_max / R) from which its hazard is constant: at `RANGE_BOTTOM`, or R_max / 2 if less."""
        return float(np.log(self.range_max / min(RANGE_BOTTOM, self.range_max / 2)))


SUPPORT = Support()
