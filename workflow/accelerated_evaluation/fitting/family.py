"""The family of laws that are weighed: tails of several shapes above several thresholds, on one body."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from accelerated_evaluation.distributions.protocol import Array
from accelerated_evaluation.fitting.conditional import (
    PENALTY,
    RANGE_MAX,
    Places,
    SpeedLaw,
    Threshold,
    range_grid,
    speed_grid,
)
from accelerated_evaluation.fitting.excess import Excess, fit_excess
from accelerated_evaluation.fitting.shapes import SHAPES
from accelerated_evaluation.fitting.smooth_hazard import Binned, HazardGrid, SmoothHazard, fit_hazard

LEVELS = (0.9, 0.925, 0.95, 0.97, 0.98, 0.99, 0.995)  # of the thresholds


@dataclass(frozen=True)
class Member:
    """One law of the family: the level of its threshold, and the shape of its excess; the body alone has neither."""

    level: float | None = None
    shape: str = ""

    @property
    def name(self) -> str:
        """How tables call it."""
        return "hazard" if self.level is None else f"{self.shape} {self.level:g}"


def members_at(levels: Sequence[float]) -> tuple[Member, ...]:
    """Return the body alone, and every shape above every threshold."""
    return (Member(), *(Member(level, shape) for shape in SHAPES for level in levels))


MEMBERS = members_at(LEVELS)


@dataclass(frozen=True)
class Events:
    """Distinct cut-ins: lead speed [m/s], range [m] and closing speed [m/s], each of shape (n,)."""

    lead_speed: Array
    range_: Array
    closing_speed: Array

    @property
    def size(self) -> int:
        """Number of events."""
        return self.lead_speed.size

    def only(self, chosen: Array) -> "Events":
        """Return the chosen ones, by index or mask."""
        return Events(self.lead_speed[chosen], self.range_[chosen], self.closing_speed[chosen])


@dataclass(frozen=True)
class Family:
    """Laws above one body, all fitted to the same events, and the law of the range."""

    ranges: SmoothHazard
    body: SmoothHazard
    thresholds: dict[float, Threshold]
    tails: dict[Member, Excess]

    def law(self, member: Member) -> SpeedLaw:
        """Return one of the laws."""
        if member.level is None:
            return SpeedLaw(self.body)
        return SpeedLaw(self.body, self.thresholds[member.level], self.tails[member])


@dataclass(frozen=True)
class Fitter:
    """Events, with what all fits to them need: their bins and splines.

    Attributes
    ----------
    events
        Distinct cut-ins in the order of the record.
    members
        Laws to fit.
    grids
        Of range and closing speed.
    """

    events: Events
    members: tuple[Member, ...] = MEMBERS
    grids: tuple[HazardGrid, HazardGrid] = field(default_factory=lambda: (range_grid(), speed_grid()))
    places: Places = field(init=False)
    binned: tuple[Binned, Binned] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "places", Places.of(self.events.lead_speed, self.events.range_))
        object.__setattr__(self, "binned", self.count(self.events))

    def count(self, events: Events) -> tuple[Binned, Binned]:
        """Bin events: ranges and closing speeds."""
        logarithms = np.log(RANGE_MAX / events.range_)
        return (
            self.grids[0].count(events.lead_speed, np.zeros(events.size), logarithms),
            self.grids[1].count(events.lead_speed, np.sqrt(events.range_), events.closing_speed),
        )

    def fit(self, start: Family | None = None) -> Family:
        """Fit the family to all events; ``start`` is a fit to like events that saves steps.

        Where a start is given, its smoothing parameters are kept.
        """
        ranges, body = (
            fit_hazard(grid, data, start=before)
            for grid, data, before in zip(
                self.grids, self.binned, (start.ranges, start.body) if start else (None, None), strict=True
            )
        )
        levels = sorted({member.level for member in self.members if member.level is not None})
        thresholds = {level: Threshold.of(body, level) for level in levels}
        everything = np.ones(self.events.size, dtype=bool)
        return Family(ranges, body, thresholds, self._tails(thresholds, everything, start))

    def refit(self, family: Family, left_out: Array) -> Family:
        """Fit the laws of the closing speed anew without some events, by index; thresholds and smoothing stay."""
        data = self.binned[1] - self.count(self.events.only(left_out))[1]
        body = fit_hazard(self.grids[1], data, start=family.body)
        kept = np.ones(self.events.size, dtype=bool)
        kept[left_out] = False
        return replace(family, body=body, tails=self._tails(family.thresholds, kept, family))

    def _tails(
        self, thresholds: dict[float, Threshold], kept: Array, start: Family | None
    ) -> dict[Member, Excess]:
        tails = {}
        for level, threshold in thresholds.items():
            excess = self.events.closing_speed - threshold(self.events.lead_speed, self.events.range_)
            above = np.flatnonzero(kept & (excess > 0))
            splines = self.places.splines[above]
            for member in (member for member in self.members if member.level == level):
                before = start.tails[member] if start else None
                tails[member] = fit_excess(excess[above], splines, PENALTY, SHAPES[member.shape], start=before)
        return tails
