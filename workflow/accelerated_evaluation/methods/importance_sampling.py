"""Importance sampling over all velocity segments, and its convergence (sections IV.A and VI.C)."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from accelerated_evaluation.distributions.protocol import Array
from accelerated_evaluation.problem import CutIn, Proposal


@dataclass(frozen=True)
class Stratum:
    """One velocity segment: its cut-ins, its share of all lane changes, and the f* to draw from."""

    problem: CutIn
    share: float
    proposal: Proposal


@dataclass(frozen=True)
class Estimate:
    """A crash probability with its 100 (1 - alpha) % interval and the health of its weights.

    Attributes
    ----------
    probability, ci_low, ci_high
        Estimate and interval; with fewer than two crashes, which have no spread, the interval is [0, 1].
    relative_half_width
        Half-width of the interval over the estimate; infinite with fewer than two crashes.
    simulations, events
        How many cut-ins were simulated, and how many crashed.
    effective_sample_size
        (sum w)^2 / sum w^2 over the crashes; 0 without any.
    largest_weight_share
        The largest weight over the sum of all: near one where a single crash decides; NaN without any.
    """

    probability: float
    ci_low: float
    ci_high: float
    relative_half_width: float
    simulations: int
    events: int
    effective_sample_size: float
    largest_weight_share: float


def draw_crash_weights(strata: Mapping[str, Stratum], generator: np.random.Generator, size: int) -> Array:
    """Draw cut-ins over all segments, v_L as recorded, and return I(x) f(x) / f*(x), shape (size,)."""
    shares = np.array([stratum.share for stratum in strata.values()])
    which = generator.choice(len(shares), size=size, p=shares / shares.sum())
    weights = np.empty(size)
    for index, stratum in enumerate(strata.values()):
        chosen = which == index
        count = int(np.count_nonzero(chosen))
        if count:
            weights[chosen] = stratum.problem.sample(stratum.proposal, generator, count).crash_weight
    return weights


def estimate(weights: Array, alpha: float) -> Estimate:
    """Estimate the crash probability from crash weights, shape (n,), with a normal interval."""
    n, events = weights.size, int(np.count_nonzero(weights))
    if events == 0:
        return Estimate(0.0, 0.0, 1.0, math.inf, n, 0, 0.0, math.nan)
    mean, total = float(weights.mean()), float(weights.sum())
    if events == 1:
        return Estimate(mean, 0.0, 1.0, math.inf, n, 1, 1.0, 1.0)
    half_width = float(-ndtri(alpha / 2) * weights.std(ddof=1) / math.sqrt(n))
    return Estimate(
        probability=mean,
        ci_low=max(mean - half_width, 0.0),
        ci_high=min(mean + half_width, 1.0),
        relative_half_width=half_width / mean,
        simulations=n,
        events=events,
        effective_sample_size=total**2 / float(np.square(weights).sum()),
        largest_weight_share=float(weights.max()) / total,
    )


@dataclass(frozen=True)
class Running:
    """Estimate, variance of the estimate and relative half-width after each of n simulations, shape (n,)."""

    probability: Array
    variance: Array
    relative_half_width: Array
    events: Array


def running(weights: Array, alpha: float) -> Running:
    """Follow an estimate simulation by simulation; with fewer than two events its half-width is infinite."""
    n = np.arange(1, weights.size + 1)
    mean = np.cumsum(weights) / n
    # Welford's increments: no difference of large sums.
    previous = np.concatenate([[0.0], mean[:-1]])
    spread = np.cumsum((weights - previous) * (weights - mean))
    with np.errstate(invalid="ignore", divide="ignore"):
        variance = spread / (n - 1) / n
        half_width = -ndtri(alpha / 2) * np.sqrt(variance) / mean
    events = np.cumsum(weights > 0)
    return Running(mean, variance, np.where(events > 1, half_width, np.inf), events)


def first_converged(course: Running, beta: float, minimum_events: int) -> int | None:
    """Return the number of simulations to convergence, or None.

    The rule: the first n at which the relative half-width is at most ``beta`` and at least
    ``minimum_events`` crashes were seen, so that a lucky start does not count.
    """
    met = (course.relative_half_width <= beta) & (course.events >= minimum_events)
    return int(np.argmax(met)) + 1 if met.any() else None


def run_to_convergence(
    strata: Mapping[str, Stratum],
    generator: np.random.Generator,
    *,
    alpha: float,
    beta: float,
    minimum_events: int,
    simulations: int,
    maximum_simulations: int,
) -> tuple[Array, int | None]:
    """Simulate batches of ``simulations`` until the estimate has converged, at most ``maximum_simulations``.

    Returns
    -------
    weights, converged_at
        Crash weights of all simulations, shape (n,), and the number to convergence or None.
    """
    weights = np.empty(0)
    converged_at = None
    while converged_at is None and weights.size < maximum_simulations:
        batch = min(simulations, maximum_simulations - weights.size)
        weights = np.concatenate([weights, draw_crash_weights(strata, generator, batch)])
        converged_at = first_converged(running(weights, alpha), beta, minimum_events)
    return weights, converged_at


def crude_simulations(probability: float, alpha: float, beta: float) -> float:
    """Return the simulations crude Monte Carlo needs for a relative half-width beta (section VI.C, N-hat)."""
    return float(ndtri(alpha / 2)) ** 2 * (1 - probability) / (beta**2 * probability)
