"""The estimate that the batches make together: which of them count, how much, and with what variance.

All of it is decided by the past of a batch alone, so that the weighted errors of the batches are a
martingale. docs/sampler.md derives the rules.
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
    """What a batch of the second phase says of P(event).

    Attributes
    ----------
    probability
        The estimate Y.
    observed_variance
        Variance of Y as its own runs show it, both phases together.
    runs
        Number of runs.
    prediction
        What was expected before the batch was drawn.
    surprising
        Whether an event where the surrogate had excluded it outweighs all that was expected.
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
    """The estimate that several batches make together.

    Attributes
    ----------
    probability
        The weighted mean of their estimates.
    observed_variance, predicted_variance
        Its variance as the runs show it, and as it was predicted before they were drawn.
    batches
        Number of batches.
    """

    probability: float
    observed_variance: float
    predicted_variance: float
    batches: int

    def interval(self, alpha: float) -> tuple[float, float]:
        """Return the 100 (1 - alpha) % interval by Student's t, whose end may be infinite.

        The larger of the two variances is taken: the observed one misses what was not seen, and the predicted
        one misses what the surrogate does not know.
        """
        error = math.sqrt(max(self.observed_variance, self.predicted_variance)) / self.probability
        return interval(self.probability, error, self.batches, alpha)

    def half_width(self, alpha: float) -> float:
        """Return half the width of the 100 (1 - alpha) % interval."""
        low, high = self.interval(alpha)
        return (high - low) / 2


def interval(probability: float, error: float, batches: int, alpha: float) -> tuple[float, float]:
    """Return all values that an estimate does not contradict, given how large its relative error is.

    What is known of an estimate Y is its coefficient of variation c: its standard deviation is c P, a share
    of the true P and not of Y. So the interval holds every P for which |Y - P| is at most t c P. It reaches
    farther up than down, as it should: an estimate that has met less of the event than it might have is low,
    and believes that it is exact.

    Parameters
    ----------
    probability
        The estimate Y.
    error
        Its coefficient of variation c.
    batches
        Number of batches, one more than the degrees of freedom of Student's t.
    alpha
        The interval is one of 100 (1 - alpha) %.

    Returns
    -------
    tuple of float
        Y / (1 + t c) and Y / (1 - t c); the second is infinite where t c is 1 or more.
    """
    reach = float(stdtrit(batches - 1, 1 - alpha / 2)) * error
    return probability / (1 + reach), probability / (1 - reach) if reach < 1 else math.inf


def estimate_batch(batch: TwoPhaseBatch, happened: Flags) -> BatchEstimate:
    """Return the estimate of a batch and its variance as observed, given the flags of its runs, shape (n,).

    The variance of the second phase is that of runs taken independently of each other, to which points that
    were almost certain to be included add nothing. That of the first phase is estimated by a difference
    estimator too, so it may come out negative, and then 0 takes its place.
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


def that_count(batches: Sequence[BatchEstimate]) -> Sequence[BatchEstimate]:
    """Return the batches of which the estimate is made: the last ones that share one view of the event.

    The estimate begins with a batch for which the surrogate was usable and agreed with what it foretold for
    the batch before. It begins anew when the surrogate no longer agrees with what it foretold for the first
    of them, and after a surprise: in both cases the earlier batches were designed by a view of the event that
    has turned out to be wrong, and would hide in the mean what they have missed.
    """
    first, view = None, 0.0
    for i, batch in enumerate(batches):
        now = batch.prediction.probability
        agrees = min(now, view) > 0 and 1 / AGREEMENT < now / view < AGREEMENT
        if not agrees:
            first = None
        elif first is None and batch.prediction.variation < USABLE**2:
            first = i
        if first is None or first == i:
            view = now
        if batch.surprising:
            first, view = None, 0.0
    return batches[len(batches) if first is None else first :]


def combine(batches: Sequence[BatchEstimate]) -> Combined:
    """Return the mean of the batches' estimates, weighted by their importance, and its two variances.

    Weights that look at the estimates or at their observed variances would prefer low estimates, whose
    observed variances are small as well.
    """
    weight = np.array([batch.importance for batch in batches])
    weight /= weight.sum()
    probability = float(weight @ np.array([batch.probability for batch in batches]))
    observed = weight**2 @ np.array([batch.observed_variance for batch in batches])
    variations = np.array([batch.prediction.variation / batch.runs for batch in batches])
    return Combined(
        probability, float(observed), float(weight**2 @ variations * probability**2), len(batches)
    )
