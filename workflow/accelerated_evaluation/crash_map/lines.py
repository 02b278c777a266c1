"""Crash maps prepared for smooth laws: the lines on which an event happens, and impact speeds on them.

A line represents the cut-ins with its lead speed and its range, by the density with which it was drawn. The
probability of an interval under any law is the weight of its line times the integral of the density of the
law along the line.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.crash_map.maps import LINES_PER_CELL, CrashMap, Lines
from accelerated_evaluation.laws.protocol import Law
from accelerated_evaluation.laws.smooth.conditional import Places, SpeedLaw
from accelerated_evaluation.laws.smooth.support import SUPPORT, Support
from accelerated_evaluation.scenarios.events import Event
from accelerated_evaluation.vehicles.protocol import CRASH

STEPS = 200  # number of closing speeds in an interval at which a density is evaluated to draw one of them
AT_ONCE = 20_000  # number of intervals whose probabilities are computed at once
PARTS = 16  # number of parts of a map, a power of 2; each has two halves
EVEN = 0.05  # share of the kept lines that are selected independently of their probability


@dataclass(frozen=True)
class CrashLines(Lines):
    """Lines of a crash map on which an event happens, with the intervals of closing speeds of the event.

    A line is a pair of lead speed and range. Arrays have shape (lines,) or, for intervals, (intervals,).
    """

    places: Places
    # Probability that the lead speed is in the cell of a line, times the width of the cell's ranges [m] per
    # line, that is divided by the density with which the range of the line was drawn, times the weight of the
    # inner variables. If the lines were thinned, it is also divided by the probability of being kept.
    weight: Array
    row: NDArray[np.int_]  # index of the line of each interval.
    start: Array  # m/s
    end: Array  # m/s; it may be infinite
    # Inner variables of the lines, (lines, variables), for a vehicle whose outcomes are random.
    inner: Array | None = None
    part: NDArray[np.int_] | None = None  # of the map, in which a line is, for a random vehicle; see `summed`
    # Weights for draws of the uncertain parameters of the vehicle, (draws, lines).
    weights: Array | None = None

    @classmethod
    def of(
        cls, crash_map: CrashMap, lead_speeds: Array, event: Event = CRASH, support: Support = SUPPORT
    ) -> "CrashLines":
        """Return the lines on which an event happens and whose cells contain recorded lead speeds [m/s]."""
        intervals, shares = crash_map.intervals(event), lead_speed_shares(crash_map, lead_speeds)
        kept = shares[intervals.line // LINES_PER_CELL] > 0
        line = intervals.line[kept]
        lines = np.unique(line)
        cells, range_ = lines // LINES_PER_CELL, 1 / crash_map.inverse_range[lines]
        # The square root of the range is uniform in the cell.
        width = -np.diff(crash_map.cells.root[cells])[:, 0] * 2 * np.sqrt(crash_map.cells.range_max * range_)
        return cls(
            Places.of(crash_map.lead_speed[lines], range_, support),
            crash_map.weights[lines] * shares[cells] * width / LINES_PER_CELL,
            np.searchsorted(lines, line),
            intervals.start[kept],
            intervals.end[kept],
            None if crash_map.inner is None else crash_map.inner[lines],
            None if crash_map.inner is None else lines % LINES_PER_CELL * PARTS + cells % PARTS,
        )

    def masses(self, draws: Any) -> Array:  # noqa: ANN401
        """Return the probability of each interval under each draw, (K, intervals); see `Draws.log_slices`.

        On each line, the density of the law at the range of the line is integrated over the closing speed. It
        has no cap: impact speeds differ between closing speeds at which every vehicle crashes.
        """
        draws, x = draws.with_cap_at(math.inf), self.x
        masses = np.empty((draws.size, self.row.size))  # filled in parts, which need little memory besides
        for first in range(0, self.row.size, AT_ONCE):
            part = slice(first, first + AT_ONCE)
            row, mass = self.row[part], masses[:, part]
            np.exp(draws.log_slices(2, x[row], self.start[part], self.end[part]), out=mass)
            mass *= self.weight[row]
            if self.weights is not None:
                mass *= self.weights[:, row]
        return masses

    @property
    def x(self) -> Array:
        """The lines as cut-ins whose closing speed is not known, shape (lines, 3)."""
        unknown = np.full(self.weight.size, np.nan)
        return np.column_stack([self.places.lead_speed, self.places.range_, unknown])

    def place(self, line: NDArray) -> tuple[Array, Array]:
        """Return the lead speeds [m/s] and ranges [m] of the n lines with the given indices."""
        return self.places.lead_speed[line], self.places.range_[line]

    @property
    def inside(self) -> Array:
        """A cut-in in each interval: lead speed [m/s], range [m] and closing speed [m/s], (intervals, 3)."""
        middle = np.where(np.isfinite(self.end), (self.start + self.end) / 2, self.start + 1.0)
        return np.column_stack([*self.place(self.row), middle])

    def below(self, largest: Callable[[int, Array], Array]) -> "CrashLines":
        """Return the lines with intervals that end at the largest closing speeds at the latest.

        ``largest`` returns them [m/s] for the index of the variable and cut-ins of shape (n, 3). An interval
        above the largest closing speed remains, without any width.
        """
        end = np.maximum(largest(2, self.inside), 0.0)
        return replace(self, start=np.minimum(self.start, end), end=np.minimum(self.end, end))

    def thinned(self, mass: Array, size: int, generator: np.random.Generator) -> "CrashLines":
        """Return a systematic sample of about ``size`` lines.

        The selection probability of a line is proportional to its mass plus a small constant. The weights of
        the selected lines are divided by it, so that the probabilities of events are unbiased for any law.
        Their error is small if the probability of the law is distributed similarly to ``mass``, the
        probabilities of the lines under a law, or their mean under several laws.
        """
        kept, chance = _kept(mass, size, generator, self.part)
        inside = np.isin(self.row, kept)
        row = np.searchsorted(kept, self.row[inside])
        return self._only(kept, chance, row=row, start=self.start[inside], end=self.end[inside])

    def thinned_intervals(self, mass: Array, size: int, generator: np.random.Generator) -> "CrashLines":
        """Return a systematic sample of about ``size`` intervals, each on a line of its own; see `thinned`.

        It is for maps with random closing speeds, whose lines have many narrow intervals each.
        """
        kept, chance = _kept(mass, size, generator, None if self.part is None else self.part[self.row])
        row = np.arange(kept.size)
        return self._only(self.row[kept], chance, row=row, start=self.start[kept], end=self.end[kept])

    def _only(self, kept: NDArray[np.intp], chance: Array, **intervals: NDArray) -> "CrashLines":
        """Return the lines that were kept with these probabilities, with the given intervals."""
        own: dict[str, Any] = {"places": self.places.only(kept), "weight": self.weight[kept] / chance}
        if self.inner is not None and self.part is not None:
            own |= {"inner": self.inner[kept], "part": self.part[kept]}
        return replace(self, **own | intervals)

    def summed(self, masses: Array, values: Array) -> Array:
        """Return the sums of masses, (K, intervals), times values, (intervals, m), over parts of the map.

        The shape is (2 PARTS, K, m). The halves of a part are `PARTS` places apart and have the same expected
        value. So the error of the sum of all parts can be estimated from the differences of the halves. They
        have the second and the first lines of cells for a random vehicle, and otherwise neighbours among the
        lines, whose differences overstate the error.
        """
        neighbours = self.row % 2 * PARTS + self.row // 2 % PARTS
        part = neighbours if self.part is None else self.part[self.row]
        return np.stack([masses[:, part == k] @ values[part == k] for k in range(2 * PARTS)])


def _kept(
    mass: Array, size: int, generator: np.random.Generator, part: NDArray[np.int_] | None
) -> tuple[NDArray[np.intp], Array]:
    """Return the indices of a systematic sample, nearly in proportion to mass, and their probabilities.

    The parts of the map, if any, follow each other, so that each keeps its share of the mass.
    """
    order = np.arange(mass.size) if part is None else np.argsort(part, kind="stable")
    chance = np.minimum(size * ((1 - EVEN) * mass / mass.sum() + EVEN / mass.size), 1.0)
    steps = np.cumsum(chance[order]) + generator.random()
    # The indices at which the sum reaches a whole number. Rounding may let it reach two at the same index.
    kept = np.unique(order[np.searchsorted(steps, np.arange(1, np.floor(steps[-1]) + 1))])
    return kept, chance[kept]


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
