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

Opening cut-ins are drawn from recorded ones, with motions drawn in the same way. If none of a few such
cut-ins crashes, many are drawn without preference, so that the upper limit of the probability is small. If a
study has no records of opening cut-ins, recorded closing cut-ins with the opposite sign of the closing speed
are used.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pandas as pd

from accelerated_evaluation.answer.answer import Replayed
from accelerated_evaluation.answer.law_study import LawStudy
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.crash_map.maps import CrashMap, Intervals
from accelerated_evaluation.laws.motion import LARGEST_WEIGHT, LeadMotion, draw_wide_inputs
from accelerated_evaluation.laws.motion.recorded import Ngsim, Recorded
from accelerated_evaluation.laws.smooth.conditional import SpeedLaw
from accelerated_evaluation.laws.smooth.family import DistinctRecords
from accelerated_evaluation.laws.smooth.smooth_hazard import SmoothHazard
from accelerated_evaluation.methods.problem import Problem
from accelerated_evaluation.scenarios.cut_in import CUT_IN, SPEED_LIMIT
from accelerated_evaluation.vehicles.moving import MovingVehicle, simulate_motion, takes_motion
from accelerated_evaluation.vehicles.protocol import CRASH, RandomVehicle, Vehicle, simulate_inner

# [m/s], amounts by which a lead motion may lower the smallest closing speed with a crash; places are drawn
# preferentially for each of them.
SHIFTS = (0.0, 1.5, 4.0, 9.0)
PLACES = 6000  # number of drawn places of closing cut-ins
FEWER = 5  # so many times fewer places are drawn for each resampled law of lead motion
STRATA = 25  # number of strata of the closing speed; the last one has a probability of exp(-24)
OPENING = 60_000  # number of opening cut-ins that are drawn preferentially at short ranges
PILOT = 20_000  # number of those that decide whether crashes are rare; they are not used otherwise
RARE = 1_000_000  # number of opening cut-ins that are drawn without preference if the pilot has no crash
AT_ONCE = 20_000  # number of opening cut-ins that are simulated at once, so that 100 MB of memory are enough
RESAMPLED = 20  # number of laws of European lead motion that are fitted to resampled profiles
ONE_SIDED = 1.645  # number of standard errors up to a one-sided upper 95 % limit
NONE = 3.0  # upper 95 % limit of the mean of a Poisson distribution if the count is 0


@dataclass(frozen=True)
class Means:
    """Estimated crash probabilities with a constant and with a changing lead speed."""

    still: float  # crash probability if the lead vehicle keeps its speed
    moved: float  # crash probability if it changes its speed
    covariance: Array  # of the two estimates, (2, 2)
    # One-sided upper 95 % limit of `moved`; without a crash, from the Poisson limit of a count of 0 and the
    # largest possible weight.
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
        limit = moved + ONE_SIDED * np.sqrt(covariance[1, 1]) if moved else NONE * largest / size
        return cls(still, moved, covariance, float(limit))

    @property
    def error(self) -> float:
        """Standard error of ``moved``."""
        return float(np.sqrt(self.covariance[1, 1]))

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

    @cached_property
    def exact(self) -> float:
        """Crash probability of a closing cut-in with a constant lead speed, from the crash map.

        It is NaN if the map does not explain how many records crash: a regular map misses thin intervals.
        """
        lines = CrashLines.of(self.crash_map, self.records.lead_speed, support=self.records.support)
        exact = lines.probability(self.ranges, self.law)
        replayed = Replayed.of(Problem(CUT_IN, self.vehicle), self.records.x)
        return exact if replayed.supports(exact) else np.nan

    @cached_property
    def _lines(self) -> CrashLines:
        first = with_first_crashes(self.crash_map)
        return CrashLines.of(first, self.records.lead_speed, support=self.records.support)

    @cached_property
    def _place(self) -> Array:
        """Probability of each line."""
        return self._lines.share * self._lines.range_probability(self.ranges)

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
        size, lines, place = places or PLACES, self._lines, self._place
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
            for term, crash in zip(terms, self._crashes(cut_ins, inputs, inner, motions), strict=True):
                term += mass * crash
        largest = LARGEST_WEIGHT * len(self._proposals) * place.sum()
        return [Means.of(weights * terms[[0, which]], largest) for which in range(1, len(terms))]

    def opening(self, recorded: DistinctRecords, motion: LeadMotion, generator: np.random.Generator) -> Means:
        """Estimate the crash probability of an opening cut-in with a constant and a changing lead speed.

        Recorded cut-ins are drawn with replacement. A pilot decides how. If it has a crash, cut-ins with
        short ranges and rare motions are drawn preferentially, and the terms are weighted. Otherwise
        crashes are so rare that only a limit can be found, and all terms have the same weight, because the
        limit is proportional to the largest weight. The pilot itself is not used, so that there is no bias.
        """
        if self._opening_terms(recorded, motion, PILOT, True, generator).any():
            terms = self._opening_terms(recorded, motion, OPENING, True, generator)
            return Means.of(terms, 2 * LARGEST_WEIGHT)
        return Means.of(self._opening_terms(recorded, motion, RARE, False, generator), 1.0)

    def _opening_terms(
        self,
        recorded: DistinctRecords,
        motion: LeadMotion,
        size: int,
        is_preferred: bool,
        generator: np.random.Generator,
    ) -> Array:
        """Return weighted crashes of drawn opening cut-ins, shape (2, size); see `opening`."""
        nearness, parts = 1 / recorded.range_, []
        chance = np.full(recorded.size, 1 / recorded.size)
        if is_preferred:
            chance = (chance + nearness / nearness.sum()) / 2
        sizes = [part.size for part in np.array_split(np.arange(size), -(-size // AT_ONCE))]
        for count in sizes:
            row = generator.choice(recorded.size, count, p=chance)
            if is_preferred:
                inputs, weights = draw_wide_inputs(motion, count, generator)
            else:
                inputs, weights = generator.random((count, motion.inputs)), np.ones(count)
            inner = np.empty((count, 0))
            if isinstance(self.vehicle, RandomVehicle):
                inner = self.vehicle.draw_inner(count, generator)
            parts.append((row, inputs, weights, inner))
        row, inputs, weights, inner = map(np.concatenate, zip(*parts, strict=True))
        recorded_cut_ins = np.array([recorded.lead_speed, recorded.range_, recorded.closing_speed])
        crashes = np.empty((2, size))
        # In the order of the records, because a law of motion is faster for encounters that are repeated.
        for part in np.array_split(np.argsort(row, kind="stable"), len(sizes)):
            own = inner[part] if inner.shape[1] else None
            drawn = recorded_cut_ins[:, row[part]]
            crashes[:, part] = list(self._crashes(drawn, inputs[part], own, [motion]))
        return weights / (recorded.size * chance[row]) * crashes

    def _crashes(
        self, cut_ins: Array, inputs: Array, inner: Array | None, motions: Sequence[LeadMotion]
    ) -> Iterator[Array]:
        """Yield whether each cut-in crashes with a constant lead speed, and then with each law of motion."""
        yield simulate_inner(self.vehicle, tuple(cut_ins), inner).crash
        for motion in motions:
            speeds = motion.lead_speeds(cut_ins, inputs)
            yield simulate_motion(self.vehicle, tuple(cut_ins), speeds, inner).crash


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


def mirrored(records: DistinctRecords) -> DistinctRecords:
    """Return closing cut-ins with the opposite sign of the closing speed.

    The negative closing speed is limited such that the speed of the host does not become negative.
    """
    return replace(records, closing_speed=np.maximum(-records.closing_speed, -records.lead_speed))


FEWEST = 30  # smallest number of recorded opening cut-ins that are used
COLUMNS = ["vehicle", "gap", "cut_ins", "exact", "constant", "moving", "standard_error", "high95"]
COLUMNS += ["factor", "factor_error", "factor_half"]
# Number of opening cut-ins per closing cut-in, for studies without records of opening cut-ins. In the Safety
# Pilot Model Deployment, 173,692 of 403,581 cut-ins are closing (paper, section II). In NGSIM there are 38
# opening and 43 closing cut-ins.
OPENING_PER_CLOSING = 403_581 / 173_692 - 1


def moving_problems(
    vehicles: Mapping[str, Vehicle], maps: Mapping[str, CrashMap], study: LawStudy
) -> dict[str, MovingProblem]:
    """Return the problem of each vehicle under the law of cut-ins with the largest weight.

    Vehicles that cannot be simulated with a changing lead speed are left out.
    """
    records, ranges = study.smooth.records, study.smooth.family.ranges
    law = study.smooth.speeds(study.heaviest)
    return {
        name: MovingProblem(vehicle, maps[name], records, ranges, law)
        for name, vehicle in vehicles.items()
        if takes_motion(vehicle)
    }


def motion_table(
    problems: Mapping[str, MovingProblem],
    opening: DistinctRecords,
    generator: np.random.Generator,
    motion: LeadMotion | None = None,
    resampled: Sequence[LeadMotion] = (),
) -> pd.DataFrame:
    """Tabulate the crash probabilities of vehicles if the lead vehicle changes its speed.

    ``motion`` is the law of lead motion, by default `Ngsim`, and ``resampled`` are the laws that are fitted
    to resampled profiles of speed. All vehicles and resampled laws get the same random numbers. If there are
    fewer than `FEWEST` opening cut-ins, closing ones with the opposite sign of the closing speed are used
    instead. The row of a vehicle and kind of cut-in (``gap``) has the crash probability with a constant lead
    speed, ``exact`` (from the crash map, only for closing cut-ins, see `MovingProblem.exact`) and
    ``constant`` (estimated); with a changing lead speed, ``moving``;
    ``factor``, moving divided by constant; and ``factor_half``, the factor if all changes of speed are
    halved, which is known for `Ngsim` only. ``factor_error`` is the standard error of the factor. It contains
    the error of the simulation and, for closing cut-ins, the spread of the factors of the resampled laws.
    """
    rows = []
    for name, problem in problems.items():
        records = problem.records
        has_opening = opening.size >= FEWEST
        ratio = opening.size / records.size if has_opening else OPENING_PER_CLOSING
        share, recorded = ratio / (1 + ratio), opening if has_opening else mirrored(records)
        exacts = {"closing": problem.exact}
        wholes = _kinds(problem, motion or Ngsim(), recorded, share, deepcopy(generator))
        halves = {}
        if motion is None:
            halves = _kinds(problem, Ngsim(0.5), recorded, share, deepcopy(generator))
        fewer = PLACES // FEWER  # the spread of the factors is larger than their errors
        spread = problem.closing_with(resampled, deepcopy(generator), fewer) if resampled else []
        factors = [each.factor()[0] for each in spread]
        cut_ins = {"closing": 1 - share, "opening": share, "all": 1.0}
        for gap, found in wholes.items():
            own = cut_ins[gap], exacts.get(gap, np.nan), found.still, found.moved, found.error, found.limit
            factor, error = found.factor()
            if factors and gap == "closing":
                error = float(np.hypot(error, np.std(factors, ddof=1)))
            half = halves[gap].factor()[0] if gap in halves else np.nan
            rows.append((name, gap, *own, factor, error, half))
    return pd.DataFrame(rows, columns=COLUMNS)


def _kinds(
    problem: MovingProblem,
    motion: LeadMotion,
    recorded: DistinctRecords,
    share: float,
    generator: np.random.Generator,
) -> dict[str, Means]:
    """Return the estimates for closing, opening and all cut-ins."""
    closing = problem.closing(motion, generator)
    opening = problem.opening(recorded, motion, generator)
    return {"closing": closing, "opening": opening, "all": closing.together(opening, share)}


MOTION = "what the other car does next"


def motion_budget(moving: pd.DataFrame, vehicle: str, together: float) -> pd.DataFrame:
    """Return the contribution of the unknown lead motion to the budget of the answer.

    Lead motion multiplies the crash probability by a factor. The law of motion was fitted to all cars. It is
    not known whether cars that have just changed lane change their speed as much as other cars. The changes
    of speed are therefore multiplied by a scale that is uniform from 0 to 1. The logarithm of the factor, as
    a function of the scale, is interpolated by a parabola through its values at 0, 1/2 and 1. Its variance is
    the contribution. ``together`` is the factor, exp(standard deviation of the log probability), of all other
    sources together. The ``variance_share`` is relative to their variance, and ``effect`` is the factor of
    the probability for the scale 1. There is no row if the vehicle is not in the table or never crashes.
    """
    own = moving[(moving["vehicle"] == vehicle) & (moving["gap"] == "closing")]
    own = own[(own["factor"] > 0) & (own["factor_half"] > 0)]
    half, whole = (np.log(own[name].astype(float)) for name in ("factor_half", "factor"))
    slope, bend = 4 * half - whole, 2 * whole - 4 * half
    # For a uniform variable s on [0, 1]: var(s) = 1/12, var(s^2) = 4/45, cov(s, s^2) = 1/12.
    variance = (
        slope**2 / 12 + slope * bend / 6 + 4 * bend**2 / 45 + (own["factor_error"] / own["factor"]) ** 2
    )
    return pd.DataFrame(
        {
            "source": MOTION,
            "factor": np.exp(np.sqrt(variance)),
            "variance_share": variance / np.log(together) ** 2,
            "effect": own["factor"],
        }
    )


def motion_tables(
    vehicles: Mapping[str, Vehicle],
    maps: Mapping[str, CrashMap],
    study: LawStudy,
    opening: DistinctRecords,
    europe: Recorded,
    generators: Callable[..., np.random.Generator],
) -> dict[str, pd.DataFrame]:
    """Return the table of `motion_table` with American and with European lead motion, by name.

    The error of the European motion is that of laws fitted to resampled profiles. ``generators`` returns a
    generator for the names of a step.
    """
    stream = generators("resampled profiles")
    resampled = [europe.resampled(stream) for _ in range(RESAMPLED)]
    problems = moving_problems(vehicles, maps, study)
    tables = {
        name: motion_table(problems, opening, generators(), *motion)
        for name, motion in {"NGSIM": (), "Europe": (europe, resampled)}.items()
    }
    return {
        name: table.assign(vehicle=table["vehicle"].replace("under_test", "under test"))
        for name, table in tables.items()
    }
