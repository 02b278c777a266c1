"""Crude Monte Carlo over all strata: every cut-in is drawn from f itself and simulated (table III).

The study runs it in batches, each with its own random generator. The same batches therefore give the same
results, even if the run is shortened or extended.
"""

from typing import Any, ClassVar

import numpy as np
import pandas as pd
from fewruns.problems import ScoreProblem
from tqdm import trange

from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.base.sections import Schema, Sections, integer, section
from accelerated_evaluation.methods import METHODS, Estimate, Method, Stopping
from accelerated_evaluation.methods.intervals import (
    Sums,
    binomial_interval,
    gamma_interval,
    sequential_estimate,
)
from accelerated_evaluation.methods.problem import Problem

ALL = "all"
Counts = dict[str, list[int]]  # simulations and crashes of one batch, by segment
SETTINGS = section(
    simulations=integer(
        60_000_000,
        100,
        100_000_000_000,
        "Simulations of crude Monte Carlo (section VI.C extrapolates to 5.5e7).",
    ),
    batch_size=integer(500_000, 100, 10_000_000, "Simulations of a batch."),
)


def _simulate_batch(problem: Problem, generator: np.random.Generator, size: int) -> Counts:
    """Simulate ``size`` cut-ins drawn from the law of a problem, and return counts by stratum.

    The counts of a stratum are the numbers of its simulations and of its events.
    """
    x, stratum = problem.stratified.draw_in_strata(size, generator)
    happened = problem.event.happens(problem.simulate(x))
    names = list(problem.stratified.shares)
    simulations = np.bincount(stratum, minlength=len(names))
    events = np.bincount(stratum[happened], minlength=len(names))
    return {name: [int(simulations[k]), int(events[k])] for k, name in enumerate(names)}


def simulate_batches(problem: Problem, *, seed: int, batches: int, batch_size: int) -> list[Counts]:
    """Simulate batches, each with a generator derived from the root seed; return their counts by stratum."""
    steps = trange(batches, desc="crude Monte Carlo", unit_scale=batch_size, unit=" simulations")
    return [_simulate_batch(problem, child_generator(seed, "crude", batch), batch_size) for batch in steps]


@METHODS.add("crude")
class Crude(Method):
    """Crude Monte Carlo: draw from f until the interval is narrow enough.

    The study does not run replicates of it, because it needs tens of millions of simulations. It runs once,
    for a given number of simulations; see `simulate_batches`.
    """

    style: ClassVar[dict[str, Any]] = {"color": "#777777", "linestyle": ":", "marker": "v"}
    settings: ClassVar[dict[str, Schema]] = {"crude_monte_carlo": SETTINGS}

    @classmethod
    def replicates(cls, sections: Sections) -> int:
        """Return 0, because the study runs crude Monte Carlo once, in its own rule."""
        return 0

    def estimate(self, problem: ScoreProblem, stopping: Stopping, generator: np.random.Generator) -> Estimate:
        """Return the relative frequency of the event as an estimate, with a gamma interval.

        The simulations end when the half-width of this interval, divided by the estimate, is at most the
        ``beta`` of the stopping rule, or at its largest number of simulations.
        """

        def draw(size: int) -> Sums:
            happened, _ = problem.evaluate(generator.standard_normal((size, problem.dimension)))
            return Sums.unweighted(size, int(np.count_nonzero(happened)))

        sums, converged = sequential_estimate(draw, stopping, weight_bound=1.0)
        low, high = gamma_interval(sums, stopping.alpha, weight_bound=1.0)
        return Estimate(
            sums.probability, low, high, stopping.alpha, 0, sums.simulations, sums.events, converged
        )


def crude_estimates(batches: list[Counts], alpha: float) -> pd.DataFrame:
    """Estimate the crash probability of each segment and of all segments together.

    ``ci_low`` and ``ci_high`` are the ends of the Clopper-Pearson interval of level 100 (1 - alpha) %, and
    ``ci95_low`` and ``ci95_high`` those of 95 %. Without a crash the lower ends are 0.
    """
    segments = {segment: np.sum([counts[segment] for counts in batches], axis=0) for segment in batches[0]}
    totals = segments | {ALL: sum(segments.values())}
    rows = []
    for segment, (simulations, crashes) in totals.items():
        row = {"segment": segment, **_estimate(int(simulations), int(crashes), alpha)}
        interval = binomial_interval(int(crashes), int(simulations), 0.05)
        rows.append(row | {"ci95_low": interval.low, "ci95_high": interval.high})
    return pd.DataFrame(rows)


def crude_course(batches: list[Counts], alpha: float) -> pd.DataFrame:
    """Return the estimate over all segments after each batch, from this batch and all batches before.

    The table has one row for each batch, with the columns ``simulations``, ``crashes``, ``probability``,
    ``ci_low`` and ``ci_high``, the ends of the 100 (1 - alpha) % interval of Clopper and Pearson.
    """
    counts = np.cumsum([np.sum(list(batch.values()), axis=0) for batch in batches], axis=0)
    return pd.DataFrame([_estimate(simulations, crashes, alpha) for simulations, crashes in counts.tolist()])


def _estimate(simulations: int, crashes: int, alpha: float) -> dict[str, float]:
    interval = binomial_interval(crashes, simulations, alpha)
    return {
        "simulations": simulations,
        "crashes": crashes,
        "probability": crashes / simulations,
        "ci_low": interval.low,
        "ci_high": interval.high,
    }
