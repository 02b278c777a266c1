"""Importance sampling over all strata of the lead speed, and its convergence (sections IV.A and VI.C)."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, Self

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws import Factors
from accelerated_evaluation.methods import Estimate, Stopping, normal_reach
from accelerated_evaluation.methods.problem import Problem


@dataclass(frozen=True)
class Sample:
    """Simulated encounters of one stratum, drawn from a proposal f*; all arrays have shape (n,)."""

    first: (
        Array  # coordinates of the encounters in the stratum, R^-1 [1/m] and TTC^-1 [1/s] in the paper's laws
    )
    second: Array
    log_ratio: Array  # log f - log f*
    happened: NDArray[np.bool_]
    outcomes: Any  # outcomes of the scenario

    @classmethod
    def of(
        cls, problem: Problem, stratum: str, proposal: Factors, generator: np.random.Generator, size: int
    ) -> Self:
        """Draw a sample of a stratum, given by its name, from a proposal, and simulate it."""
        f = problem.stratified.strata[stratum]
        lead_speed = f.lead_speed.rvs(generator, size)
        coordinates = proposal.rvs(generator, size)
        # Both densities are of the coordinates, so the Jacobian of the map to cut-ins cancels.
        log_ratio = f.factors.logpdf(*coordinates) - proposal.logpdf(*coordinates)
        outcomes = problem.simulate(problem.stratified.with_cap(f.points(lead_speed, *coordinates)))
        return cls(*coordinates, log_ratio, problem.event.happens(outcomes), outcomes)

    def join(self, other: "Sample") -> "Sample":
        """Return both samples as one."""
        outcomes = type(self.outcomes)(**_joined(self.outcomes, other.outcomes))
        parts = _joined(self, other, skip="outcomes")
        return Sample(**parts, outcomes=outcomes)

    @property
    def weight(self) -> Array:
        """The likelihood ratio f / f* where the event happened, and 0 elsewhere, shape (n,)."""
        return np.where(self.happened, np.exp(self.log_ratio), 0.0)


def _joined(one: Any, two: Any, skip: str = "") -> dict[str, Any]:  # noqa: ANN401
    names = [field.name for field in fields(one) if field.name != skip]
    return {name: np.concatenate([getattr(one, name), getattr(two, name)]) for name in names}


def draw_weights(
    problem: Problem, proposals: Mapping[str, Factors], generator: np.random.Generator, size: int
) -> Array:
    """Simulate cut-ins that are drawn from f*, and return their weights I(x) f(x) / f*(x).

    I(x) is 1 if the event happened and 0 otherwise. The stratum of a cut-in and its lead speed v_L are drawn
    from the law, and only range and time to collision are accelerated.
    """
    shares = np.array(list(problem.stratified.shares.values()))
    which = generator.choice(len(shares), size=size, p=shares / shares.sum())
    weights = np.empty(size)
    for index, stratum in enumerate(problem.stratified.shares):
        chosen = which == index
        count = int(np.count_nonzero(chosen))
        if count:
            weights[chosen] = Sample.of(problem, stratum, proposals[stratum], generator, count).weight
    return weights


def estimate_from_weights(weights: Array, alpha: float, *, converged: bool, learning: int = 0) -> Estimate:
    """Return the mean weight I f / f* as the estimated probability of the event, with a normal interval.

    The interval has the level 100 (1 - alpha) %, and ``learning`` is the number of simulations of the search
    for f*. With fewer than two events no variance can be estimated, and the interval is [0, 1]. Without
    simulations the estimate is NaN. The diagnostics are ``relative_half_width``; ``effective_sample_size``,
    (sum w)^2 / sum w^2 over the events; and ``largest_weight_share``, which is near one if a single event
    dominates.
    """
    n, events = weights.size, int(np.count_nonzero(weights))
    mean = float(weights.mean()) if n else math.nan
    low, high, relative, effective, largest = 0.0, 1.0, math.inf, float(events), (1.0 if events else math.nan)
    if events > 1:
        total = float(weights.sum())
        half_width = float(normal_reach(alpha) * weights.std(ddof=1) / math.sqrt(n))
        low, high = max(mean - half_width, 0.0), min(mean + half_width, 1.0)
        relative = half_width / mean
        effective = total**2 / float(np.square(weights).sum())
        largest = float(weights.max()) / total
    diagnostics = {
        "relative_half_width": relative,
        "effective_sample_size": effective,
        "largest_weight_share": largest,
    }
    return Estimate(mean, low, high, alpha, learning, n, events, converged, diagnostics)


@dataclass(frozen=True)
class Running:
    """The estimate after each of n simulations, from all simulations up to it."""

    probability: Array
    variance: Array
    # Half-width of the normal interval over the estimate, infinite with fewer than two events.
    relative_half_width: Array
    events: NDArray[np.int_]  # number of events so far


def running(weights: Array, alpha: float) -> Running:
    """Return the estimate after each of n simulations, given their weights I f / f*, shape (n,).

    The level of the normal interval is 100 (1 - alpha) %.
    """
    n = np.arange(1, weights.size + 1)
    mean = np.cumsum(weights) / n
    # Welford's increments avoid the difference of two large sums.
    previous = np.concatenate([[0.0], mean[:-1]])
    spread = np.cumsum((weights - previous) * (weights - mean))
    with np.errstate(invalid="ignore", divide="ignore"):
        variance = spread / (n - 1) / n
        half_width = normal_reach(alpha) * np.sqrt(variance) / mean
    events = np.cumsum(weights > 0, dtype=int)
    return Running(mean, variance, np.where(events > 1, half_width, np.inf), events)


def first_converged(course: Running, stopping: Stopping) -> int | None:
    """Return the number of simulations after which the stopping rule is first satisfied; None if it never is.

    The rule is satisfied if the relative half-width is at most beta and there are enough events.
    """
    met = course.relative_half_width <= stopping.beta
    met &= course.events >= stopping.minimum_events
    return int(np.argmax(met)) + 1 if met.any() else None


def run_to_convergence(
    problem: Problem,
    proposals: Mapping[str, Factors],
    stopping: Stopping,
    generator: np.random.Generator,
    batch: int,
) -> tuple[Array, int | None]:
    """Simulate in batches until the estimate has converged, or the limit of simulations is reached.

    The stopping rule is checked after every simulation. The result is the weights of all simulations, and the
    number of simulations after which the rule was first satisfied, or None.
    """
    weights = np.empty(0)
    converged_at = None
    while converged_at is None and weights.size < stopping.maximum_simulations:
        size = min(batch, stopping.maximum_simulations - weights.size)
        weights = np.concatenate([weights, draw_weights(problem, proposals, generator, size)])
        converged_at = first_converged(running(weights, stopping.alpha), stopping)
    return weights, converged_at


def course_table(weights: Array, alpha: float, step: int) -> pd.DataFrame:
    """Tabulate an estimate every ``step`` simulations; the intervals have the level 100 (1 - alpha) %."""
    course = running(weights, alpha)
    shown = np.arange(step - 1, weights.size, step)
    return pd.DataFrame(
        {
            "simulations": shown + 1,
            "probability": course.probability[shown],
            "variance": course.variance[shown],
            "relative_half_width": course.relative_half_width[shown],
            "events": course.events[shown],
        }
    )


def crude_simulations(probability: float, alpha: float, beta: float) -> float:
    """Return how many simulations crude Monte Carlo needs for a relative half-width of beta (VI.C, N-hat)."""
    return normal_reach(alpha) ** 2 * (1 - probability) / (beta**2 * probability)
