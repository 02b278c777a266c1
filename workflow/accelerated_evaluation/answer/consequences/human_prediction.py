"""Predict the crashes and near-crashes of human drivers in the distance of the 100-Car study.

The driver is `vehicles.builtin.human.Human`, whose numbers come from publications other than these counts. A
near-crash is an encounter without a crash in which the driver brakes at least as hard as a given
deceleration. The predicted number is the probability of the event in a cut-in times the number of cut-ins in
the distance. Its 90 % limits include the random variation of a count, and the uncertainty in the law of
cut-ins and in the parameters of the drivers.
"""

from collections.abc import Iterable, Iterator, Mapping
from copy import deepcopy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
import scipy
from fewruns.weights import effective_number
from numpy.typing import NDArray
from scipy.special import softmax

from accelerated_evaluation.answer.candidates.law_study import LawStudy
from accelerated_evaluation.answer.consequences.counted_crashes import (
    CUT_IN,
    HUNDRED_CAR_MILES,
    KILOMETRES_PER_MILE,
    STRUCK,
    count_of,
)
from accelerated_evaluation.answer.consequences.in_service import resampled
from accelerated_evaluation.answer.ways.by_map import thinned_lines
from accelerated_evaluation.answer.ways.comparison import RATIO, SAFER, compare
from accelerated_evaluation.answer.ways.posterior import Posterior
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.crash_map.lines import PARTS, CrashLines
from accelerated_evaluation.crash_map.mapping import map_crashes
from accelerated_evaluation.crash_map.maps import Grid
from accelerated_evaluation.laws.draws import Draws
from accelerated_evaluation.laws.smooth.draws import SmoothDraws
from accelerated_evaluation.scenarios import cut_in
from accelerated_evaluation.vehicles.builtin.human import Human
from accelerated_evaluation.vehicles.protocol import CRASH, Outcomes

G = 9.81  # [m/s^2]
# Thresholds [g] of the largest deceleration: an encounter without a crash is a near-crash if it exceeds the
# threshold. Of the drivers in crashes and near-crashes of SHRP 2, which the same institute coded, 99 %
# reached 0.5 g and 90 % reached 0.6 g (`human_population.BRAKING_SHARES`).
SEVERE = {f"near-crash, {level:g} g": level for level in (0.4, 0.5, 0.6)}
MAIN = "near-crash, 0.5 g"
KILOMETRES = 1e6 * HUNDRED_CAR_MILES * KILOMETRES_PER_MILE
COLUMNS = ["driver", "event", "probability", "standard_error", "expected", "low90", "high90", "counted"]
COLUMNS += ["probability_of_so_few", "verdict", "effective_draws", *RATIO, SAFER]
LIMITS = (0.05, 0.95)
# Closing cut-ins per mile if every lane change is a cut-in in front of another vehicle: 0.36 lane changes per
# mile (Lee, Olsen and Wierwille 2004, DOT HS 809 702, abstract), of which 43 of 81 had a closing gap (NGSIM,
# US-101 and I-80).
LANE_CHANGES_A_MILE = 8667 / 23949
CLOSING = 43 / 81
POPULATIONS = 10  # number of populations of drivers that each draw of the law meets
COARSER = 0.5  # resolution of the maps of the variants, relative to that of the main map
VARIANTS: dict[str, dict[str, Any]] = {
    "as it is, one law": {},
    "notices every lane change at a drift of .375 m": {"latest_drift": 0.375},
    "notices every lane change at the crossing": {"earliest_drift": 1.75},
    "brakes only as hard as is needed": {"hard_braking": 100.0},
    "brakes hard from .4 g on": {"hard_braking": 0.4 * G},
    "keeps no margin": {"margin": 0.0},
    "does not swerve": {"swerves": False},
    "responds as to surprise": {"critical_response": 1.3, "calm_response": 1.5},
    "population in the middle of what is not known": {"certain": True},
}

CORRECTED = "corrected by these counts"


@dataclass(frozen=True)
class BrakingHuman:
    """A human driver whose outcomes contain the largest deceleration instead of the impact speed.

    With this driver, a crash map can have severe braking as an event: it is the event that the "impact speed"
    exceeds a threshold. In a crash the deceleration is infinite, so severe braking includes every crash.
    """

    human: Human

    def draw_inner(self, size: int, generator: np.random.Generator) -> Array:
        """Draw the parameters of ``size`` drivers from their distribution, shape (size, parameters)."""
        return self.human.draw_inner(size, generator)

    def inner_weights(self, inner: Array, draws: int, generator: np.random.Generator) -> Array:
        """Return weights of n drivers under draws of the distribution of their parameters, (draws, n).

        The weights have a mean of 1 over the draws.
        """
        return self.human.inner_weights(inner, draws, generator)

    def simulate_given(
        self, lead_speed: Array, range_: Array, closing_speed: Array, inner: Array
    ) -> Outcomes:
        """Simulate n cut-ins with given drivers, one row of ``inner`` (see `draw_inner`) each.

        The impact speed is replaced by the largest deceleration [m/s^2], which is infinite in a crash.
        """
        outcomes, largest = self.human.braking_given(lead_speed, range_, closing_speed, inner)
        return replace(outcomes, impact_speed=np.where(outcomes.crash, np.inf, largest))

    def simulate(self, lead_speed: Array, range_: Array, closing_speed: Array) -> Outcomes:
        """Simulate n cut-ins, each with a randomly drawn driver; see `simulate_given` for the outcomes."""
        return self.simulate_given(lead_speed, range_, closing_speed, self.human.draw_next(len(lead_speed)))


def predictive_limits(means: Array) -> tuple[int, int]:
    """Return the quantiles `LIMITS` of a count that is Poisson with an uncertain mean, given by draws."""
    top = int(scipy.stats.poisson.isf(1e-6, means.max())) + 1
    below = scipy.stats.poisson.cdf(np.arange(top)[:, None], means).mean(axis=1)
    low, high = np.searchsorted(below, LIMITS)
    return int(low), int(high)


def updated_weights(expected: Mapping[str, Array], counted: Mapping[str, int]) -> Array | None:
    """Return the probabilities of equally likely draws after independent Poisson counts, shape (K,).

    The expected counts have the shape (K,). The value is None if the counts are impossible under all draws.
    """
    log_likelihoods = np.sum(
        [scipy.stats.poisson.logpmf(counted[event], means) for event, means in expected.items()], axis=0
    )
    return softmax(log_likelihoods) if np.isfinite(log_likelihoods).any() else None


def error_of_parts(probabilities: Array) -> float:
    """Return the standard error of the sum of probabilities by parts of a map, (2 PARTS,)."""
    first, second = probabilities.reshape(2, PARTS)
    return float(np.sqrt(((first - second) ** 2).sum()))


def compared_with(car: Posterior | None, human: Array, place: NDArray[np.intp]) -> dict[str, float]:
    """Compare a car with a human driver (`comparison.compare`) under draws of the law that were resampled.

    ``human`` is the crash probability of the driver under each draw, shape (m K,), for m populations one
    after the other, and ``place`` the indices of the resampled ones. A draw keeps its pair of probabilities,
    because both follow from the same law.
    """
    if car is None:
        return compare(None, None)
    law = place % car.member.size
    pair = (Posterior(own, car.member[law]) for own in (car.probabilities[law], human[place]))
    return compare(*pair)


@dataclass(frozen=True)
class HumanPrediction:
    """The prediction of crashes and near-crashes of human drivers."""

    study: LawStudy
    grid: Grid
    cut_ins_per_km: float | None  # recorded closing cut-ins [1/km]; None if the distance is unknown
    draws: Draws  # those of the answer
    car: Posterior | None  # crash probability of the car under test under these draws; None if not known
    # For the crash maps: with the generator of the study's maps, the driver has the same map as there.
    of_maps: np.random.Generator
    generator: np.random.Generator  # for all other randomness

    def table(self, counts: pd.DataFrame) -> pd.DataFrame:
        """Tabulate the predicted and the counted numbers of crashes and near-crashes.

        There is a row for each event and driver, or variant of the driver: the ``probability`` of the event
        in a cut-in; the ``expected`` number in the distance of the 100-Car study with 90 % limits of the
        count; the ``counted`` number, the probability of at most so many, and the ``verdict``. Variants are
        computed only with the law of the largest weight, and have no limits.
        """
        counted = {
            "crash": count_of(counts, CUT_IN, "crash"),
            "near-crash": count_of(counts, STRUCK, "near-crash"),
        }
        own = self._own_probabilities()
        probabilities = {event: np.maximum(parts.sum(axis=0), 0.0) for event, parts in own.items()}
        rows = [
            *self._own_rows(probabilities, own, counted),
            *self._corrected_rows(probabilities, counted),
            *self._variant_rows(counted),
        ]
        return pd.DataFrame(rows).reindex(columns=COLUMNS)

    def _lines(
        self, human: Human, near_crashes: Iterable[str], *, finer: float = 1.0
    ) -> dict[str, CrashLines]:
        """Return the lines of a crash map by event; the maps of all drivers use the same random numbers."""
        braking = {event: cut_in.CUT_IN.event("impact_speed", G * SEVERE[event]) for event in near_crashes}
        generator = deepcopy(self.of_maps)
        grid = self.grid.refined(finer)
        crash_map = map_crashes(BrakingHuman(human), grid, braking.values(), generator)
        records = self.study.smooth.records
        return {
            name: CrashLines.of(crash_map, records.lead_speed, event, records.support)
            for name, event in {"crash": CRASH, **braking}.items()
        }

    def _own_probabilities(self) -> dict[str, Array]:
        """Return the probability of each event for the unchanged driver by parts of the map.

        The shape is (2 PARTS, POPULATIONS K): each of the K draws of the law meets several populations.
        """
        human, drawn = Human(), {}
        populations = self.generator.spawn(POPULATIONS)  # the same for all events
        for event, lines in self._lines(human, SEVERE).items():
            kept = thinned_lines(lines, human, self.draws, self.generator)
            masses, every = replace(kept, weights=None).masses(self.draws), np.ones((kept.row.size, 1))
            parts = []
            for each in populations:
                weights = human.inner_weights(np.asarray(kept.inner), self.draws.size, deepcopy(each))
                parts.append(kept.summed(masses * weights[:, kept.row], every)[..., 0])
            drawn[event] = np.hstack(parts)
        crash = drawn.pop("crash")
        return {"crash": crash} | {event: parts - crash for event, parts in drawn.items()}

    def _corrected_rows(self, own: Mapping[str, Array], counted: Mapping[str, int]) -> Iterator[dict]:
        """Yield the rows of the driver under draws that the counts have updated; none without a distance.

        Each draw of the law has populations of its own, which are weighted by the likelihood of both counts.
        The row of crashes compares the car under test with this driver (`compared_with`).
        """
        if self.cut_ins_per_km is None:
            return
        cut_ins = self.cut_ins_per_km * KILOMETRES
        expected = {event: cut_ins * own[event] for event in ("crash", MAIN)}
        weights = updated_weights({event.split(",")[0]: of for event, of in expected.items()}, counted)
        if weights is None:
            return
        place = resampled(own["crash"], weights)
        more = {"crash": compared_with(self.car, own["crash"], place)}
        for event in expected:
            row = self._row(CORRECTED, event, own[event][place], counted) | more.get(event, {})
            yield row | {"effective_draws": float(effective_number(weights))}

    def _own_rows(
        self, events: Mapping[str, Array], parts: Mapping[str, Array], counted: Mapping[str, int]
    ) -> Iterator[dict]:
        """Yield the rows of the unchanged driver, for several definitions of a near-crash."""
        for event, probabilities in events.items():
            error = {"standard_error": error_of_parts(parts[event].mean(axis=1))}
            yield self._row("human", event, probabilities, counted) | error
        if self.cut_ins_per_km is not None:
            more = LANE_CHANGES_A_MILE * CLOSING / (self.cut_ins_per_km * KILOMETRES_PER_MILE)
            for event in ("crash", MAIN):
                yield self._row("with cut-ins from lane changes a mile", event, events[event], counted, more)

    def _row(
        self, driver: str, event: str, probabilities: Array, counted: Mapping[str, int], more: float = 1.0
    ) -> dict:
        """Return a row; there are ``more`` times as many cut-ins in a distance as in the records."""
        seen = counted[event.split(",")[0]]
        row = {"driver": driver, "event": event, "probability": probabilities.mean(), "counted": seen}
        if self.cut_ins_per_km is None:
            return row
        means = more * self.cut_ins_per_km * KILOMETRES * probabilities
        low, high = predictive_limits(means)
        verdict = "too many" if seen < low else "too few" if seen > high else "inside"
        row |= {"expected": means.mean(), "low90": low, "high90": high}
        so_few = float(scipy.stats.poisson.cdf(seen, means).mean())
        return row | {"probability_of_so_few": so_few, "verdict": verdict}

    def _variant_rows(self, counted: Mapping[str, int]) -> Iterator[dict]:
        """Yield the rows of the variants, which are computed with one law and coarser crash maps."""
        smooth = self.study.smooth
        records, speeds = smooth.records, smooth.speeds(self.study.heaviest)
        law = SmoothDraws.of_laws(smooth.family.ranges, [speeds], records.support)
        cut_ins = np.nan if self.cut_ins_per_km is None else self.cut_ins_per_km * KILOMETRES
        for name, parameters in VARIANTS.items():
            lines = self._lines(Human(**parameters), [MAIN], finer=COARSER)
            crash, braked = (
                each.summed(each.masses(law), np.ones((each.row.size, 1))) for each in lines.values()
            )
            for event, parts in {"crash": crash, MAIN: braked - crash}.items():
                value, error = max(float(parts.sum()), 0.0), error_of_parts(parts[:, 0, 0])
                row = {"driver": name, "event": event, "probability": value, "standard_error": error}
                yield row | {"expected": cut_ins * value, "counted": counted[event.split(",")[0]]}
