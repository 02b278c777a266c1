"""The estimate from several batches: the batches on which it is based, their weights, and its variance.

Whether a batch is used, and its weight, depend only on what was known before the batch was drawn. The
weighted errors of the batches are therefore a martingale. Notebook 10 derives the rules.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from fewruns.arrays import Flags
from fewruns.constants import AGREEMENT, BEST, USABLE
from fewruns.two_phase import Prediction, TwoPhaseBatch


@dataclass(frozen=True)
class BatchEstimate:
    """The estimate of the probability of the event from one batch of the second phase.

    Attributes
    ----------
    probability
        The estimate Y.
    observed_variance
        Variance of Y that is estimated from the runs of the batch: the sum of the variance of the pool (first
        phase) and of the choice of runs from the pool (second phase).
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
        """Weight of the batch in the estimate: its runs divided by the predicted variance of a single run."""
        return self.runs / max(self.prediction.variation, BEST**2)


@dataclass(frozen=True)
class Combined:
    """The estimate from several batches.

    Attributes
    ----------
    probability
        The weighted mean of the estimates of the batches.
    observed_variance, predicted_variance
        Variance of the weighted mean: estimated from the runs, and predicted before the runs were made.
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
        """Coefficient of variation of the estimate, computed from the larger of its two variances."""
        return math.sqrt(max(self.observed_variance, self.predicted_variance)) / self.probability

    def half_width(self, alpha: float) -> float:
        """Return half the width of the 100 (1 - alpha) % interval of the estimated probability."""
        low, high = self.interval(alpha)
        return (high - low) / 2


def interval(probability: float, error: float, batches: int, alpha: float) -> tuple[float, float]:
    """Return the interval of the probabilities P that agree with an estimate of a given relative error.

    The standard deviation of the estimate Y is c P, where c is its coefficient of variation. It is relative
    to the true probability P and not to Y. The interval contains every P with |Y - P| <= t c P, where t is
    the 1 - alpha / 2 quantile of Student's t. Its upper part is longer than its lower part. This is
    appropriate, because an estimate that is too low also has an estimated error that is too small.

    Parameters
    ----------
    probability
        The estimate Y.
    error
        The coefficient of variation c of the estimate.
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
    """Return the ends of the interval of all probabilities P with |probability - P| <= reach P.

    The upper end is infinite if ``reach`` is 1 or more.
    """
    return probability / (1 + reach), probability / (1 - reach) if reach < 1 else math.inf


def estimate_batch(batch: TwoPhaseBatch, happened: Flags) -> BatchEstimate:
    """Return the estimate of a batch by the difference estimator of `two_phase`, with its observed variance.

    The variance of the second phase is estimated as if the runs were included independently of each other;
    points with an inclusion probability close to 1 contribute almost nothing. The variance of the first phase
    is also estimated by a difference estimator, which is replaced by 0 if it is negative.

    Parameters
    ----------
    batch
        A batch of n runs.
    happened
        Whether the event happened in each run, shape (n,).
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


def counted_batches(batches: Sequence[BatchEstimate], usable: float = USABLE) -> Sequence[BatchEstimate]:
    """Return the batches on which the estimate is based: the last ones with consistent predictions.

    Before each batch, the surrogate predicts the probability of the event and the coefficient of variation of
    a run. Two predictions of the probability agree if they differ by less than the factor `AGREEMENT`. The
    estimate begins with the first batch whose predicted coefficient of variation is below ``usable`` and
    whose predicted probability agrees with that of the batch before. It begins again with a later batch in
    two cases: if the predicted probability no longer agrees with that of its first batch, or after an
    unexpected event, which is an event at a point that the surrogate had excluded, with a large weight. In
    both cases the earlier batches were designed with wrong predictions, and averaging over them would conceal
    the parts of the event that they have missed.

    Parameters
    ----------
    batches
        All batches, in their order.
    usable
        Predicted coefficient of variation of a single run, below which a surrogate is usable.

    Returns
    -------
    sequence of BatchEstimate
        The last batches; empty if the estimate has not begun.
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
    return batches[len(batches) if first is None else first :]


def combine(batches: Sequence[BatchEstimate]) -> Combined:
    """Return the weighted mean of the estimates of the batches, with its observed and predicted variance.

    The weights are proportional to the number of runs divided by the variance of a run that was predicted
    before the batch was drawn. They must not depend on the estimates or on their observed variances, because
    low estimates have small observed variances and would get too much weight.
    """
    weight = np.array([batch.importance for batch in batches])
    weight /= weight.sum()
    probability = float(weight @ np.array([batch.probability for batch in batches]))
    observed = weight**2 @ np.array([batch.observed_variance for batch in batches])
    variations = np.array([batch.prediction.variation / batch.runs for batch in batches])
    return Combined(
        probability, float(observed), float(weight**2 @ variations * probability**2), len(batches)
    )
