"""Two-phase sampling: simulations are chosen from a large weighted pool of points that itself costs none.

A pool of M points z_j ~ h has the weights w_j = phi(z_j) / h(z_j). The runs are a sample of the pool in which
point j is included with probability pi_j. With a control variate g, the difference estimator

    Y = 1/M [ sum over the pool of w_j g_j  +  sum over the runs of w_i (1{event}_i - g_i) / pi_i ]

has the mean P(event) (Sarndal, Swensson and Wretman 1992, chapter 6). Its variance is smallest for pi_j
proportional to w_j sqrt(E (1{event}_j - g_j)^2). Notebook 10 derives both.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.methods.surrogate.constants import (
    BEYOND,
    CONTROLLED,
    CORE,
    DEFENCE,
    EVEN,
    FLOOR,
    FRINGE,
    KEPT,
    REACH,
    WORTHLESS,
)

Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Pool:
    """Points of the first phase, which cost no simulation; arrays of shape (m,).

    Attributes
    ----------
    z
        The points, shape (m, d).
    weight
        phi / h, with h the law that the points were drawn from.
    probability
        Of the event.
    wide
        Density of the wide law over h.
    rarity
        -log P(|Z| > |z|) of the points.
    """

    z: Array
    weight: Array
    probability: Array
    wide: Array
    rarity: Array

    def within(self, begin: float, end: float) -> Array:
        """Return the density over h of the wide law between two rarities, shape (m,)."""
        there = (begin < self.rarity) & (self.rarity <= end)
        return np.where(there, self.wide * REACH / (end - begin), 0.0)

    def guard(self, reach: float, defence: "Defence") -> Array:
        """Return how the defensive share is spread: as the wide law, and to the share `EVEN` evenly.

        Points so far out that their weight is 0 get nothing: there may be no cut-in for such scores. Where an
        unseen part is looked for, the wide law is that beyond its nearest point, and takes all that exceeds
        the usual share.
        """
        evenly = np.where(self.weight > 0, EVEN, 0.0)
        if not 0 < defence.beyond < reach:
            return evenly + (1 - EVEN) * self.within(0.0, reach)
        return DEFENCE * evenly + (defence.share - EVEN * DEFENCE) * self.within(defence.beyond, reach)


@dataclass(frozen=True)
class Defence:
    """Which runs are spread whatever the surrogate believes.

    Attributes
    ----------
    share
        Their share.
    beyond
        Rarity of the nearest point of a part that is looked for; 0 where none is.
    """

    share: float = DEFENCE
    beyond: float = 0.0

    def zones(self, reach: float) -> list[tuple[float, float]]:
        """Return the ranges of rarities over which this share is spread alike."""
        return [(0.0, self.beyond), (self.beyond, reach)] if 0 < self.beyond < reach else [(0.0, reach)]


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

    @property
    def reach(self) -> float:
        """Rarity beyond which hardly any of the probability can be."""
        return reach_of(self.probability)


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
    aimed
        Whether the event was held possible at the runs, shape (n,), so that they were aimed at.
    looks
        Draws of the wide law that the defence stands for: their number, and the rarities between which they
        are, shape (1 or 2, 3).
    prediction
        What was expected of the batch before it was drawn.
    foreseen
        Probabilities that the two surrogates give to the runs, before calibration, shape (n, 2).
    kept, kept_weight
        Points of the pool, shape (k, d), each of which stands for an equal part of ``controlled``, and their
        phi / h, divided by the number of points of the pool, shape (k,). With them the control variate can be
        integrated under another law. Both are empty where the control variate is 0 everywhere.
    """

    z: Array
    weight: Array
    control: Array
    inclusion: Array
    controlled: float
    controlled_square: float
    aimed: Flags
    looks: Array
    prediction: Prediction
    foreseen: Array
    kept: Array = field(default_factory=lambda: np.empty((0, 0)))
    kept_weight: Array = field(default_factory=lambda: np.empty(0))


def reach_of(probability: float) -> float:
    """Return the rarity beyond which hardly any of a probability can be."""
    return min(BEYOND - math.log(probability), REACH) if probability > 0 else REACH


def expect(pool: Pool, fringe_limit: float) -> Expectation:
    """Say at which points of a pool runs may be aimed, and what the surrogate expects there.

    Runs are aimed at the core, where the surrogate's probability is at least `CORE`, and at the fringe, where
    it is at least `FRINGE` and the weight is at most ``fringe_limit``. Elsewhere the probability counts as 0:
    it never falls far below one over the number of runs, however safe a place is, and the bulk of phi would
    drown the event.
    """
    p = pool.probability
    aimed = (p >= CORE) | ((pool.weight <= fringe_limit) & (p >= FRINGE))
    p = np.where(aimed, p, 0.0)
    control = np.where(p >= CONTROLLED, p, 0.0)
    return Expectation(p, control, p * (1 - p) + (p - control) ** 2)


def predict(pool: Pool, expected: Expectation, runs: int, pool_size: int, defence: Defence) -> Prediction:
    """Predict P(event) and the variance of a batch from a pool that is not the batch's own.

    The pool must be another one because the prediction decides how much the batch counts, and that must not
    depend on the batch.

    Parameters
    ----------
    pool
        Another pool than that of the batch.
    expected
        What the surrogate expects at its points.
    runs, pool_size
        Number of runs that the batch will take from a pool of ``pool_size`` points.
    defence
        Defensive share of the runs.
    """
    weight, size = pool.weight, len(pool.weight)
    probability = float((weight * expected.probability).mean())
    if probability == 0:
        return Prediction(0.0, WORTHLESS)
    runs_here = runs * size / pool_size  # as many of this pool as of the batch's own, in proportion
    guard = pool.guard(reach_of(probability), defence)
    inclusion = inclusion_probabilities(weight * expected.spread, guard, runs_here, defence.share)
    square = weight * weight * expected.error
    second_phase = np.divide(square, inclusion, out=square, where=inclusion > 0).sum() / size**2
    first_phase = max((weight * weight * expected.probability).mean() - probability**2, 0.0) / size
    return Prediction(probability, float(runs_here * (second_phase + first_phase) / probability**2))


def inclusion_probabilities(size: Array, guard: Array, n: float, defence: float) -> Array:
    """Return inclusion probabilities that sum to n and, below 1, are proportional to a size.

    A point whose probability would exceed 1 is included for certain, and the others share what is left; that
    may bring further points to 1, hence the loop.

    Parameters
    ----------
    size
        What the probabilities should be proportional to, shape (m,).
    guard
        How the defensive share is spread, positive where anything can be, shape (m,).
    n
        Sum of the probabilities.
    defence
        Defensive share, which is mixed into the size first, so that the probabilities are positive there.
    """
    size = size if size.any() else guard
    size = (1 - defence) * size / size.sum() + defence * guard / guard.sum()
    certain = np.zeros(len(size), bool)
    while True:
        inclusion = np.where(certain, 1.0, (n - certain.sum()) * size / size[~certain].sum())
        if not (new := (inclusion >= 1) & ~certain).any():
            return inclusion
        certain |= new


def draws_of_the_wide_law(wide: Array, inclusion: Array) -> float:
    """Return how many draws of a wide law a sample of the pool is worth, wherever the event may be.

    N draws of the law would include a point with the probability N (wide / h) / m. This is the largest N
    for which no point is included with less. ``wide`` is the density of the law over h, shape (m,).
    """
    within = wide > 0
    return float((inclusion[within] / wide[within]).min() * len(inclusion)) if within.any() else 0.0


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
    order = along_principal_axis(z, importance)
    marks, n = np.cumsum(inclusion[order]), round(inclusion.sum())
    # The marks are scaled because rounding may leave their last one a little below n.
    return order[np.searchsorted(marks / marks[-1] * n, generator.random() + np.arange(n))]


def along_principal_axis(z: Array, importance: Array) -> NDArray[np.intp]:
    """Return the order of points, shape (m, d), along the principal axis of those that matter, shape (m,)."""
    share = importance / importance.sum() if importance.any() else np.full(len(z), 1 / len(z))
    centred = z - share @ z
    return np.argsort(centred @ np.linalg.eigh((centred.T * share) @ centred)[1][:, -1])


def spread_by_mass(z: Array, mass: Array, count: int) -> NDArray[np.intp]:
    """Return the indices of points of a pool that each stand for an equal part of a mass.

    The points are put in order along the principal axis of the mass, and the point in the middle of each
    of ``count`` equal parts of the mass is taken. No random number is drawn.

    Parameters
    ----------
    z
        Normal scores of the pool, shape (m, d).
    mass
        Of each point, not negative, shape (m,).
    count
        Number of indices; there are none where all the mass is 0.
    """
    if not mass.any():
        return np.empty(0, dtype=np.intp)
    order = along_principal_axis(z, mass)
    marks = np.cumsum(mass[order])
    return order[np.searchsorted(marks / marks[-1] * count, np.arange(count) + 0.5)]


def draw_batch(
    pool: Pool,
    expected: Expectation,
    prediction: Prediction,
    runs: int,
    defence: Defence,
    foresee: Callable[[Array], Array],
    generator: np.random.Generator,
) -> TwoPhaseBatch:
    """Draw the runs of a batch from its pool.

    Parameters
    ----------
    pool, expected
        The pool of the batch, and what the surrogate expects at its points.
    prediction
        What was expected of the batch before its pool was drawn.
    runs
        Number n of runs.
    defence
        Defensive share of the runs.
    foresee
        Function that returns what the two surrogates say of points, shape (n, 2).
    generator
        Source of all randomness.
    """
    w, control = pool.weight, expected.control
    guard = pool.guard(prediction.reach, defence)
    inclusion = inclusion_probabilities(w * expected.spread, guard, runs, defence.share)
    chosen = draw_systematically(pool.z, w * np.sqrt(expected.probability), inclusion, generator)
    zones = defence.zones(prediction.reach)
    looks = [[draws_of_the_wide_law(pool.within(*zone), inclusion), *zone] for zone in zones]
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
        looks=np.array(looks),
        prediction=prediction,
        foreseen=foresee(pool.z[chosen]),
        kept=pool.z[kept],
        kept_weight=w[kept],
    )
