"""Two-phase sampling: runs are chosen from a large weighted pool of points, and only the runs are simulated.

The M points z_j of a pool are drawn from a density h, and have the weights w_j = phi(z_j) / h(z_j), where phi
is the standard normal density. The runs are a sample of the pool in which point j is included with
probability pi_j. With a control variate g, the difference estimator

    Y = 1/M [ sum over the pool of w_j g_j  +  sum over the runs of w_i (1{event}_i - g_i) / pi_i ]

has the mean P(event) (Sarndal, Swensson and Wretman 1992, chapter 6). Its variance is smallest for pi_j
proportional to w_j sqrt(E (1{event}_j - g_j)^2). Notebook 10 derives both results.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from fewruns.arrays import Array, Flags
from fewruns.constants import (
    BEYOND,
    CONTROLLED,
    CORE,
    FLOOR,
    FRINGE,
    KEPT,
    REACH,
    WORTHLESS,
)
from fewruns.pools import Defence, Pool
from fewruns.selection import (
    draw_systematically,
    draws_of_the_wide_law,
    inclusion_probabilities,
    spread_by_mass,
)


@dataclass(frozen=True)
class Expectation:
    """The predictions of the surrogate at the points of a pool; arrays of shape (m,).

    The core and the fringe are the points at which runs are sampled preferentially; `expect` defines both.

    Attributes
    ----------
    probability
        Predicted probability of the event at points of the core and the fringe, and 0 at all others.
    control
        The control variate g.
    error
        The mean squared error E (1{event} - g)^2.
    emphasis
        Factor of the inclusion probabilities at points of the core and the fringe; 1 if the estimate is only
        for the law that defines the normal scores.
    """

    probability: Array
    control: Array
    error: Array
    emphasis: Array | float = 1.0

    @property
    def spread(self) -> Array:
        """The factor of the inclusion probabilities, emphasis sqrt(error + `FLOOR` probability), shape (m,).

        Without the second term, points at which a surrogate wrongly predicts almost no error would hardly be
        sampled. The inclusion probabilities are proportional to this factor times the weights.
        """
        return self.emphasis * np.sqrt(self.error + FLOOR * self.probability)


@dataclass(frozen=True)
class Prediction:
    """The surrogate's prediction for a batch before the batch is drawn.

    Attributes
    ----------
    probability
        Predicted P(event).
    variation
        Predicted squared coefficient of variation of a single run.
    """

    probability: float
    variation: float

    @property
    def reach(self) -> float:
        """Rarity beyond which at most 5 % of the predicted probability of the event can be."""
        return reach_of(self.probability)


@dataclass(frozen=True)
class TwoPhaseBatch:
    """A batch of the second phase: its n runs, and what is needed to compute an estimate from their outcomes.

    Attributes
    ----------
    z
        Normal scores to simulate, shape (n, d).
    weight
        Weights phi / h of the runs, divided by the number of points of the pool, shape (n,).
    control, inclusion
        Control variates g and inclusion probabilities pi of the runs, shape (n,).
    controlled, controlled_square
        Sums over the whole pool of w g and of w^2 g, with w as in ``weight``.
    aimed
        Whether a run was sampled preferentially because the surrogates predicted that the event is possible
        there, shape (n,).
    wide_draws
        Draws from the wide distribution to which the batch is equivalent: number of draws, smallest and
        largest rarity, for one or two intervals of rarity, shape (1 or 2, 3).
    prediction
        The surrogate's prediction for the batch before it was drawn.
    foreseen
        Probabilities that the two surrogates predict for the runs, before calibration, shape (n, 2).
    kept, kept_weight, kept_control
        Points of the pool, shape (k, d), each of which represents an equal part of ``controlled``; their
        weights phi / h, divided by the number of points of the pool, shape (k,); and their control variates,
        shape (k,). With them, the control variate can be integrated under another law. They are empty if the
        control variate is 0 at all points.
    """

    z: Annotated[Array, "batch", "dimension"]
    weight: Annotated[Array, "batch"]
    control: Annotated[Array, "batch"]
    inclusion: Annotated[Array, "batch"]
    controlled: float
    controlled_square: float
    aimed: Annotated[Flags, "batch"]
    wide_draws: Annotated[Array, "zones", 3]
    prediction: Prediction
    foreseen: Annotated[Array, "batch", 2]
    kept: Annotated[Array, "kept", "dimension"]
    kept_weight: Annotated[Array, "kept"]
    kept_control: Annotated[Array, "kept"]


def reach_of(probability: float) -> float:
    """Return the rarity -log(probability) + `BEYOND`, but at most `REACH`, for an event of given probability.

    All points beyond this rarity together have at most exp(-`BEYOND`) = 5 % of the probability of the event.
    """
    return min(BEYOND - math.log(probability), REACH) if probability > 0 else REACH


def expect(
    pool: Pool,
    fringe_limit: float,
    fringe: float = FRINGE,
    emphasis: Callable[[Array], Array] | None = None,
) -> Expectation:
    """Return the surrogate's expectations at the points of a pool.

    Runs are sampled preferentially from the core, where the predicted probability is at least `CORE`, and
    from the fringe, where it is at least ``fringe`` and the weight is at most ``fringe_limit``. At all other
    points the probability is set to 0. The reason is that a predicted probability is never far below one over
    the number of runs, so the bulk of phi would otherwise outweigh the event.

    Parameters
    ----------
    pool
        Points with their weights and predicted probabilities.
    fringe_limit, fringe
        Largest weight, and smallest predicted probability, of a point of the fringe.
    emphasis
        Function that returns a factor for the inclusion probabilities at points of shape (n, d), shape (n,);
        None for a factor of 1.
    """
    p = pool.probability
    aimed = (p >= CORE) | ((pool.weight <= fringe_limit) & (p >= fringe))
    p = np.where(aimed, p, 0.0)
    control = np.where(p >= CONTROLLED, p, 0.0)
    factor = np.ones(len(p))
    if emphasis is not None and aimed.any():
        factor[aimed] = emphasis(pool.z[aimed])
    return Expectation(p, control, p * (1 - p) + (p - control) ** 2, factor)


def predict(pool: Pool, expected: Expectation, runs: int, pool_size: int, defence: Defence) -> Prediction:
    """Return the predicted P(event) and variation of a batch, from a pool that is independent of the batch.

    The prediction determines the weight of the batch in the estimate, and this weight must not depend on the
    batch itself.

    Parameters
    ----------
    pool
        A pool that is not used for the batch.
    expected
        The surrogate's expectations at its points.
    runs, pool_size
        Number of runs that the batch will select from a pool of ``pool_size`` points.
    defence
        Defensive share of the runs.
    """
    weight, size = pool.weight, len(pool.weight)
    probability = float((weight * expected.probability).mean())
    if probability == 0:
        return Prediction(0.0, WORTHLESS)
    runs_here = runs * size / pool_size  # the same share of this pool as of the pool of the batch
    guard = pool.guard(reach_of(probability), defence)
    inclusion = inclusion_probabilities(weight * expected.spread, guard, runs_here, defence.share)
    square = weight * weight * expected.error
    second_phase = np.divide(square, inclusion, out=square, where=inclusion > 0).sum() / size**2
    first_phase = max((weight * weight * expected.probability).mean() - probability**2, 0.0) / size
    return Prediction(probability, float(runs_here * (second_phase + first_phase) / probability**2))


def draw_batch(
    pool: Pool,
    expected: Expectation,
    prediction: Prediction,
    runs: int,
    defence: Defence,
    foresee: Callable[[Array], Array],
    generator: np.random.Generator,
) -> TwoPhaseBatch:
    """Return a batch whose runs are drawn from a pool by systematic sampling.

    Parameters
    ----------
    pool, expected
        The pool of the batch, and the surrogate's expectations at its points.
    prediction
        Prediction for the batch, made before its pool was drawn.
    runs
        Number n of runs.
    defence
        Defensive share of the runs.
    foresee
        Function that returns the uncalibrated predictions of the two surrogates at points, shape (n, 2).
    generator
        Source of all randomness.
    """
    w, control = pool.weight, expected.control
    guard = pool.guard(prediction.reach, defence)
    inclusion = inclusion_probabilities(w * expected.spread, guard, runs, defence.share)
    chosen = draw_systematically(pool.z, w * np.sqrt(expected.probability), inclusion, generator)
    zones = defence.zones(prediction.reach)
    wide_draws = [[draws_of_the_wide_law(pool.within(*zone), inclusion), *zone] for zone in zones]
    w = w / len(w)
    kept = spread_by_mass(pool.z, w * control, KEPT)
    return TwoPhaseBatch(
        z=pool.z[chosen],
        weight=w[chosen],
        control=control[chosen],
        inclusion=inclusion[chosen],
        controlled=float(w @ control),
        controlled_square=float(w * w @ control),
        aimed=expected.probability[chosen] > 0,
        wide_draws=np.array(wide_draws),
        prediction=prediction,
        foreseen=foresee(pool.z[chosen]),
        kept=pool.z[kept],
        kept_weight=w[kept],
        kept_control=control[kept],
    )
