"""The crash probability of a cut-in after which the lead vehicle changes its speed.

The probability is a mean over places, lead motions and closing speeds. A place is a lead speed, a range and,
for a random driver, the parameters of the driver. Places and motions are drawn, and the closing speed is
integrated by strata of its distribution at the place, with one simulation in each stratum:

    P = E[ w sum_k m_k 1(crash at c_k) ],

where m_k is the probability of stratum k, c_k a closing speed drawn from it, and w the density of place and
motion under the law divided by the density from which they were drawn. The strata are unit steps of the
cumulative hazard, so the rare and dangerous closing speeds of every place are simulated, too. Behind a lead
vehicle that keeps its speed, the vehicle crashes from some closing speed on. Places are drawn preferentially
where this closing speed, less a few m/s, is probable. Motions are drawn by `laws.motion.draw_wide_inputs`.
The weights are bounded and the draws are independent, so the standard error is that of a mean of independent
terms.

Opening cut-ins are drawn from recorded ones (`opening_cut_ins`). If a study has no records of opening
cut-ins, recorded closing cut-ins with the opposite sign of the closing speed are used.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from fewruns.weights import effective_number
from numpy.typing import NDArray

from accelerated_evaluation.answer.candidates.law_study import LawStudy
from accelerated_evaluation.answer.consequences.opening_cut_ins import opening_terms
from accelerated_evaluation.answer.ways.answer import Replayed
from accelerated_evaluation.answer.ways.posterior import FEWEST
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.crash_map.intervals import Intervals
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.crash_map.maps import CrashMap
from accelerated_evaluation.laws.motion import LARGEST_WEIGHT, LeadMotion, draw_wide_inputs
from accelerated_evaluation.laws.smooth.conditional import SpeedLaw
from accelerated_evaluation.laws.smooth.draws import SmoothDraws
from accelerated_evaluation.laws.smooth.family import DistinctRecords
from accelerated_evaluation.laws.smooth.smooth_hazard import SmoothHazard
from accelerated_evaluation.methods.problem import Problem
from accelerated_evaluation.scenarios.cut_in import CUT_IN, SPEED_LIMIT
from accelerated_evaluation.vehicles.moving import MovingVehicle, simulate_motion, takes_motion
from accelerated_evaluation.vehicles.protocol import (
    CRASH,
    Outcomes,
    RandomVehicle,
    Vehicle,
    inner_of,
    simulate_inner,
)

# [m/s], amounts by which a lead motion may lower the smallest closing speed with a crash; places are drawn
# preferentially for each of them.
SHIFTS = (0.0, 1.5, 4.0, 9.0)
PLACES = 6000  # number of drawn places of closing cut-ins
FEWER = 5  # so many times fewer places are drawn for each resampled law of lead motion
STRATA = 25  # number of strata of the closing speed; the last one has a probability of exp(-24)
AT_ONCE = 20_000  # number of opening cut-ins that are simulated at once, so that 100 MB of memory are enough
RESAMPLED = 20  # number of laws of European lead motion that are fitted to resampled profiles
DRAWS = 500  # number of draws of the law in a study that makes as many simulations as these constants say
ONE_SIDED = 1.645  # number of standard errors up to a one-sided upper 95 % limit
NONE = 3.0  # upper 95 % limit of the mean of a Poisson distribution if the count is 0


@dataclass(frozen=True)
class Means:
    """Estimated crash probabilities with a constant and with a changing lead speed."""

    still: float  # crash probability if the lead vehicle keeps its speed
    moved: float  # crash probability if it changes its speed; NaN if too few crashes were simulated
    covariance: Array  # of the two estimates, (2, 2)
    # One-sided upper 95 % limit of `moved`; with too few crashes, the Poisson limit of a count of 0 for the
    # largest possible weight is added to their mean.
    limit: float

    @classmethod
    def of(cls, terms: Array, largest: float) -> "Means":
        """Return the means of independent terms, shape (2, n), with their covariance.

        The rows are those with a constant and with a changing lead speed, and ``largest`` is the largest
        possible value of a term.
        """
        size = terms.shape[1]
        still, moved = terms.mean(axis=1).tolist()
        covariance = np.cov(terms) / size
        if effective_number(terms[1]) < FEWEST:
            return cls(still, np.nan, covariance, moved + NONE * largest / size)
        return cls(still, moved, covariance, float(moved + ONE_SIDED * np.sqrt(covariance[1, 1])))

    @property
    def errors(self) -> list[float]:
        """Standard errors of ``still`` and ``moved``."""
        return np.sqrt(np.diag(self.covariance)).tolist()

    def together(self, other: "Means", share: float) -> "Means":
        """Return the estimates for cut-ins of two independent kinds, of which the other has this share."""
        own = 1 - share
        return Means(
            own * self.still + share * other.still,
            own * self.moved + share * other.moved,
            own**2 * self.covariance + share**2 * other.covariance,
            own * self.limit + share * other.limit,
        )

    def factor(self) -> tuple[float, float]:
        """Return the ratio ``moved`` / ``still``, and its standard error by linearisation.

        Both are NaN if there was no crash with a constant lead speed.
        """
        if not self.still:
            return np.nan, np.nan
        ratio = self.moved / self.still
        direction = np.array([-ratio, 1.0]) / self.still
        return ratio, float(np.sqrt(direction @ self.covariance @ direction))


@dataclass(frozen=True)
class MovingProblem:
    """A vehicle and a law of cut-ins, whose crash probability is estimated for any law of lead motion.

    What does not depend on the motion, such as the probabilities of the places, is computed once.
    """

    vehicle: MovingVehicle
    crash_map: CrashMap  # for a lead vehicle that keeps its speed
    records: DistinctRecords  # recorded closing cut-ins
    ranges: SmoothHazard  # of the range given the lead speed
    law: SpeedLaw  # of the closing speed given lead speed and range
    effort: float = 1.0  # factor of the numbers of simulations

    @cached_property
    def exact(self) -> float:
        """Crash probability of a closing cut-in with a constant lead speed, from the crash map.

        It is NaN if the map does not explain how many records crash: a regular map misses thin intervals.
        """
        lines = CrashLines.of(self.crash_map, self.records.lead_speed, support=self.records.support)
        exact = float(lines.masses(self._smooth).sum())
        replayed = Replayed.of(Problem(CUT_IN, self.vehicle), self.records.x)
        return exact if replayed.supports(exact) else np.nan

    @property
    def _smooth(self) -> SmoothDraws:
        return SmoothDraws.of_laws(self.ranges, [self.law], self.records.support)

    @cached_property
    def _lines(self) -> CrashLines:
        first = with_first_crashes(self.crash_map)
        return CrashLines.of(first, self.records.lead_speed, support=self.records.support)

    @cached_property
    def _place(self) -> Array:
        """Probability of each line."""
        lines = self._lines
        ends = np.zeros(len(lines.x)), np.full(len(lines.x), np.inf)
        return lines.weight * np.exp(self._smooth.log_slices(2, lines.x, *ends)[0])

    @cached_property
    def _proposals(self) -> list[Array]:
        """Probabilities with which lines are drawn, in equal parts."""
        given = self.law.given(self._lines.places)
        starts = [np.maximum(self._lines.start - shift, 0.0) for shift in SHIFTS]
        proposals = [self._place, *(self._place * np.exp(-given.cumulative(start)) for start in starts)]
        return [each / each.sum() for each in proposals if each.any()]

    def closing(self, motion: LeadMotion, generator: np.random.Generator) -> Means:
        """Estimate the crash probability of a closing cut-in with a constant and a changing lead speed."""
        (found,) = self.closing_with([motion], generator)
        return found

    def closing_with(
        self, motions: Sequence[LeadMotion], generator: np.random.Generator, places: int | None = None
    ) -> list[Means]:
        """Return estimates as those of `closing` for several laws of motion with equally many inputs.

        Lead speeds, ranges and inputs of motions are drawn and weighted; the closing speed is stratified. The
        number of drawn places is by default `PLACES`. All laws of motion have the same draws, so that only
        the simulations with a changing lead speed have to be made for each of them.
        """
        size, lines, place = round(self.effort * (places or PLACES)), self._lines, self._place
        chance = np.mean(self._proposals, axis=0)
        row = generator.choice(chance.size, size, p=chance)
        inputs, weights = draw_wide_inputs(motions[0], size, generator)
        weights *= place[row] / chance[row]
        drawn = lines.places.only(row)
        given, inner = self.law.given(drawn), None if lines.inner is None else lines.inner[row]
        terms = np.zeros((1 + len(motions), size))
        for stratum in range(STRATA):
            least, width = float(stratum), np.inf if stratum == STRATA - 1 else 1.0
            level = least - np.log1p(generator.random(size) * np.expm1(-width))
            # Tails of very few records are so heavy that they have larger speeds than a vehicle accepts.
            closing_speed = np.minimum(given.inverse(level), SPEED_LIMIT)
            cut_ins = np.array([drawn.lead_speed, drawn.range_, closing_speed])
            mass = -np.expm1(-width) * np.exp(-least)
            for term, found in zip(terms, self._outcomes(cut_ins, inputs, inner, motions), strict=True):
                term += mass * found.crash
        largest = LARGEST_WEIGHT * len(self._proposals) * place.sum()
        return [Means.of(weights * terms[[0, which]], largest) for which in range(1, len(terms))]

    def opening(self, recorded: DistinctRecords, motion: LeadMotion, generator: np.random.Generator) -> Means:
        """Estimate the crash probability of an opening cut-in with a constant and a changing lead speed."""
        recorded_cut_ins = np.array([recorded.lead_speed, recorded.range_, recorded.closing_speed])

        def simulate(row: NDArray[np.intp], inputs: Array) -> tuple[Array, Array]:
            crashes, score = np.empty((2, row.size)), np.empty(row.size)
            for part in np.array_split(np.arange(row.size), -(-row.size // AT_ONCE)):
                inner = inner_of(self.vehicle, part.size, generator)
                found = list(self._outcomes(recorded_cut_ins[:, row[part]], inputs[part], inner, [motion]))
                crashes[:, part], score[part] = [each.crash for each in found], CRASH.score(found[1])
            return crashes, score

        concentrates = not isinstance(self.vehicle, RandomVehicle)
        terms, largest = opening_terms(
            simulate, recorded, motion, self.effort, generator, concentrates=concentrates
        )
        return Means.of(terms, largest)

    def _outcomes(
        self, cut_ins: Array, inputs: Array, inner: Array | None, motions: Sequence[LeadMotion]
    ) -> Iterator[Outcomes]:
        """Yield the outcomes of cut-ins with a constant lead speed, and then with each law of motion."""
        yield simulate_inner(self.vehicle, tuple(cut_ins), inner)
        for motion in motions:
            speeds = motion.lead_speeds(cut_ins, inputs)
            yield simulate_motion(self.vehicle, tuple(cut_ins), speeds, inner)


def with_first_crashes(crash_map: CrashMap) -> CrashMap:
    """Return a crash map with one interval on every line, which begins at the first closing speed of a crash.

    The interval has no upper end. If there is no crash on a line, its interval is empty and begins at
    infinity.
    """
    intervals, lines = crash_map.intervals(CRASH), crash_map.lead_speed.size
    first = np.full(lines, np.inf)
    np.minimum.at(first, intervals.line, intervals.start)
    every = Intervals(np.arange(lines, dtype=np.int32), first, np.full(lines, np.inf))
    return replace(crash_map, events={CRASH: every})


def moving_problems(
    vehicles: Mapping[str, Vehicle], maps: Mapping[str, CrashMap], study: LawStudy
) -> dict[str, MovingProblem]:
    """Return the problem of each vehicle under the law of cut-ins with the largest weight.

    Vehicles that cannot be simulated with a changing lead speed are left out. The numbers of simulations are
    in proportion to the draws of the law.
    """
    records, ranges = study.smooth.records, study.smooth.family.ranges
    law, effort = study.smooth.speeds(study.heaviest), len(study.weights) / DRAWS
    return {
        name: MovingProblem(vehicle, maps[name], records, ranges, law, effort)
        for name, vehicle in vehicles.items()
        if takes_motion(vehicle)
    }
