"""Two-phase sampling: runs are taken from a large weighted pool that itself costs none.

A pool of M points z_j ~ h has weights w_j = phi(z_j) / h(z_j). Runs are taken out of it with inclusion
probabilities pi_j, and with a control variate g the difference estimator

    Y = 1/M [ sum_pool w_j g_j + sum_runs w_i (1{event}_i - g_i) / pi_i ]

has the mean P (Sarndal, Swensson and Wretman 1992, chapter 6). Its variance is smallest for pi_j proportional
to w_j sqrt(E (1{event}_j - g_j)^2).
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from accelerated_evaluation.distributions.protocol import Array

DEFENCE = 0.2  # share of the inclusion probabilities spread evenly over the pool
CORE = 0.05  # p from which a point is aimed at whatever its weight
FRINGE = 0.001  # p from which it is where it weighs no more than
FRINGE_WEIGHT = 10.0  # times what points of the core do
CONTROLLED = 0.3  # p from which it is the control variate
WORTHLESS = 1e100  # squared coefficient of variation where nothing is expected; JSON has no infinity
FLOOR = 0.1  # share of p in the size of a point, for the surrogate may be wrong where it is sure


def aim(w: Array, p: Array, limit: float) -> tuple[Array, Array, Array]:
    """Return p where a run may be aimed, 0 elsewhere; the control variate g; and E (1{event} - g)^2.

    p never falls far below one over the number of runs, however safe a place is. Aimed at is only the core
    and its fringe, up to the weight ``limit``: otherwise the bulk of phi would drown the event.
    """
    p = np.where((p >= CORE) | ((w <= limit) & (p >= FRINGE)), p, 0.0)
    g = np.where(p >= CONTROLLED, p, 0.0)
    return p, g, p * (1 - p) + (p - g) ** 2


def foretell(w: Array, p: Array, g: Array, error: Array, n: int, pool_size: int) -> tuple[float, float]:
    """Return P as the surrogate has it, and the squared coefficient of variation that a run will have.

    Parameters
    ----------
    w, p, g, error
        Of a pool that is not the batch's own; the last three as from `aim`.
    n
        Runs that are to be taken from a pool of ``pool_size`` points.
    """
    size, mean = len(w), float((w * p).mean())
    if mean == 0:
        return 0.0, WORTHLESS
    runs = n * size / pool_size
    second_phase = (w * w * error / inclusion(w * np.sqrt(error + FLOOR * p), runs)).sum() / size**2
    first_phase = max((w * w * p).mean() - mean**2, 0.0) / size
    return mean, float(runs * (second_phase + first_phase) / mean**2)


def inclusion(size: Array, n: float) -> Array:
    """Inclusion probabilities min(1, c size) that sum to n, the defensive share of the size spread evenly."""
    size = size if size.any() else np.ones_like(size)
    size = (1 - DEFENCE) * size / size.sum() + DEFENCE / len(size)
    certain = np.zeros(len(size), bool)
    while True:
        pi = np.where(certain, 1.0, (n - certain.sum()) * size / size[~certain].sum())
        if not (new := (pi >= 1) & ~certain).any():
            return pi
        certain |= new


def systematic(z: Array, importance: Array, pi: Array, generator: np.random.Generator) -> NDArray[np.intp]:
    """Systematic sampling along the principal axis of the important points, which it so stratifies."""
    share = importance / importance.sum() if importance.any() else np.full(len(z), 1 / len(z))
    centred = z - share @ z
    order = np.argsort(centred @ np.linalg.eigh((centred.T * share) @ centred)[1][:, -1])
    marks, n = np.cumsum(pi[order]), round(pi.sum())
    return order[np.searchsorted(marks / marks[-1] * n, generator.random() + np.arange(n))]


def account(batch: Mapping[str, Any], event: NDArray[np.bool_]) -> dict[str, Any]:
    """Estimate of a batch, and its variance as observed in both phases."""
    w, g, pi = (np.asarray(batch[name]) for name in ("w", "g", "pi"))
    terms = w * (event - g) / pi
    first_phase = max(batch["controlled_square"] + w @ terms, 0.0)
    second_phase = (terms**2 * (1 - pi)).sum() * len(event) / max(len(event) - 1, 1)
    kept = {name: batch[name] for name in ("weight", "foretold", "usable")}
    return {"estimate": batch["controlled"] + terms.sum(), "observed": first_phase + second_phase} | kept


def counted(batches: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the batches that the estimate is made of: those since the surrogate became usable."""
    return batches[next((i for i, batch in enumerate(batches) if batch["usable"]), len(batches)) :]


def combine(batches: list[dict[str, Any]], alpha: float) -> tuple[float, float]:
    """Return the weighted mean of the batches' estimates and the half-width of its interval, by Student's t.

    Its variance is the larger of the observed one and the one foretold: the first misses what was not seen,
    the second what the surrogate does not know.
    """
    estimate, weight, foretold, observed = (
        np.array([batch[name] for batch in batches])
        for name in ("estimate", "weight", "foretold", "observed")
    )
    weight /= weight.sum()
    probability = float(weight @ estimate)
    variance = max(weight**2 @ observed, weight**2 @ foretold * probability**2)
    return probability, float(stdtrit(len(batches) - 1, 1 - alpha / 2) * math.sqrt(variance))
