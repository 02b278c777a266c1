"""Coverage of intervals: many replicates of every stopping rule, compared with the exact probability.

There are four stopping rules, each with its interval:

- ``fixed``: a size that a pilot study predicted, and the normal interval;
- ``fixed_gamma``: the same simulations, and the gamma interval;
- ``sequential``: the paper's rule, the first n at which the normal interval is narrow enough;
- ``sequential_gamma``: `intervals.sequential_estimate`.

All rules use the same simulations of a replicate, from its beginning. Replicates use the f* of the searches
in turn, so the result is an average over these searches.

Crude Monte Carlo at the real probability takes too long to be run a thousand times. Its number of crashes is
binomial, and is drawn from this distribution with the exact probability.
"""

import math
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws import Factors
from accelerated_evaluation.methods.estimate import Stopping, normal_reach
from accelerated_evaluation.methods.importance_sampling import (
    crude_simulations,
    draw_weights,
    first_converged,
    running,
)
from accelerated_evaluation.methods.intervals import (
    Sums,
    gamma_interval,
    normal_interval,
    sequential_estimate,
)
from accelerated_evaluation.problem import Problem

LEVELS = (80, 95)
INTERVALS = {
    "fixed": normal_interval,
    "fixed_gamma": gamma_interval,
    "sequential": normal_interval,
    "sequential_gamma": gamma_interval,
}
BLOCK = 50_000  # simulations drawn at once: small blocks take longer
LARGEST = 1_000_000  # fixed number of simulations of a replicate, so that its weights fit into the memory
VANISHING = 1e-290  # below it the number of simulations is no longer a number
RARE = 1e-15  # below it events are drawn from the Poisson law, as their simulations exceed any whole number


def predicted_size(
    problem: Problem,
    searches: Sequence[Mapping[str, Factors]],
    generator: np.random.Generator,
    pilot: int,
    stopping: Stopping,
) -> int:
    """Return the number of simulations after which a relative half-width of beta is expected (VI.C, N-hat).

    It is the largest number of the stopping rule if the pilot study has fewer than two events, and at most
    `LARGEST`.

    Parameters
    ----------
    problem
        The law, the vehicle and the event.
    searches
        f* of each stratum, search by search; the variance is averaged over the searches.
    generator
        Source of all randomness.
    pilot
        Number of simulations with each search.
    stopping
        The rule, of which alpha and beta are used.
    """
    pilots = (Sums.of(draw_weights(problem, proposals, generator, pilot)) for proposals in searches)
    sums = sum(pilots, Sums())
    if sums.events < 2:
        return stopping.maximum_simulations
    reach = normal_reach(stopping.alpha) * sums.coefficient_of_variation / stopping.beta
    return min(max(math.ceil(sums.simulations * reach**2), 2), LARGEST)


class Stream:
    """A stream of weights with the f* of one search, drawn in large blocks and divided among replicates.

    A replicate begins where the previous one ended. The end depends only on earlier weights, so the
    replicates are independent.

    Parameters
    ----------
    problem
        The law, the vehicle and the event.
    proposals
        f* of each stratum.
    generator
        Source of all randomness.
    """

    def __init__(
        self, problem: Problem, proposals: Mapping[str, Factors], generator: np.random.Generator
    ) -> None:
        self._problem, self._proposals, self._generator = problem, proposals, generator
        self._weights = np.empty(0)

    def first(self, size: int) -> Array:
        """Return the first ``size`` weights of this replicate."""
        while self._weights.size < size:
            block = draw_weights(self._problem, self._proposals, self._generator, BLOCK)
            self._weights = np.concatenate([self._weights, block])
        return self._weights[:size]

    def end_replicate(self, size: int) -> None:
        """End this replicate after ``size`` weights and begin the next."""
        self._weights = self._weights[size:]


def stop_importance_sampling(stream: Stream, fixed: int, stopping: Stopping) -> dict[str, tuple[Sums, bool]]:
    """Run one replicate of importance sampling, and stop it by each of the rules.

    Parameters
    ----------
    stream
        The stream of weights.
    fixed
        The fixed size.
    stopping
        Criterion of the sequential rules.

    Returns
    -------
    dict
        For each rule, the sums at its end, and whether its criterion was met.
    """
    maximum, used = stopping.maximum_simulations, 0

    def draw(size: int) -> Sums:
        nonlocal used
        used += size
        return Sums.of(stream.first(used)[used - size :])

    by_gamma = sequential_estimate(draw, stopping)
    used, first = max(used, fixed), None
    while first is None:
        first = first_converged(running(stream.first(used), stopping.alpha), stopping)
        if used >= maximum:
            break
        used = used if first else min(2 * used, maximum)
    weights = stream.first(used)
    at_fixed = Sums.of(weights[:fixed]), True
    stream.end_replicate(used)
    return {
        "fixed": at_fixed,
        "fixed_gamma": at_fixed,
        "sequential": (Sums.of(weights[:first]), first is not None),
        "sequential_gamma": by_gamma,
    }


def stop_crude(
    probability: float, generator: np.random.Generator, stopping: Stopping
) -> dict[str, tuple[Sums, bool]]:
    """Draw one replicate of crude Monte Carlo from its distribution, and stop it by each of the rules.

    With k crashes, the relative half-width of the normal interval is z / sqrt(k) for a rare event. The
    paper's rule therefore stops at a fixed number of crashes, and the number of simulations until then is
    negative binomial.

    Parameters
    ----------
    probability
        The exact probability of the event.
    generator
        Source of all randomness.
    stopping
        Criterion of the sequential rules; crude Monte Carlo has no largest number of simulations here.

    Returns
    -------
    dict
        As for `stop_importance_sampling`. If the probability is (almost) 0, the largest number of simulations
        of the rule is used.
    """
    if probability < VANISHING:
        nothing = Sums.unweighted(stopping.maximum_simulations, 0), False
        return dict.fromkeys(INTERVALS, nothing)
    probability = min(probability, 1.0)  # a sum of shares may exceed 1 by rounding

    def draw(size: int) -> Sums:
        if probability < RARE:
            return Sums.unweighted(size, int(generator.poisson(size * probability)))
        return Sums.unweighted(size, int(generator.binomial(size, probability)))

    alpha, beta = stopping.alpha, stopping.beta
    at_fixed = draw(max(math.ceil(crude_simulations(probability, alpha, beta)), 1)), True
    events = max(math.ceil((normal_reach(alpha) / beta) ** 2), stopping.minimum_events)
    if probability < RARE:
        simulations = math.ceil(generator.gamma(events) / probability)
    else:
        simulations = events + int(generator.negative_binomial(events, probability))
    endless = Stopping(alpha, beta, stopping.minimum_events, max(sys.maxsize, math.ceil(1e6 / probability)))
    return {
        "fixed": at_fixed,
        "fixed_gamma": at_fixed,
        "sequential": (Sums.unweighted(simulations, events), True),
        "sequential_gamma": sequential_estimate(draw, endless, weight_bound=1.0),
    }


def replicate_rows(
    stopped: Mapping[str, tuple[Sums, bool]], weight_bound: float | None = None
) -> list[dict[str, Any]]:
    """Return a row for each stopping rule of one replicate: estimate, reported cov, and intervals by level.

    ``weight_bound`` is that of `gamma_interval`.
    """
    rows = []
    for stopping, (sums, converged) in stopped.items():
        interval_of = INTERVALS[stopping]
        if interval_of is gamma_interval:
            interval_of = partial(gamma_interval, weight_bound=weight_bound)
        row = {
            "stopping": stopping,
            "converged": converged,
            # Beyond the whole numbers of a table, as a float.
            "simulations": sums.simulations if sums.simulations <= sys.maxsize else float(sums.simulations),
            "events": sums.events,
            "probability": sums.probability,
            "cov_reported": sums.coefficient_of_variation,
        }
        for level in LEVELS:
            interval = interval_of(sums, 1 - level / 100)
            row |= {f"ci{level}_low": interval.low, f"ci{level}_high": interval.high}
        rows.append(row)
    return rows


def coverage_table(replicates: pd.DataFrame, probability: float, standard_error: float = 0.0) -> pd.DataFrame:
    """Compare replicates with the exact probability.

    Parameters
    ----------
    replicates
        Rows as of `replicate_rows`, with the columns ``method`` and ``replicate``.
    probability, standard_error
        The exact probability and its standard error.

    Returns
    -------
    pandas.DataFrame
        For each method and stopping rule: ``replicates``, the share ``converged``, ``simulations_mean``,
        relative ``bias``, true and mean reported coefficient of variation ``cov_true`` and ``cov_reported``,
        and the coverage of each level; with standard errors ``*_se``.
    """
    groups = replicates.groupby(["method", "stopping"], sort=False)
    return pd.DataFrame(
        {"method": method, "stopping": stopping} | _judge(group, probability, standard_error)
        for (method, stopping), group in groups
    )


def _judge(group: pd.DataFrame, probability: float, standard_error: float) -> dict[str, float]:
    count = len(group)
    # Without an event nothing is relative to its probability.
    ratio = group["probability"] / (probability or math.nan)
    cov = float(ratio.std())
    row = {
        "replicates": count,
        "converged": float(group["converged"].mean()),
        "simulations_mean": float(group["simulations"].mean()),
        "bias": float(ratio.mean()) - 1,
        "bias_se": math.hypot(cov / math.sqrt(count), standard_error / (probability or math.nan)),
        "cov_true": cov,
        "cov_true_se": math.sqrt(float(np.square(np.square(ratio - ratio.mean()) - cov**2).mean()) / count)
        / (2 * (cov or math.nan)),
        "cov_reported": float(group["cov_reported"].mean()),
    }
    for level in LEVELS:
        held = float(
            group[f"ci{level}_low"].le(probability).mul(group[f"ci{level}_high"].ge(probability)).mean()
        )
        row |= {f"coverage{level}": held, f"coverage{level}_se": math.sqrt(held * (1 - held) / count)}
    return row
