"""The estimate from several batches: which batches count, their weights, and the variance.

All of these decisions use only the past of a batch, so the weighted errors of the batches are a martingale.
Notebook 10 derives the rules.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from accelerated_evaluation.methods.surrogate.constants import AGREEMENT, BEST, USABLE
from accelerated_evaluation.methods.surrogate.two_phase import Flags, Prediction, TwoPhaseBatch


@dataclass(frozen=True)
class BatchEstimate:
    """The estimate of P(event) from one batch of the second phase.

    Attributes
    ----------
    probability
        The estimate Y.
    observed_variance
        Variance of Y estimated from its own runs, for both phases together.
    runs
        Number of runs.
    prediction
        Predictions that were made before the batch was drawn.
    surprising
        Whether the batch contains an unexpected event: an event at a point that the surrogate had excluded,
        whose weight exceeds the predicted probability.
    """

    probability: float
    observed_variance: float
    runs: int
    prediction: Prediction
    surprising: bool

    @property
    def importance(self) -> float:
        """Weight k_b of the batch in the estimate."""
        return self.runs / max(self.prediction.variation, BEST**2)


@dataclass(frozen=True)
class Combined:
    """The estimate from several batches.

    Attributes
    ----------
    probability
        The weighted mean of their estimates.
    observed_variance, predicted_variance
        Its variance estimated from the runs, and predicted before they were made.
    batches
        Number of batches.
    """

    probability: float
    observed_variance: float
    predicted_variance: float
    batches: int

    def interval(self, alpha: float) -> tuple[float, float]:
        """Return the 100 (1 - alpha) % interval by Student's t; its upper end may be infinite.

        The larger of the two variances is used, because the observed variance does not include parts of the
        event that were not met, and the predicted one does not include errors of the surrogate.
        """
        return interval(self.probability, self.error, self.batches, alpha)

    @property
    def error(self) -> float:
        """Coefficient of variation of the estimate, by the larger of its two variances."""
        return math.sqrt(max(self.observed_variance, self.predicted_variance)) / self.probability

    def half_width(self, alpha: float) -> float:
        """Return half the width of the 100 (1 - alpha) % interval."""
        low, high = self.interval(alpha)
        return (high - low) / 2


def interval(probability: float, error: float, batches: int, alpha: float) -> tuple[float, float]:
    """Return all probabilities P that are consistent with an estimate of a given relative error.

    The coefficient of variation c of the estimate Y is known, so its standard deviation is c P, which is
    relative to the true probability P and not to Y. The interval contains every P with |Y - P| <= t c P. Its
    upper part is longer than its lower part. This is appropriate, because an estimate that is too low also
    has an estimated error that is too small.

    Parameters
    ----------
    probability
        The estimate Y.
    error
        Its coefficient of variation c.
    batches
        Number of batches, one more than the degrees of freedom of Student's t.
    alpha
        The level of the interval is 100 (1 - alpha) %.

    Returns
    -------
    tuple of float
        Y / (1 + t c) and Y / (1 - t c); the second is infinite if t c is 1 or more.
    """
    return ends(probability, float(stdtrit(batches - 1, 1 - alpha / 2)) * error)


def ends(probability: float, reach: float) -> tuple[float, float]:
    """Return the ends of all P whose difference from an estimate is at most ``reach`` times P."""
    return probability / (1 + reach), probability / (1 - reach) if reach < 1 else math.inf


def estimate_batch(batch: TwoPhaseBatch, happened: Flags) -> BatchEstimate:
    """Return the estimate of a batch and its observed variance, given the flags of its runs, shape (n,).

    The variance of the second phase is that of independent runs. Points that are included with a probability
    close to 1 add nothing to it. The variance of the first phase is estimated by a difference estimator,
    which may be negative; it is then replaced by 0.
    """
    n, terms = len(happened), batch.weight * (happened - batch.control) / batch.inclusion
    first_phase = max(batch.controlled_square + batch.weight @ terms, 0.0)
    second_phase = (terms**2 * (1 - batch.inclusion)).sum() * n / max(n - 1, 1)
    unforeseen = happened & ~batch.aimed & (batch.weight / batch.inclusion > batch.prediction.probability)
    return BatchEstimate(
        probability=float(batch.controlled + terms.sum()),
        observed_variance=float(first_phase + second_phase),
        runs=n,
        prediction=batch.prediction,
        surprising=bool(unforeseen.any()),
    )


def that_count(batches: Sequence[BatchEstimate], usable: float = USABLE) -> Sequence[BatchEstimate]:
    """Return the batches on which the estimate is based, the last ones with consistent predictions.

    The estimate begins with a batch for which the surrogate was usable and agreed with its prediction for the
    previous batch. It restarts if the surrogate no longer agrees with its prediction for the first of the
    batches, or after an unexpected event. In both cases the earlier batches were designed with wrong
    predictions, and averaging over them would conceal the parts of the event that they have missed.

    Parameters
    ----------
    batches
        All batches, in their order.
    usable
        Coefficient of variation per run below which a surrogate is usable.
    """
    first, view = None, 0.0
    for i, batch in enumerate(batches):
        now = batch.prediction.probability
        agrees = min(now, view) > 0 and 1 / AGREEMENT < now / view < AGREEMENT
        if not agrees:
            first = None
        elif first is None and batch.prediction.variation < usable**2:
            first = i
        if first is None or first == i:
            view = now
        if batch.surprising:
            first, view = None, 0.0
    return batches[len(batches) if first is None else first :]


def combine(batches: Sequence[BatchEstimate]) -> Combined:
    """Return the weighted mean of the estimates of the batches, and its two variances.

    The weights are the importances of the batches. They must not depend on the estimates or on their observed
    variances, because low estimates have small observed variances and would get too much weight.
    """
    weight = np.array([batch.importance for batch in batches])
    weight /= weight.sum()
    probability = float(weight @ np.array([batch.probability for batch in batches]))
    observed = weight**2 @ np.array([batch.observed_variance for batch in batches])
    variations = np.array([batch.prediction.variation / batch.runs for batch in batches])
    return Combined(
        probability, float(observed), float(weight**2 @ variations * probability**2), len(batches)
    )
