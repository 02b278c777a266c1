"""Predict the crashes and near-crashes of human drivers in the distance of the 100-Car study.

The driver is `vehicles.builtin.human.Human`, whose numbers come from publications other than these counts. A
near-crash is an encounter without a crash in which the driver brakes at least as hard as a given deceleration.
The predicted number is the probability of a cut-in times the number of cut-ins in the distance. Its 90 % limits
contain the chance of a count, and what is not known of the law of cut-ins and of the drivers.
"""

from collections.abc import Iterator
from copy import deepcopy
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.stats import poisson

from accelerated_evaluation.answer.counted_crashes import (
    CUT_IN,
    HUNDRED_CAR_MILES,
    KILOMETRES_PER_MILE,
    STRUCK,
    count_of,
)
from accelerated_evaluation.answer.posterior import draw_posterior
from accelerated_evaluation.answer.study import with_draws
from accelerated_evaluation.answer.weighted_family import ScoredFamily, WeightedLaws
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.crash_map.mapping import map_crashes
from accelerated_evaluation.crash_map.maps import Grid
from accelerated_evaluation.vehicles.builtin.human import Human
from accelerated_evaluation.vehicles.protocol import Outcomes

G = 9.81  # [m/s^2]
SEVERE = 0.5  # [g]; of the drivers in near-crashes of SHRP 2, 99 % braked harder; see `human_population`
OTHERS = (0.4, 0.6)  # [g]
LIMITS = (0.05, 0.95)
POINTS = 60  # of the scan of a line: a driver who crashes also crashes at larger closing speeds
# Closing cut-ins per mile if every lane change is one in front of somebody: .36 lane changes a mile (Lee, Olsen
# and Wierwille 2004, DOT HS 809 702, abstract), of which 43 of 81 closed in (NGSIM, US-101 and I-80).
LANE_CHANGES_A_MILE = 8667 / 23949
CLOSING = 43 / 81
# What the variants change, by the name of the part of the driver that they concern.
VARIANTS = {
    "notices all lane changes at a drift of .375 m": {"latest_drift": 0.375},
    "notices all lane changes at the crossing": {"earliest_drift": 1.75},
    "brakes only as hard as is needed": {"hard_braking": 100.0},
    "brakes hard from .4 g on": {"hard_braking": 0.4 * G},
    "has no margin": {"margin": 0.0},
    "responds as to surprise": {"critical_response": 1.3, "calm_response": 1.5},
    "is known exactly": {"certain": True},
}


@dataclass(frozen=True)
class SevereHuman:
    """A human driver for whom severe braking counts as a crash, so that a crash map can be made of it.

    Attributes
    ----------
    human
        The driver.
    deceleration
        From which braking is severe [g]; infinity for crashes alone.
    """

    human: Human
    deceleration: float

    def draw_inner(self, size: int, generator: np.random.Generator) -> Array:
        """Draw drivers; see `RandomVehicle`."""
        return self.human.draw_inner(size, generator)

    def inner_weights(self, inner: Array, draws: int, generator: np.random.Generator) -> Array:
        """Return weights of drivers; see `RandomVehicle`."""
        return self.human.inner_weights(inner, draws, generator)

    def simulate_given(
        self, lead_speed: Array, range_: Array, closing_speed: Array, inner: Array
    ) -> Outcomes:
        """Simulate cut-ins with given drivers; ``crash`` is a crash or severe braking."""
        outcomes = self.human.simulate_given(lead_speed, range_, closing_speed, inner)
        severe = self.human.severe(
            np.array([lead_speed, range_, closing_speed]), inner, G * self.deceleration
        )
        return Outcomes(severe, outcomes.min_range, outcomes.min_ttc, outcomes.impact_speed)

    def simulate(self, lead_speed: Array, range_: Array, closing_speed: Array) -> Outcomes:
        """Simulate cut-ins with newly drawn drivers; see `simulate_given`."""
        inner = self.human.draw_inner(len(lead_speed), np.random.default_rng(self.human.seed))
        return self.simulate_given(lead_speed, range_, closing_speed, inner)


def predictive_limits(means: Array, levels: tuple[float, float] = LIMITS) -> tuple[int, int]:
    """Return the quantiles of a count that is Poisson given its mean.

    Parameters
    ----------
    means
        Draws of the mean, shape (draws,).
    levels
        Levels of the quantiles.
    """
    top = int(poisson.isf(1e-6, means.max())) + 1
    below = poisson.cdf(np.arange(top)[:, None], means).mean(axis=1)
    low, high = np.searchsorted(below, levels)
    return int(low), int(high)


@dataclass(frozen=True)
class HumanPrediction:
    """All that the prediction needs.

    Attributes
    ----------
    scored
        The family of laws.
    grid
        Cells and resolution of the crash maps.
    cut_ins_per_km
        Recorded closing cut-ins per kilometre [1/km]; None if the distance is unknown.
    draws
        Number of draws of the law and of the population of drivers.
    generator
        Source of all randomness.
    """

    scored: ScoredFamily
    grid: Grid
    cut_ins_per_km: float | None
    draws: int
    generator: np.random.Generator

    def table(self, counts: pd.DataFrame) -> pd.DataFrame:
        """Tabulate predicted and counted numbers.

        Parameters
        ----------
        counts
            Of the 100-Car study, as `count_events` returns them.

        Returns
        -------
        pandas.DataFrame
            Columns ``driver`` (the human as it is, or a variant); ``event``; ``probability`` of a cut-in;
            ``expected`` number in the distance of the 100-Car study, with the 90 % limits ``low90`` and
            ``high90`` of the count; ``counted``; ``probability_of_so_few``, that of at most the counted number;
            and ``verdict``. Variants are computed with the law of the largest weight and have no limits.
        """
        weighted = self.scored.weighted(deepcopy(self.generator), self.draws)
        counted = {
            "crash": count_of(counts, CUT_IN, "crash"),
            "near-crash": count_of(counts, STRUCK, "near-crash"),
        }
        rows = [*self._own_rows(weighted, counted), *self._variant_rows(weighted, counted)]
        table = pd.DataFrame(rows)
        cut_ins = np.nan if self.cut_ins_per_km is None else self.cut_ins_per_km * self._kilometres
        table.loc[table["expected"].isna(), "expected"] = cut_ins * table["probability"]
        return table

    @property
    def _kilometres(self) -> float:
        return 1e6 * HUNDRED_CAR_MILES * KILOMETRES_PER_MILE

    def _lines(self, human: Human, deceleration: float, *, finer: float) -> CrashLines:
        """Return the lines of the map of one event; all maps use the same random numbers."""
        grid = replace(self.grid.refined(finer), closing_speed_points=POINTS)
        crash_map = map_crashes(SevereHuman(human, deceleration), grid, [], deepcopy(self.generator))
        return CrashLines.of(crash_map, self.scored.records.lead_speed, support=self.scored.records.support)

    def _own_rows(self, weighted: WeightedLaws, counted: dict[str, int]) -> Iterator[dict]:
        """Yield the rows of the driver as it is, for several definitions of a near-crash."""
        human = Human()
        thinned = {}
        for deceleration in (np.inf, SEVERE, *OTHERS):
            lines = weighted.thinned(self._lines(human, deceleration, finer=1.0), deepcopy(self.generator))
            thinned[deceleration] = with_draws(lines, human, self.draws, self.generator)
        family, members = weighted.family, weighted.members
        drawn = draw_posterior(thinned, family, members, weighted.weights, deepcopy(self.generator))
        crash = drawn[np.inf].probabilities
        yield self._row("human", "crash", crash, counted["crash"])
        for deceleration in (SEVERE, *OTHERS):
            event = f"near-crash, {deceleration:g} g"
            near = np.maximum(drawn[deceleration].probabilities - crash, 0.0)
            yield self._row("human", event, near, counted["near-crash"])
        if self.cut_ins_per_km is not None:
            more = LANE_CHANGES_A_MILE * CLOSING / (self.cut_ins_per_km * KILOMETRES_PER_MILE)
            near = np.maximum(drawn[SEVERE].probabilities - crash, 0.0)
            name = "human, cut-ins from lane changes a mile"
            yield self._row(name, "crash", crash, counted["crash"], more)
            yield self._row(name, f"near-crash, {SEVERE:g} g", near, counted["near-crash"], more)

    def _row(self, driver: str, event: str, probabilities: Array, counted: int, more: float = 1.0) -> dict:
        row = {"driver": driver, "event": event, "probability": probabilities.mean(), "counted": counted}
        row |= {"expected": np.nan, "low90": np.nan, "high90": np.nan}
        row |= {"probability_of_so_few": np.nan, "verdict": ""}
        if self.cut_ins_per_km is None:
            return row
        means = more * self.cut_ins_per_km * self._kilometres * probabilities
        low, high = predictive_limits(means)
        verdict = (
            "inside"
            if low <= counted <= high
            else "too many predicted"
            if counted < low
            else "too few predicted"
        )
        row |= {"expected": means.mean(), "low90": low, "high90": high, "verdict": verdict}
        return row | {"probability_of_so_few": float(poisson.cdf(counted, means).mean())}

    def _variant_rows(self, weighted: WeightedLaws, counted: dict[str, int]) -> Iterator[dict]:
        """Yield the rows of the variants, and of the driver as it is by the same law and resolution."""
        ranges, law = weighted.family.ranges, weighted.family.law(weighted.heaviest)
        for name, parameters in {"as it is": {}, **VARIANTS}.items():
            human = Human(**parameters)
            crash, severe = (
                self._lines(human, deceleration, finer=0.7).probability(ranges, law)
                for deceleration in (np.inf, SEVERE)
            )
            for event, value in (("crash", crash), (f"near-crash, {SEVERE:g} g", max(severe - crash, 0.0))):
                row = {
                    "driver": f"human {name}" if name != "as it is" else "human, heaviest law",
                    "event": event,
                }
                yield row | {
                    "probability": value,
                    "expected": np.nan,
                    "counted": counted[event.split(",")[0]],
                }
