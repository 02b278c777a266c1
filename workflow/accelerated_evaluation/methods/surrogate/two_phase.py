"""Two-phase sampling: simulations are chosen from a large weighted pool of points that itself costs none.

A pool of M points z_j ~ h has the weights w_j = phi(z_j) / h(z_j). The runs are a sample of the pool in which
point j is included with probability pi_j. With a control variate g, the difference estimator

    Y = 1/M [ sum over the pool of w_j g_j  +  sum over the runs of w_i (1{event}_i - g_i) / pi_i ]

has the mean P(event) (Sarndal, Swensson and Wretman 1992, chapter 6). Its variance is smallest for pi_j
proportional to w_j sqrt(E (1{event}_j - g_j)^2). Notebook 10 derives both.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from accelerated_evaluation.distributions.protocol import Array
from accelerated_evaluation.methods.surrogate.constants import (
    CONTROLLED,
    CORE,
    DEFENCE,
    FLOOR,
    FRINGE,
    WORTHLESS,
)

Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Expectation:
    """What the surrogate expects at the points of a pool; arrays of shape (m,).

    Attributes
    ----------
    probability
        Of the event, at points at which runs may be aimed, and 0 at all others.
    control
        The control variate g.
    error
        The mean squared error E (1{event} - g)^2.
    """

    probability: Array
    control: Array
    error: Array

    @property
    def spread(self) -> Array:
        """Square root of the error, raised a little where the surrogate believes that it makes none."""
        return np.sqrt(self.error + FLOOR * self.probability)


@dataclass(frozen=True)
class Prediction:
    """What the surrogate expects of a batch before the batch is drawn.

    Attributes
    ----------
    probability
        P(event) by the surrogate alone.
    variation
        Squared coefficient of variation that a single run will have.
    """

    probability: float
    variation: float


@dataclass(frozen=True)
class TwoPhaseBatch:
    """A batch of the second phase: its runs, and what is needed to make an estimate of their outcomes.

    Attributes
    ----------
    z
        Normal scores to simulate, shape (n, d).
    weight
        The runs' phi / h, divided by the number of points of the pool, shape (n,).
    control, inclusion
        The runs' control variates g and inclusion probabilities pi, shape (n,).
    controlled, controlled_square
        Sums over the whole pool of w g and of w^2 g, with w as in ``weight``.
    importance
        Weight k_b of the batch in the estimate. It depends on earlier batches alone.
    predicted_variation
        Squared coefficient of variation of the batch's estimate, predicted before the batch was drawn.
    is_usable
        Whether the surrogate was good enough for an estimate that can be trusted.
    """

    z: Array
    weight: Array
    control: Array
    inclusion: Array
    controlled: float
    controlled_square: float
    importance: float
    predicted_variation: float
    is_usable: bool
    wide_runs: float
    aimed: Flags
    predicted: float


@dataclass(frozen=True)
class BatchEstimate:
    """What a batch of the second phase says of P(event).

    Attributes
    ----------
    probability
        The estimate Y.
    observed_variance
        Variance of Y as its own runs show it, both phases together.
    importance, predicted_variation, is_usable
        As in `TwoPhaseBatch`.
    """

    probability: float
    observed_variance: float
    importance: float
    predicted_variation: float
    is_usable: bool


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

    def half_width(self, alpha: float) -> float:
        """Half-width of the 100 (1 - alpha) % interval by Student's t.

        The larger of the two variances is taken: the observed one misses what was not seen, and the predicted
        one misses what the surrogate does not know.
        """
        variance = max(self.observed_variance, self.predicted_variance)
        return float(stdtrit(self.batches - 1, 1 - alpha / 2) * math.sqrt(variance))


def expect(weight: Array, probability: Array, fringe_limit: float) -> Expectation:
    """Say at which points of a pool runs may be aimed, and what the surrogate expects there.

    Runs are aimed at the core, where the surrogate's probability is at least `CORE`, and at the fringe, where
    it is at least `FRINGE` and the weight is at most ``fringe_limit``. Elsewhere the probability counts as 0:
    it never falls far below one over the number of runs, however safe a place is, and the bulk of phi would
    drown the event.

    Parameters
    ----------
    weight
        phi / h at the points, shape (m,).
    probability
        Of the event at the points, by the surrogate, shape (m,).
    fringe_limit
        Largest weight of a point of the fringe.
    """
    aimed = (probability >= CORE) | ((weight <= fringe_limit) & (probability >= FRINGE))
    p = np.where(aimed, probability, 0.0)
    control = np.where(p >= CONTROLLED, p, 0.0)
    return Expectation(p, control, p * (1 - p) + (p - control) ** 2)


def predict(weight: Array, expected: Expectation, guard: Array, runs: int, pool_size: int) -> Prediction:
    """Predict P(event) and the variance of a batch from a pool that is not the batch's own.

    The pool must be another one because the prediction decides how much the batch counts, and that must not
    depend on the batch.

    Parameters
    ----------
    weight
        phi / h at the points of the pool, shape (m,).
    expected
        What the surrogate expects at these points.
    runs, pool_size
        Number of runs that the batch will take from a pool of ``pool_size`` points.
    """
    size, probability = len(weight), float((weight * expected.probability).mean())
    if probability == 0:
        return Prediction(0.0, WORTHLESS)
    runs_here = runs * size / pool_size  # as many of this pool as of the batch's own, in proportion
    inclusion = inclusion_probabilities(weight * expected.spread, guard, runs_here)
    second_phase = (weight * weight * expected.error / inclusion).sum() / size**2
    first_phase = max((weight * weight * expected.probability).mean() - probability**2, 0.0) / size
    return Prediction(probability, float(runs_here * (second_phase + first_phase) / probability**2))


def inclusion_probabilities(size: Array, guard: Array, n: float) -> Array:
    size = size if size.any() else guard
    size = (1 - DEFENCE) * size / size.sum() + DEFENCE * guard / guard.sum()
    certain = np.zeros(len(size), bool)
    while True:
        inclusion = np.where(certain, 1.0, (n - certain.sum()) * size / size[~certain].sum())
        if not (new := (inclusion >= 1) & ~certain).any():
            return inclusion
        certain |= new


def draw_systematically(
    z: Array, importance: Array, inclusion: Array, generator: np.random.Generator
) -> NDArray[np.intp]:
    """Draw points of a pool by systematic sampling with given probabilities, and return their indices.

    The points are put in order along the principal axis of those that matter, and the inclusion probabilities
    are added up in this order. A run is taken wherever the sum passes u, u + 1, u + 2, ... with one uniform
    u. This keeps every inclusion probability and spreads the runs over the axis, like one stratum for each
    run.

    Parameters
    ----------
    z
        Normal scores of the pool, shape (m, d).
    importance
        How much each point matters for the axis, shape (m,).
    inclusion
        Inclusion probabilities, shape (m,); their sum is the number of runs.
    generator
        Source of the one uniform number.
    """
    share = importance / importance.sum() if importance.any() else np.full(len(z), 1 / len(z))
    centred = z - share @ z
    order = np.argsort(centred @ np.linalg.eigh((centred.T * share) @ centred)[1][:, -1])
    marks, n = np.cumsum(inclusion[order]), round(inclusion.sum())
    # The marks are scaled because rounding may leave their last one a little below n.
    return order[np.searchsorted(marks / marks[-1] * n, generator.random() + np.arange(n))]


def estimate_batch(batch: TwoPhaseBatch, happened: Flags) -> BatchEstimate:
    """Return the estimate of a batch and its variance as observed, given the flags of its runs, shape (n,).

    The variance of the second phase is that of runs taken independently of each other, to which points that
    were almost certain to be included add nothing. That of the first phase is estimated by a difference
    estimator too, so it may come out negative, and then 0 takes its place.
    """
    terms = batch.weight * (happened - batch.control) / batch.inclusion
    first_phase = max(batch.controlled_square + batch.weight @ terms, 0.0)
    second_phase = (terms**2 * (1 - batch.inclusion)).sum() * len(happened) / max(len(happened) - 1, 1)
    return BatchEstimate(
        probability=float(batch.controlled + terms.sum()),
        observed_variance=float(first_phase + second_phase),
        importance=batch.importance,
        predicted_variation=batch.predicted_variation,
        is_usable=batch.is_usable and not is_surprising(batch, happened),
    )


def is_surprising(batch: TwoPhaseBatch, happened: Flags) -> bool:
    """Whether an event where none was expected outweighs all that was expected of the batch."""
    return bool((happened & ~batch.aimed & (batch.weight / batch.inclusion > batch.predicted)).any())


def since_usable(batches: Sequence[BatchEstimate]) -> Sequence[BatchEstimate]:
    """Return the batches of which the estimate is made: those since the surrogate first was usable.

    """
    return batches[max((i + 1 for i, batch in enumerate(batches) if not batch.is_usable), default=0) :]


def combine(batches: Sequence[BatchEstimate]) -> Combined:
    """Return the mean of the batches' estimates, weighted by their importance, and its two variances.

    The importance depends on the past only, so that the weighted errors of the batches are a martingale.
    Weights that look at the estimates or at their observed variances would prefer low estimates, whose
    observed variances are small as well.
    """
    weight = np.array([batch.importance for batch in batches])
    weight /= weight.sum()
    probability = float(weight @ np.array([batch.probability for batch in batches]))
    observed = weight**2 @ np.array([batch.observed_variance for batch in batches])
    predicted = weight**2 @ np.array([batch.predicted_variation for batch in batches]) * probability**2
    return Combined(probability, float(observed), float(predicted), len(batches))
