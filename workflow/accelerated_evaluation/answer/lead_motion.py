"""What the other car does next: the crash probability if the lead vehicle changes its speed.

The probability is a mean over places (lead speed, range and, for a driver who never repeats itself, the
driver), lead motions and closing speeds. Places and motions are drawn, and the closing speed is integrated by
strata of its distribution at the place, with one simulation in each stratum:

    P = E[ w sum_k m_k 1(crash at c_k) ],

where m_k is the probability of stratum k, c_k a closing speed drawn from it, and w the density of place and
motion under the law divided by the density from which they were drawn. The strata are unit steps of the
cumulative hazard, so that the rare and dangerous closing speeds of every place are simulated, too. Places are
drawn preferentially where the smallest closing speed that crashes behind a constant lead vehicle, less a few
m/s, is probable; motions are drawn as by `laws.motion.draw_wide`. The weights are bounded, the draws are
independent, and the standard error is that of a mean of independent terms.

Cut-ins whose gap opens are drawn from recorded ones, with motions drawn in the same way. If a study has no
records of them, they are recorded closing cut-ins whose closing speed has the other sign.
"""

from dataclasses import dataclass, replace

import numpy as np

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.crash_map.maps import CrashMap, Intervals
from accelerated_evaluation.laws.motion import LARGEST_WEIGHT, LeadMotion, draw_wide
from accelerated_evaluation.laws.smooth.conditional import SpeedLaw
from accelerated_evaluation.laws.smooth.family import DistinctRecords
from accelerated_evaluation.laws.smooth.smooth_hazard import SmoothHazard
from accelerated_evaluation.vehicles.events import CRASH
from accelerated_evaluation.vehicles.moving import MovingVehicle, simulate_motion
from accelerated_evaluation.vehicles.protocol import RandomVehicle, simulate_inner

# [m/s], by which a motion may lower the smallest closing speed that crashes, for the choice of places.
SHIFTS = (0.0, 1.5, 4.0, 9.0)
PLACES = 6000
STRATA = 25  # of the closing speed; the last one has a probability of exp(-24)
OPENING = 60_000
AT_ONCE = 20_000  # bounds the memory: 100 MB
ONE_SIDED = 1.645  # standard errors up to an upper 95 % limit
NONE = 3.0  # upper 95 % limit of the mean of a Poisson count of zero


@dataclass(frozen=True)
class Means:
    """Crash probabilities that were estimated from independent terms.

    Attributes
    ----------
    still, moved
        With a lead vehicle that keeps its speed, and with one that changes it.
    covariance
        Covariance matrix of the two estimates, shape (2, 2).
    limit
        Upper 95 % limit of ``moved``. If no lead vehicle that changes its speed caused a crash, this is the
        exact limit for draws whose weights are bounded.
    """

    still: float
    moved: float
    covariance: Array
    limit: float

    @classmethod
    def of(cls, terms: Array, largest: float) -> "Means":
        """Return the means of ``terms``, shape (2, n), none of which can exceed ``largest``."""
        size = terms.shape[1]
        still, moved = terms.mean(axis=1).tolist()
        covariance = np.cov(terms) / size
        limit = moved + ONE_SIDED * np.sqrt(covariance[1, 1]) if moved else NONE * largest / size
        return cls(still, moved, covariance, float(limit))

    @property
    def error(self) -> float:
        """Standard error of ``moved``."""
        return float(np.sqrt(self.covariance[1, 1]))

    def together(self, other: "Means", share: float) -> "Means":
        """Return the estimates for all cut-ins if the other kind of cut-in has a share of them."""
        own = 1 - share
        return Means(
            own * self.still + share * other.still,
            own * self.moved + share * other.moved,
            own**2 * self.covariance + share**2 * other.covariance,
            own * self.limit + share * other.limit,
        )

    def factor(self) -> tuple[float, float]:
        """Return moved divided by still, and its standard error by linearisation; NaN without crashes."""
        if not self.still:
            return np.nan, np.nan
        ratio = self.moved / self.still
        direction = np.array([-ratio, 1.0]) / self.still
        return ratio, float(np.sqrt(direction @ self.covariance @ direction))


@dataclass(frozen=True)
class MovingProblem:
    """The question how often a vehicle crashes if the lead vehicle changes its speed.

    Attributes
    ----------
    vehicle
        The vehicle.
    crash_map
        Its map for a lead vehicle that keeps its speed.
    records
        Recorded closing cut-ins.
    ranges, law
        Distribution of the range given the lead speed, and of the closing speed given both.
    motion
        The law of lead motion.
    """

    vehicle: MovingVehicle
    crash_map: CrashMap
    records: DistinctRecords
    ranges: SmoothHazard
    law: SpeedLaw
    motion: LeadMotion

    def closing(self, generator: np.random.Generator) -> Means:
        """Return the crash probability of a cut-in whose gap closes."""
        records = self.records
        lines = CrashLines.of(with_first_crashes(self.crash_map), records.lead_speed, support=records.support)
        given = self.law.given(lines.places)
        place = lines.share * lines.range_probability(self.ranges)
        starts = [np.maximum(lines.start - shift, 0.0) for shift in SHIFTS]
        proposals = [place, *(place * np.exp(-given.cumulative(start)) for start in starts)]
        proposals = [each / each.sum() for each in proposals if each.any()]
        chance = np.mean(proposals, axis=0)
        row = generator.choice(chance.size, PLACES, p=chance)
        inputs, weights = draw_wide(self.motion, PLACES, generator)
        weights *= place[row] / chance[row]
        places = lines.places.only(row)
        given, inner = self.law.given(places), None if lines.inner is None else lines.inner[row]
        terms = np.zeros((2, PLACES))
        for stratum in range(STRATA):
            least, width = float(stratum), np.inf if stratum == STRATA - 1 else 1.0
            level = least - np.log1p(generator.random(PLACES) * np.expm1(-width))
            cut_ins = np.array([places.lead_speed, places.range_, given.inverse(level)])
            terms += -np.expm1(-width) * np.exp(-least) * self._crashes(cut_ins, inputs, inner)
        return Means.of(weights * terms, LARGEST_WEIGHT * len(proposals) * place.sum())

    def opening(self, recorded: DistinctRecords, generator: np.random.Generator) -> Means:
        """Return the crash probability of a cut-in whose gap opens, drawn from recorded ones.

        Short ranges are drawn more often than they were recorded.
        """
        nearness = 1 / recorded.range_
        chance = (1 / recorded.size + nearness / nearness.sum()) / 2
        row = generator.choice(recorded.size, OPENING, p=chance)
        inputs, weights = draw_wide(self.motion, OPENING, generator)
        weights /= recorded.size * chance[row]
        inner = None
        if isinstance(self.vehicle, RandomVehicle):
            inner = self.vehicle.draw_inner(OPENING, generator)
        parts = []
        for part in np.array_split(np.arange(OPENING), -(-OPENING // AT_ONCE)):
            chosen = row[part]
            columns = recorded.lead_speed, recorded.range_, recorded.closing_speed
            cut_ins = np.array([column[chosen] for column in columns])
            parts.append(self._crashes(cut_ins, inputs[part], None if inner is None else inner[part]))
        return Means.of(weights * np.hstack(parts), 2 * LARGEST_WEIGHT)

    def _crashes(self, cut_ins: Array, inputs: Array, inner: Array | None) -> Array:
        """Return whether cut-ins, shape (3, n), crash with a constant and a changing lead speed, (2, n)."""
        speeds = self.motion.lead_speeds(cut_ins, inputs)
        still = simulate_inner(self.vehicle, tuple(cut_ins), inner)
        return np.array([still.crash, simulate_motion(self.vehicle, tuple(cut_ins), speeds, inner).crash])


def with_first_crashes(crash_map: CrashMap) -> CrashMap:
    """Return a map with one interval on every line, from the smallest closing speed that crashes up.

    The interval is empty, and begins at infinity, if the line has no crash.
    """
    intervals, lines = crash_map.intervals(CRASH), crash_map.lead_speed.size
    first = np.full(lines, np.inf)
    np.minimum.at(first, intervals.line, intervals.start)
    every = Intervals(np.arange(lines, dtype=np.int32), first, np.full(lines, np.inf))
    return replace(crash_map, events={CRASH: every})


def mirrored(records: DistinctRecords) -> DistinctRecords:
    """Return closing cut-ins whose closing speed has the other sign, as far as the host drives forwards."""
    return replace(records, closing_speed=np.maximum(-records.closing_speed, -records.lead_speed))
