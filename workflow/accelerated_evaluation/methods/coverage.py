"""Coverage of intervals: many replicates of every stopping rule, compared with the exact probability.

There are four stopping rules, each with its interval:

- ``fixed``: a size that a pilot study predicted, and the normal interval;
- ``fixed_gamma``: the same simulations, and the gamma interval;
- ``sequential``: the paper's rule, the first n at which the normal interval is narrow enough;
- ``sequential_gamma``: `intervals.sequential_estimate`.

All rules use the same simulations of a replicate, from its beginning. The replicates take the distribution f*
of one search after the other, so the result is an average over the searches.

Crude Monte Carlo takes too long to be run a thousand times at the real probability. Its number of crashes has
a binomial distribution, so this number is drawn from that distribution with the exact probability.
"""

import math
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from tqdm import trange

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.sections import integer, section
from accelerated_evaluation.laws import Factors
from accelerated_evaluation.methods import Stopping, normal_reach
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
from accelerated_evaluation.methods.problem import Problem

SECTION = section(
    replicates=integer(
        1000,
        2,
        1_000_000,
        "Number of independent replicates for the coverage of the intervals of each method.",
    ),
    pilot=integer(
        20_000,
        100,
        1_000_000_000,
        "Number of simulations of the pilot study that predicts the fixed size of a replicate.",
    ),
)
LEVELS = (80, 95)
INTERVALS = {
    "fixed": normal_interval,
    "fixed_gamma": gamma_interval,
    "sequential": normal_interval,
    "sequential_gamma": gamma_interval,
}
BLOCK = 50_000  # simulations drawn at once: small blocks take longer
LARGEST = 1_000_000  # largest fixed size of a replicate, so that its weights fit into memory
RARE = 1e-15  # for a smaller probability the number of simulations exceeds the largest integer


def predicted_size(
    problem: Problem,
    searches: Sequence[Mapping[str, Factors]],
    generator: np.random.Generator,
    pilot: int,
    stopping: Stopping,
) -> int:
    """Return how many simulations give a relative half-width of beta, predicted from a pilot study.

    This number is N-hat in section VI.C of the paper. It is at most `LARGEST`. If the pilot study has fewer
    than two events, its variance is unknown, and the result is the largest number of simulations that the
    stopping rule allows. The pilot study has ``pilot`` simulations from the f* of each search, over which the
    variance is averaged.
    """
    pilots = (Sums.of(draw_weights(problem, proposals, generator, pilot)) for proposals in searches)
    sums = sum(pilots, Sums())
    if sums.events < 2:
        return stopping.maximum_simulations
    reach = normal_reach(stopping.alpha) * sums.coefficient_of_variation / stopping.beta
    return min(max(math.ceil(sums.simulations * reach**2), 2), LARGEST)


class Stream:
    """A stream of importance weights from the f* of one search, divided among consecutive replicates.

    The weights are drawn in blocks of `BLOCK`. A replicate begins where the previous one ended. Where a
    replicate ends depends only on its own weights, so the replicates are independent.
    """

    def __init__(
        self, problem: Problem, proposals: Mapping[str, Factors], generator: np.random.Generator
    ) -> None:
        self._problem, self._proposals, self._generator = problem, proposals, generator
        self._weights = np.empty(0)

    def first(self, size: int) -> Array:
        """Return the first ``size`` importance weights of the current replicate, shape (size,)."""
        while self._weights.size < size:
            block = draw_weights(self._problem, self._proposals, self._generator, BLOCK)
            self._weights = np.concatenate([self._weights, block])
        return self._weights[:size]

    def end_replicate(self, size: int) -> None:
        """End the current replicate after its first ``size`` weights, and begin the next one there."""
        self._weights = self._weights[size:]


def stop_importance_sampling(stream: Stream, fixed: int, stopping: Stopping) -> dict[str, tuple[Sums, bool]]:
    """Run one replicate of importance sampling, and stop it by each of the stopping rules.

    The stream is at the beginning of a replicate, and ``fixed`` is the size of the two rules with a fixed
    size. The result has, for each rule, the sums of its weights, and whether its criterion was met.
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
    negative binomial. The result has, for each rule, the sums at its end, and whether its criterion was met.
    There is no largest number of simulations, except that below the probability `RARE` every rule ends
    without an event at that of ``stopping``.
    """
    if probability < RARE:
        nothing = Sums.unweighted(stopping.maximum_simulations, 0), False
        return dict.fromkeys(INTERVALS, nothing)
    probability = min(probability, 1.0)  # a sum of shares may exceed 1 by rounding

    def draw(size: int) -> Sums:
        return Sums.unweighted(size, int(generator.binomial(size, probability)))

    alpha, beta = stopping.alpha, stopping.beta
    at_fixed = draw(max(math.ceil(crude_simulations(probability, alpha, beta)), 1)), True
    events = max(math.ceil((normal_reach(alpha) / beta) ** 2), stopping.minimum_events)
    simulations = events + int(generator.negative_binomial(events, probability))
    endless = Stopping(alpha, beta, stopping.minimum_events, sys.maxsize)
    return {
        "fixed": at_fixed,
        "fixed_gamma": at_fixed,
        "sequential": (Sums.unweighted(simulations, events), True),
        "sequential_gamma": sequential_estimate(draw, endless, weight_bound=1.0),
    }


def replicate_rows(
    stopped: Mapping[str, tuple[Sums, bool]], weight_bound: float | None = None
) -> list[dict[str, Any]]:
    """Return the results of one replicate as rows of a table, one for each stopping rule.

    ``weight_bound`` is an upper bound on every importance weight, which the gamma interval uses.
    ``cov_reported`` is the estimated coefficient of variation of the estimate.
    """
    rows = []
    for stopping, (sums, converged) in stopped.items():
        interval_of = INTERVALS[stopping]
        if interval_of is gamma_interval:
            interval_of = partial(gamma_interval, weight_bound=weight_bound)
        row = {
            "stopping": stopping,
            "converged": converged,
            # A number that is too large for an integer column of a table is stored as a float.
            "simulations": sums.simulations,
            "events": sums.events,
            "probability": sums.probability,
            "cov_reported": sums.coefficient_of_variation,
        }
        for level in LEVELS:
            interval = interval_of(sums, 1 - level / 100)
            row |= {f"ci{level}_low": interval.low, f"ci{level}_high": interval.high}
        rows.append(row)
    return rows


def coverage_of_replicates(
    replicates: pd.DataFrame, probability: float, standard_error: float = 0.0
) -> pd.DataFrame:
    """Compare the estimates and intervals of many replicates with the exact probability.

    There is a row for each method and stopping rule. ``bias`` is relative, ``cov_true`` is the coefficient of
    variation of the estimates, ``cov_reported`` the mean of those reported, and ``coverage80`` and
    ``coverage95`` are shares of intervals that contain the exact probability. Standard errors end in ``_se``.
    """
    groups = replicates.groupby(["method", "stopping"], sort=False)
    return pd.DataFrame(
        {"method": method, "stopping": stopping} | _judge(group, probability, standard_error)
        for (method, stopping), group in groups
    )


def _judge(group: pd.DataFrame, probability: float, standard_error: float) -> dict[str, float]:
    count = len(group)
    # If the exact probability is 0, relative quantities are undefined (NaN).
    ratio = group["probability"] / (probability or math.nan)
    cov = float(ratio.std())
    row = {
        "replicates": count,
        "converged": float(group["converged"].mean()),
        "simulations_mean": float(group["simulations"].mean()),
        "simulations_sd": float(group["simulations"].std()),
        "bias": float(ratio.mean()) - 1,
        "bias_se": math.hypot(cov / math.sqrt(count), standard_error / (probability or math.nan)),
        "cov_true": cov,
        "cov_true_se": math.sqrt(float(np.square(np.square(ratio - ratio.mean()) - cov**2).mean()) / count)
        / (2 * (cov or math.nan)),
        "cov_reported": float(group["cov_reported"].mean()),
    }
    for level in LEVELS:
        share = float(
            group[f"ci{level}_low"].le(probability).mul(group[f"ci{level}_high"].ge(probability)).mean()
        )
        row |= {f"coverage{level}": share, f"coverage{level}_se": math.sqrt(share * (1 - share) / count)}
    return row


def coverage_replicates(
    method: str,
    problem: Problem,
    searches: Sequence[Mapping[str, Factors]],
    probability: float,
    generator_of: Callable[..., np.random.Generator],
    stopping: Stopping,
    coverage: Mapping[str, int],
) -> pd.DataFrame:
    """Run many replicates of one method, each of which is stopped by every stopping rule.

    Replicate k uses the result of search k modulo the number of searches. Without a search, the method is
    crude Monte Carlo, whose number of crashes is drawn with the exact probability. ``generator_of`` is called
    with "pilot", with the number of a search, or, for crude Monte Carlo, without an argument. The columns are
    ``method``, ``replicate`` and those of `coverage.replicate_rows`.
    """
    if searches:
        size = predicted_size(problem, searches, generator_of("pilot"), coverage["pilot"], stopping)
        streams = [Stream(problem, found, generator_of(number)) for number, found in enumerate(searches)]
        stops = [partial(stop_importance_sampling, stream, size, stopping) for stream in streams]
        weight_bound = None
    else:
        # The weights of crude Monte Carlo are 0 or 1, so the gamma interval can use 1 as their bound.
        stops, weight_bound = [partial(stop_crude, probability, generator_of(), stopping)], 1.0
    rows = []
    for replicate in trange(coverage["replicates"], desc=f"coverage, {method}"):
        stopped = stops[replicate % len(stops)]()
        labels = {"method": method, "replicate": replicate}
        rows += [labels | row for row in replicate_rows(stopped, weight_bound)]
    return pd.DataFrame(rows)
