"""Crash maps prepared for smooth laws: the lines on which an event happens, and impact speeds on them.

The splines on the lines and the probabilities of the lead speeds do not depend on the parameters of a law,
and are computed once. For each law, or each draw of its parameters, only the cumulative hazards at the ends
of the intervals have to be computed.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.crash_map.maps import LINES_PER_CELL, CrashMap, Lines
from accelerated_evaluation.laws.protocol import NODE_WEIGHTS, NODES, Law, density_over
from accelerated_evaluation.laws.smooth.conditional import Given, Places, SpeedLaw
from accelerated_evaluation.laws.smooth.draws import SmoothDraws
from accelerated_evaluation.laws.smooth.family import LawFamily, Member
from accelerated_evaluation.laws.smooth.segments import parts
from accelerated_evaluation.laws.smooth.smooth_hazard import SmoothHazard
from accelerated_evaluation.laws.smooth.support import SUPPORT, Support
from accelerated_evaluation.scenarios.events import Event
from accelerated_evaluation.vehicles.protocol import CRASH

STEPS = 200  # number of closing speeds in an interval at which a density is evaluated to draw one of them
AT_ONCE = 1_000_000  # number of closing speeds of which the hazards, with all temporary arrays, need 100 MB
EVEN = 0.05  # share of the kept lines that are selected independently of their probability


@dataclass(frozen=True)
class CrashLines(Lines):
    """Lines of a crash map on which an event happens, with the intervals of closing speeds of the event.

    A line is a pair of lead speed and range. Arrays have shape (lines,) or, for intervals, (intervals,).
    """

    places: Places
    # Probability that the lead speed is in the cell of a line, divided by the number of lines in a cell. If
    # the lines were thinned, it is also divided by the probability that the line was kept.
    share: Array
    farther: Array  # log(R_max / R) at the farther end of the cell
    nearer: Array  # log(R_max / R) at the nearer end; infinite at a range of 0
    row: NDArray[np.int_]  # index of the line of each interval.
    start: Array  # m/s
    end: Array  # m/s; it may be infinite
    # Inner variables of the lines, (lines, variables), for a vehicle whose outcomes are random.
    inner: Array | None = None
    # Weights for draws of the uncertain parameters of the vehicle, (draws, lines).
    weights: Array | None = None

    @classmethod
    def of(
        cls, crash_map: CrashMap, lead_speeds: Array, event: Event = CRASH, support: Support = SUPPORT
    ) -> "CrashLines":
        """Return the lines on which an event happens and whose cells contain recorded lead speeds [m/s]."""
        intervals, shares = crash_map.intervals(event), lead_speed_shares(crash_map, lead_speeds)
        kept = shares[intervals.line // LINES_PER_CELL] > 0
        lines, row = np.unique(intervals.line[kept], return_inverse=True)
        cells = lines // LINES_PER_CELL
        farther, nearer = np.log(support.range_max * crash_map.cells.inverse_range[cells]).T
        return cls(
            Places.of(crash_map.lead_speed[lines], 1 / crash_map.inverse_range[lines], support),
            shares[cells] / LINES_PER_CELL,
            np.maximum(farther, 0.0),
            nearer,
            row,
            intervals.start[kept],
            intervals.end[kept],
            None if crash_map.inner is None else crash_map.inner[lines],
        )

    def masses(self, ranges: SmoothHazard, law: SpeedLaw) -> Array:
        """Return the probability that a cut-in is in each interval, shape (intervals,)."""
        return self._masses(self._line_masses(ranges), law.given(self.places))

    def masses_of(self, family: LawFamily, members: Iterable[Member]) -> Iterator[Array]:
        """Yield the probabilities of the intervals under each member of a family, shape (intervals,).

        The quantities that all members have in common are computed once.
        """
        lines, below = self._line_masses(family.ranges), self.places.body(family.body)
        for member in members:
            yield self._masses(lines, family.law(member).given(self.places, below))

    def masses_of_draws(self, draws: SmoothDraws) -> Array:
        """Return the probability of each interval under each draw of smooth laws, (K, intervals)."""
        masses = np.empty((draws.size, self.row.size))
        for place, (ranges, body) in enumerate(zip(draws.ranges, draws.bodies, strict=True)):
            lines, below = self._line_masses(ranges), self.places.body(body)
            for k in np.flatnonzero(draws.shared == place):
                own = lines if self.weights is None else lines * self.weights[k][self.row]
                masses[k] = self._masses(own, draws.laws[k].given(self.places, below))
        return masses

    def _line_masses(self, ranges: SmoothHazard) -> Array:
        """Return for each interval the probability of the cell of its line, shape (intervals,)."""
        return (self.share * self.range_probability(ranges))[self.row]

    def _masses(self, lines: Array, given: Given) -> Array:
        start = _hazards(given, self.start, self.row)
        # Many intervals end where the next one begins, so the hazard is computed once for both.
        end = np.roll(start, -1)
        end[self._apart] = _hazards(given, self.end[self._apart], self.row[self._apart])
        reached = np.isfinite(start)  # the law may have no probability beyond a finite end
        start, end = start[reached], end[reached]
        masses = np.zeros(self.row.size)
        masses[reached] = lines[reached] * np.exp(-start) * -np.expm1(start - end)
        return masses

    @cached_property
    def _apart(self) -> NDArray[np.int_]:
        """Indices of the intervals that do not end where the next one begins."""
        same = (self.row[:-1] == self.row[1:]) & (self.end[:-1] == self.start[1:])
        return np.flatnonzero(np.append(~same, [True] * min(self.row.size, 1)))

    def range_probability(self, ranges: SmoothHazard) -> Array:
        """Return P(range in the cell of a line | its lead speed), shape (lines,)."""
        cumulative, finite = self.places.range_hazards(ranges), np.isfinite(self.nearer)
        far, near = cumulative.at(self.farther), cumulative.at(np.where(finite, self.nearer, 0.0))
        return np.exp(-far) * np.where(finite, -np.expm1(np.minimum(far - near, 0.0)), 1.0)

    def probability(self, ranges: SmoothHazard, law: SpeedLaw) -> float:
        """Return the probability of the event if cut-ins follow the given conditional distributions.

        The lead speed has the distribution of the recorded lead speeds.
        """
        return float(self.masses(ranges, law).sum())

    def masses_by_density(self, law: Law) -> Array:
        """Return the probability of each interval under a law of cut-ins by its density, shape (intervals,).

        The ranges of a cell have their probability under the law, and the closing speed has its distribution
        at the range of the line, so that the result agrees with that of `masses` for the same law.
        """
        lead_speed, range_ = self.places.lead_speed, self.places.range_
        farthest = np.asarray(law.box.upper[1])
        ends = [np.minimum(farthest, farthest * np.exp(-edge)) for edge in (self.nearer, self.farther)]
        ranges = ends[0] + np.outer(NODES + 1, ends[1] - ends[0]) / 2  # shape (nodes, lines)
        cell = np.zeros(self.share.size)
        for weight, each in zip(NODE_WEIGHTS, ranges, strict=True):
            cell += weight / 2 * (ends[1] - ends[0]) * _over_speeds(law, lead_speed, each)
        start, end = self.start, np.minimum(self.end, law.box.upper[2])
        at_line = _over_speeds(law, lead_speed[self.row], range_[self.row], start, end)
        whole = _over_speeds(law, lead_speed, range_)
        with np.errstate(invalid="ignore", divide="ignore"):
            given = np.where(whole[self.row] > 0, at_line / whole[self.row], 0.0)
        return (self.share * cell)[self.row] * np.where(end > start, given, 0.0)

    def probabilities(self, family: LawFamily, members: Iterable[Member]) -> dict[Member, float]:
        """Return the probability of the event under each of the given members of a fitted family of laws."""
        members = tuple(members)
        masses = self.masses_of(family, members)
        return {member: float(mass.sum()) for member, mass in zip(members, masses, strict=True)}

    def place(self, line: NDArray) -> tuple[Array, Array]:
        """Return the lead speeds [m/s] and ranges [m] of the n lines with the given indices."""
        return self.places.lead_speed[line], self.places.range_[line]

    @property
    def inside(self) -> Array:
        """A cut-in in each interval: lead speed [m/s], range [m] and closing speed [m/s], (intervals, 3)."""
        middle = np.where(np.isfinite(self.end), (self.start + self.end) / 2, self.start + 1.0)
        return np.column_stack([*self.place(self.row), middle])

    def of_draw(self, draw: int) -> "CrashLines":
        """Return the lines for one draw of the uncertain parameters of the vehicle.

        If the lines have weights, the shares of the lines are multiplied by the weights of this draw;
        otherwise the lines are returned unchanged.
        """
        return self if self.weights is None else replace(self, share=self.share * self.weights[draw])

    def of_draws(self, first: int, end: int) -> "CrashLines":
        """Return the lines with the weights, if any, of the draws from ``first`` to before ``end``."""
        return self if self.weights is None else replace(self, weights=self.weights[first:end])

    def thinned(self, mass: Array, size: int, generator: np.random.Generator) -> "CrashLines":
        """Return a systematic sample of about ``size`` lines.

        The selection probability of a line is proportional to its mass plus a small constant. The shares of
        the selected lines are divided by it, so that the probabilities of events are unbiased for any law.
        Their error is small if the probability of the law is distributed similarly to ``mass``. ``mass`` are
        probabilities of the intervals under a law, or their mean under several laws.
        """
        lines = np.bincount(self.row, mass, self.share.size)
        chance = np.minimum(size * ((1 - EVEN) * lines / lines.sum() + EVEN / lines.size), 1.0)
        steps = np.floor(np.cumsum(chance) + generator.random())
        kept = np.flatnonzero(np.diff(steps, prepend=0.0) > 0)
        inside = np.isin(self.row, kept)
        return replace(
            self,
            places=self.places.only(kept),
            share=self.share[kept] / chance[kept],
            farther=self.farther[kept],
            nearer=self.nearer[kept],
            row=np.searchsorted(kept, self.row[inside]),
            start=self.start[inside],
            end=self.end[inside],
            inner=None if self.inner is None else self.inner[kept],
        )


def _hazards(given: Given, speeds: Array, row: NDArray[np.int_]) -> Array:
    """Return the cumulative hazard at each closing speed [m/s] on the line of index ``row``, shape (n,)."""
    hazards = np.empty(len(speeds))
    for part in parts(len(speeds), AT_ONCE):
        hazards[part] = given.cumulative(speeds[part], row[part])
    return hazards


def crash_places(
    lines: CrashLines, masses: Array, law: SpeedLaw | Law, size: int, generator: np.random.Generator
) -> tuple[Array, Array, Array]:
    """Draw lead speeds [m/s], ranges [m] and closing speeds [m/s] of crashes under a law, (size,) each.

    Intervals are drawn with their probabilities ``masses``. Closing speeds in the intervals are drawn by
    inversion, or, if the law has only a density, from its values at `STEPS` closing speeds in the interval.
    """
    interval = generator.choice(masses.size, size, p=masses / masses.sum())
    row, start, end = lines.row[interval], lines.start[interval], lines.end[interval]
    lead_speed, range_ = lines.place(row)
    if hasattr(law, "given"):
        given = law.given(lines.places.only(row))
        start, end = given.cumulative(start), given.cumulative(end)
        level = start - np.log1p(generator.random(size) * np.expm1(start - end))
        return lead_speed, range_, given.inverse(level)
    width = (np.minimum(end, law.box.upper[2]) - start) / STEPS
    speeds = start[:, None] + width[:, None] * (np.arange(STEPS) + generator.random((size, STEPS)))
    x = np.column_stack([np.repeat(lead_speed, STEPS), np.repeat(range_, STEPS), speeds.ravel()])
    density = law.log_density(x).reshape(speeds.shape)
    below = np.cumsum(np.exp(density - density.max(axis=1, keepdims=True)), axis=1)
    chosen = (below < below[:, -1:] * generator.random((size, 1))).sum(axis=1)
    return lead_speed, range_, speeds[np.arange(size), chosen]


def lead_speed_shares(crash_map: CrashMap, lead_speeds: Array) -> Array:
    """Return the share of the recorded lead speeds [m/s] that is in each cell of a map, shape (cells,)."""
    speeds = np.sort(lead_speeds)
    return np.diff(np.searchsorted(speeds, crash_map.cells.lead_speed), axis=1)[:, 0] / speeds.size


def _over_speeds(
    law: Law, lead_speed: Array, range_: Array, start: Array | float = 0.0, end: Array | None = None
) -> Array:
    """Integrate the density of a law over the closing speed from start to end [m/s], shape (n,).

    By default the end is that of the law, whose closing speeds are bounded.
    """
    x = np.column_stack([lead_speed, range_, np.empty(range_.size)])
    low, high = (
        np.broadcast_to(start, range_.shape),
        np.full(range_.size, law.box.upper[2]) if end is None else end,
    )
    return density_over(law, 2, x, low, high)


def divided_at(lines: CrashLines, limits: Iterable[Array]) -> tuple[CrashLines, NDArray[np.intp]]:
    """Cut the intervals of a crash map at limits of the closing speed [m/s], which have shape (lines,) each.

    The index of the original interval of each new one comes with it.
    """
    start, end = lines.start, lines.end
    cuts = [np.clip(limit[lines.row], start, end) for limit in limits]
    edges = np.sort(np.column_stack([start, *cuts, end]), axis=1)
    first, last = edges[:, :-1].ravel(), edges[:, 1:].ravel()
    kept = first < last
    index = np.repeat(np.arange(start.size), len(cuts) + 1)[kept]
    return replace(lines, row=lines.row[index], start=first[kept], end=last[kept]), index
