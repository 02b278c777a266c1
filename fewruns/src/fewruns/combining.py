"""The estimate from several batches: the batches on which it is based, their weights, and its variance.

Batches and weights depend only on what was known before a batch was drawn, so errors are a martingale.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtri, stdtrit

from fewruns.arrays import Flags
from fewruns.constants import AGREEMENT, BEST, COVERED, SURE, USABLE
from fewruns.two_phase import Prediction, TwoPhaseBatch

TERMS = 50  # number of terms of the series in `boundary`


@dataclass(frozen=True)
class BatchEstimate:
    """The estimate of the probability of the event from one batch of the second phase."""

    probability: float  # the estimate Y
    observed_variance: float  # variance of Y, estimated from the runs
    runs: int  # 0 for a batch of a cover, which has no weight in the estimate
    prediction: Prediction
    # Whether an unexpected event happened: at a point that the surrogate had excluded, with a large weight.
    surprising: bool
    # How much lower the estimate would be if no failed run were an event, and how much higher if all were.
    less: float = 0.0
    more: float = 0.0
    best: float = BEST  # lower bound of the predicted coefficient of variation in the weight

    @property
    def importance(self) -> float:
        """Weight of the batch in the estimate: its runs divided by the predicted variance of a single run."""
        return self.runs / max(self.prediction.variation, self.best**2)


@dataclass(frozen=True)
class Combined:
    """The estimate from several batches: a weighted mean."""

    probability: float
    observed_variance: float  # variance of the mean, estimated from the runs
    predicted_variance: float  # variance of the mean, predicted before the runs were made
    batches: int
    less: float  # as in `BatchEstimate`
    more: float

    def interval(self, alpha: float) -> tuple[float, float]:
        """Return the 100 (1 - alpha) % interval by Student's t; its upper end may be infinite."""
        return interval(self.probability, self.error, self.batches, alpha)

    @property
    def error(self) -> float:
        """Coefficient of variation of the estimate, from the larger of its two variances.

        The observed variance does not include parts of the event that were not met, and the predicted one
        does not include errors of the surrogate.
        """
        return math.sqrt(max(self.observed_variance, self.predicted_variance)) / self.probability


def interval(probability: float, error: float, batches: int, alpha: float) -> tuple[float, float]:
    """Return all P with |Y - P| <= t c P for an estimate Y of the relative error c, from some batches.

    The upper part is the longer one, because estimates that are too low also have too small an error.
    """
    return ends(probability, float(stdtrit(batches - 1, 1 - alpha / 2)) * error)


def ends(probability: float, reach: float) -> tuple[float, float]:
    """Return the ends of all P with |probability - P| <= reach P; the upper may be infinite."""
    return probability / (1 + reach), probability / (1 - reach) if reach < 1 else math.inf


def estimate_batch(batch: TwoPhaseBatch, happened: Flags, failed: Flags | None = None) -> BatchEstimate:
    """Return the estimate of a batch, from n flags, with the variance of independent inclusions.

    For a failed run, the outcome is replaced by the control variate, so that the run leaves the estimate. The
    weight of the batch does not depend on failures.
    """
    sampled = batch.weight > 0
    n = int(np.count_nonzero(sampled))
    known = np.ones(len(happened), bool) if failed is None else ~failed
    factor = batch.weight / batch.inclusion
    terms = np.where(known, batch.weight * (happened - batch.control) / batch.inclusion, 0.0)
    first_phase = max(batch.controlled_square + batch.weight @ terms, 0.0)
    second_phase = (terms**2 * (1 - batch.inclusion)).sum() * n / max(n - 1, 1)
    # The runs of a cover have no weights, and all of their events matter.
    matters = (factor > batch.prediction.probability) | ~sampled
    return BatchEstimate(
        probability=float(batch.controlled + terms.sum()),
        observed_variance=float(first_phase + second_phase),
        runs=n,
        prediction=batch.prediction,
        surprising=bool((happened & ~batch.aimed & matters).any()),
        less=float((factor * batch.control)[~known].sum()),
        more=float((factor * (1 - batch.control))[~known].sum()),
        best=SURE if batch.z.shape[1] <= COVERED else BEST,
    )


def consistent_batches(batches: Sequence[BatchEstimate], usable: float = USABLE) -> Sequence[BatchEstimate]:
    """Return the last batches with consistent predictions, on which the estimate is based, or none."""
    *_, first = (None, *beginnings(batches, usable))
    return batches[len(batches) if first is None else first :]


def beginnings(batches: Sequence[BatchEstimate], usable: float = USABLE) -> Iterator[int | None]:
    """Yield, after each batch, the index of the first batch that counts in the estimate.

    The index is None as long as the estimate has not begun. It begins with a batch whose predicted
    coefficient of variation of a run is below ``usable`` and whose predicted probability agrees with that of
    the batch before. It begins again if the prediction changes or after an unexpected event, because
    averaging over earlier batches would conceal parts that they missed.
    """
    first, reference = None, 0.0
    for i, batch in enumerate(batches):
        now = batch.prediction.probability
        agrees = min(now, reference) > 0 and 1 / AGREEMENT < now / reference < AGREEMENT
        if not agrees:
            first = None
        elif first is None and batch.prediction.variation < usable**2:
            first = i
        if first is None or first == i:
            reference = now
        if batch.surprising:
            first, reference = None, 0.0
        yield first


def combine(batches: Sequence[BatchEstimate]) -> Combined:
    """Return the weighted mean of the batches, with its observed and predicted variance.

    The weights must not depend on estimates or observed variances, because low estimates have small
    variances.
    """
    weight = np.array([batch.importance for batch in batches])
    weight /= weight.sum()
    probability = float(weight @ np.array([batch.probability for batch in batches]))
    observed = weight**2 @ np.array([batch.observed_variance for batch in batches])
    variations = np.array([batch.prediction.variation / batch.runs for batch in batches])
    predicted = float(weight**2 @ variations * probability**2)
    less, more = (float(weight @ [getattr(batch, side) for batch in batches]) for side in ("less", "more"))
    return Combined(probability, float(observed), predicted, len(batches), less, more)


@lru_cache
def boundary(alpha: float) -> float:
    """Return z with P(|W(V)| > z sqrt(V_g) for any V <= V_g) = alpha, for a Brownian motion W."""
    odd = 2 * np.arange(TERMS) + 1

    def excess(z: float) -> float:
        stays = 4 / math.pi * ((-1) ** np.arange(TERMS) / odd * np.exp(-((odd * math.pi / z) ** 2) / 8)).sum()
        return 1 - alpha - float(stays)

    return float(brentq(excess, 0.1, 20.0))


def reach_of_goal(beta: float) -> float:
    """Return the relative error r for which the half-width of Y / (1 + r) to Y / (1 - r) is beta Y."""
    return (math.sqrt(1 + 4 * beta**2) - 1) / (2 * beta)


def anytime_interval(
    batches: Sequence[BatchEstimate], alpha: float, beta: float
) -> tuple[Combined, tuple[float, float]]:
    """Return the estimate from two or more batches, and an interval that may be checked after each of them.

    It is based on the first batches with which the half-width is at most beta times the estimate, or on all.
    """
    goal = reach_of_goal(beta)
    for count in range(2, len(batches) + 1):
        combined = combine(batches[:count])
        # The coefficient of variation is multiplied by the ratio of Student's quantile to the normal one.
        student = float(stdtrit(count - 1, 1 - alpha / 2) / ndtri(1 - alpha / 2))
        reach = boundary(alpha) * (student * combined.error) if combined.probability > 0 else math.inf
        if reach <= goal:
            break
    # The boundary is z c^2 / c_g, and z c_g is the reach of the goal.
    return combined, ends(combined.probability, goal * max(reach / goal, 1.0) ** 2)
