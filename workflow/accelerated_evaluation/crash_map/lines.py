"""A crash map made ready to be weighed with smooth laws: lines on which an event happens, and its intervals.

Everything that does not depend on the parameters of a law is found once: the splines on the lines and the
probabilities of the lead speeds. What is left for each law, or each draw of its parameters, is the
cumulative hazard at the ends of intervals.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.crash_map.maps import LINES_PER_CELL, CrashMap
from accelerated_evaluation.laws.smooth.conditional import Places, SpeedLaw
from accelerated_evaluation.laws.smooth.smooth_hazard import SmoothHazard
from accelerated_evaluation.laws.smooth.support import SUPPORT, Support
from accelerated_evaluation.vehicles.events import CRASH, Event

EVEN = 0.05  # of the kept lines are chosen without regard to their mass


@dataclass(frozen=True)
class CrashLines:
    """Lines of a crash map on which an event happens, (lines,), and its intervals, (intervals,).

    Attributes
    ----------
    places
        Lead speeds and ranges of the lines.
    share
        Probability that the lead speed lies in the cell of a line, divided by the lines of a cell, and by the
        probability that the line was kept where lines were thinned.
    farther, nearer
        log(R_max / R) at the two ends of the cell; the second may be infinite.
    row, start, end
        Line of each interval, and its ends [m/s]; the last may be infinite.
    """

    places: Places
    share: Array
    farther: Array
    nearer: Array
    row: NDArray[np.int_]
    start: Array
    end: Array

    @classmethod
    def of(
        cls, crash_map: CrashMap, lead_speeds: Array, event: Event = CRASH, support: Support = SUPPORT
    ) -> "CrashLines":
        """Take from a map the lines on which an event happens and whose lead speeds were recorded.

        Parameters
        ----------
        crash_map
            Of a vehicle.
        lead_speeds
            The recorded ones [m/s], shape (n,).
        event
            One of the map's.
        support
            Limits of the records.
        """
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
        )

    def masses(self, ranges: SmoothHazard, law: SpeedLaw) -> Array:
        """Return the probability of the event in each interval."""
        given = law.given(self.places)
        start, end = given.cumulative(self.start, self.row), given.cumulative(self.end, self.row)
        lines = (self.share * self.range_probability(ranges))[self.row]
        reached = np.isfinite(start)  # a law that ends reaches nothing beyond its end
        start, end = start[reached], end[reached]
        masses = np.zeros(self.row.size)
        masses[reached] = lines[reached] * np.exp(-start) * -np.expm1(start - end)
        return masses

    def range_probability(self, ranges: SmoothHazard) -> Array:
        """Return the probability of the ranges of each line's cell, given its lead speed."""
        cumulative, finite = self.places.nearer(ranges), np.isfinite(self.nearer)
        far, near = cumulative.at(self.farther), cumulative.at(np.where(finite, self.nearer, 0.0))
        return np.exp(-far) * np.where(finite, -np.expm1(np.minimum(far - near, 0.0)), 1.0)

    def probability(self, ranges: SmoothHazard, law: SpeedLaw) -> float:
        """Return the probability of the event."""
        return float(self.masses(ranges, law).sum())

    def thinned(self, mass: Array, size: int, generator: np.random.Generator) -> "CrashLines":
        """Keep about ``size`` lines, more where there is more mass, by systematic sampling.

        The probabilities of any law stay unbiased; their error is small where its mass lies as expected.

        Parameters
        ----------
        mass
            Of the intervals under a law, or the mean of several, that says where to look.
        size
            Number of lines.
        generator
            Starts the systematic sample.
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
        )


def crash_places(
    lines: CrashLines, ranges: SmoothHazard, law: SpeedLaw, size: int, generator: np.random.Generator
) -> tuple[Array, Array, Array]:
    """Draw where a law has its crashes: lead speeds [m/s], ranges [m] and closing speeds [m/s].

    Parameters
    ----------
    lines
        On which crashes happen.
    ranges, law
        Of the range given the lead speed, and of the closing speed given both.
    size
        Number of crashes.
    generator
        Draws them: an interval by its probability, then a closing speed in it by inversion.
    """
    masses = lines.masses(ranges, law)
    interval = generator.choice(masses.size, size, p=masses / masses.sum())
    row = lines.row[interval]
    given = law.given(lines.places.only(row))
    start, end = given.cumulative(lines.start[interval]), given.cumulative(lines.end[interval])
    level = start - np.log1p(generator.random(size) * np.expm1(start - end))
    return lines.places.lead_speed[row], lines.places.range_[row], given.inverse(level)


def lead_speed_shares(crash_map: CrashMap, lead_speeds: Array) -> Array:
    """Return the share of the lead speeds [m/s] in each cell of a map, shape (cells,)."""
    speeds = np.sort(lead_speeds)
    return np.diff(np.searchsorted(speeds, crash_map.cells.lead_speed), axis=1)[:, 0] / speeds.size
