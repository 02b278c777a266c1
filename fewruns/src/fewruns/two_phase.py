"""Two-phase sampling: runs are chosen from a large weighted pool, with given inclusion probabilities.

The M points z_j of a pool are drawn from a density h, and have the weights w_j = phi(z_j) / h(z_j), where phi
is the standard normal density. The runs are a sample of the pool in which point j is included with
probability pi_j. With a control variate g, the difference estimator

    Y = 1/M [ sum over the pool of w_j g_j  +  sum over the runs of w_i (1{event}_i - g_i) / pi_i ]

has the mean P(event) (Sarndal, Swensson and Wretman 1992, chapter 6). Its variance is smallest for pi_j
proportional to w_j sqrt(E (1{event}_j - g_j)^2). method.md derives both results.
"""

import math
from dataclasses import dataclass
from typing import Annotated, Self

import numpy as np

from fewruns.arrays import Array, Flags, Function, Generator, Indices
from fewruns.constants import BEYOND, CONTROLLED, CORE, FLOOR, FRINGE, KEPT, LARGEST, REACH
from fewruns.pools import Defence, Pool


def inclusion_probabilities(size: Array, guard: Array, n: float, defence: float) -> Array:
    """Return inclusion probabilities, shape (m,), with the sum n, for a mixture of ``size`` and ``guard``.

    A point whose probability would exceed 1 is included with certainty, and the rest is divided again.
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
    """Return the number N of draws from a wide law to which a sample of m points is equivalent.

    It is the largest N for which no inclusion probability is smaller than N wide / m.
    """
    within = wide > 0
    with np.errstate(over="ignore"):  # where the wide density underflows; such points are not the minimum
        draws = inclusion[within] / wide[within]
    return float(draws.min() * len(inclusion)) if within.any() else 0.0


def draw_systematically(z: Array, importance: Array, inclusion: Array, generator: Generator) -> Indices:
    """Draw points of a pool by systematic sampling with given inclusion probabilities; return their indices.

    Along the principal axis of the important points, a point is selected wherever the cumulated probability
    passes u, u + 1, ... for one uniform number u. The runs are then spread like a stratified sample.
    """
    order = along_principal_axis(z, importance)
    marks, n = np.cumsum(inclusion[order]), round(inclusion.sum())
    # The marks are scaled, because the last one may be slightly below n by rounding.
    scaled = marks * (n / marks[-1]) if n else marks
    return order[np.searchsorted(scaled, generator.random() + np.arange(n))]


def along_principal_axis(z: Array, importance: Array) -> Indices:
    """Return the indices that sort weighted points, shape (m, d), along their first principal axis."""
    share = importance / importance.sum() if importance.any() else np.full(len(z), 1 / len(z))
    centred = z - share @ z
    return np.argsort(centred @ np.linalg.eigh((centred.T * share) @ centred)[1][:, -1])


def spread_by_mass(z: Array, mass: Array, count: int) -> Indices:
    """Return the indices of ``count`` points that represent equal parts of a mass; none if it is 0."""
    if not mass.any():
        return np.empty(0, dtype=np.intp)
    order = along_principal_axis(z, mass)
    marks = np.cumsum(mass[order])
    return order[np.searchsorted(marks / marks[-1] * count, np.arange(count) + 0.5)]


@dataclass(frozen=True)
class Expectation:
    """The predictions of the surrogate at the points of a pool; arrays of shape (m,)."""

    # Predicted probability of the event at points of the core and the fringe, and 0 at all others.
    probability: Array
    control: Array  # the control variate g
    error: Array  # the mean squared error E (1{event} - g)^2
    # Factor of the inclusion probabilities at points of the core and the fringe.
    emphasis: Array | float = 1.0

    @property
    def spread(self) -> Array:
        """The factor of the inclusion probabilities: emphasis sqrt(error + `FLOOR` probability)."""
        return self.emphasis * np.sqrt(self.error + FLOOR * self.probability)


@dataclass(frozen=True)
class Prediction:
    """The surrogate's prediction for a batch before the batch is drawn."""

    probability: float  # predicted P(event)
    variation: float  # predicted squared coefficient of variation of a single run


@dataclass(frozen=True)
class TwoPhaseBatch:
    """A batch of the second phase: its n runs, and what an estimate from their outcomes needs."""

    z: Annotated[Array, "batch", "dimension"]  # normal scores to simulate
    # Weights phi / h of the runs, divided by the number of points of the pool.
    weight: Annotated[Array, "batch"]
    control: Annotated[Array, "batch"]  # control variates g of the runs
    inclusion: Annotated[Array, "batch"]  # inclusion probabilities pi of the runs
    controlled: float  # sum over the whole pool of w g, with w as in ``weight``
    controlled_square: float  # sum over the whole pool of w^2 g
    # Whether a run was sampled preferentially because the surrogates predicted that the event is possible
    # there; of a run of a cover, whether they had predicted this when a batch was last sampled.
    aimed: Annotated[Flags, "batch"]
    # Draws from the wide distribution to which the batch is equivalent: number, smallest and largest rarity.
    wide_draws: Annotated[Array, "zones", 3]
    prediction: Prediction
    # Probabilities that the two surrogates predict for the runs, before calibration.
    foreseen: Annotated[Array, "batch", 2]
    # Points of the pool, each of which represents an equal part of ``controlled``; with them, the control
    # variate can be integrated under another law. There are none if the control variate is 0 at all points.
    kept: Annotated[Array, "kept", "dimension"]
    kept_weight: Annotated[Array, "kept"]  # weights phi / h, divided by the number of points of the pool
    kept_control: Annotated[Array, "kept"]

    @classmethod
    def of_cover(cls, z: Array, aimed: Flags, prediction: Prediction, foreseen: Array) -> Self:
        """Return n runs of a cover, which only exclude other parts of the event; their weight is 0."""
        none, nothing = np.zeros(len(z)), np.empty(0)
        pool = (z[:0], nothing, nothing)
        return cls(z, none, none, none + 1, 0.0, 0.0, aimed, np.empty((0, 3)), prediction, foreseen, *pool)


def reach_of(probability: float) -> float:
    """Return the rarity -log(probability) + `BEYOND`, at most `REACH`: 5 % of an event can be beyond."""
    return min(BEYOND - math.log(probability), REACH) if probability > 0 else REACH


def expect(pool: Pool, fringe_limit: float, emphasis: Function | None = None) -> Expectation:
    """Return the surrogate's expectations at the points of a pool.

    Runs are sampled preferentially from the core, where the predicted probability is at least `CORE`, and
    from the fringe, where it is at least `FRINGE` and the weight is at most ``fringe_limit``. Elsewhere it
    is set to 0, because it is never far below one over the number of runs, and the bulk of phi would outweigh
    the event.
    """
    p = pool.probability
    aimed = (p >= CORE) | ((pool.weight <= fringe_limit) & (p >= FRINGE))
    p = np.where(aimed, p, 0.0)
    control = np.where(p >= CONTROLLED, p, 0.0)
    factor = np.ones(len(p))
    if emphasis is not None and aimed.any():
        factor[aimed] = emphasis(pool.z[aimed])
    return Expectation(p, control, p * (1 - p) + (p - control) ** 2, factor)


def predict(pool: Pool, expected: Expectation, runs: int, pool_size: int, defence: Defence) -> Prediction:
    """Return the predicted P(event) and variation of a batch; ``pool`` must not be the pool of the batch."""
    weight, size = pool.weight, len(pool.weight)
    probability = float((weight * expected.probability).mean())
    if probability == 0:
        return Prediction(0.0, LARGEST)
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
    foresee: Function,
    generator: Generator,
) -> TwoPhaseBatch:
    """Return a batch of runs that are drawn from a pool by systematic sampling.

    ``foresee`` returns the probabilities of the event at the runs by both surrogates, shape (n, 2).
    """
    w, control, reach = pool.weight, expected.control, reach_of(prediction.probability)
    guard = pool.guard(reach, defence)
    inclusion = inclusion_probabilities(w * expected.spread, guard, runs, defence.share)
    chosen = draw_systematically(pool.z, w * np.sqrt(expected.probability), inclusion, generator)
    zones = defence.zones(reach)
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
