"""Covariance, its derivatives, and selection of runs, for the Gaussian processes of the sampler.

The covariance of two points is amplitude^2 (1 + Matern 5/2); the constant 1 represents an unknown mean. All
points are divided by the lengths before they are passed to this module.
"""

import numpy as np
from numpy.typing import NDArray

from fewruns.arrays import Array
from fewruns.constants import JITTER

# Number of covariances that are computed at once, so that they fit into the cache of a processor.
BLOCK = 32_768


def covariance_between(
    a: Array, b: Array, variance: float, *, with_slope: bool = False
) -> tuple[Array, Array]:
    """Return the covariances between points of shapes (n, d) and (m, d), and slopes if wanted, shapes (n, m).

    The slopes are -2 times the derivatives of the correlations with respect to the squared distance.
    """
    value = np.empty((len(a), len(b)))
    slope = np.empty_like(value) if with_slope else np.empty((0, len(b)))
    # 5 |a - b|^2 = 5 (|a|^2 + |b|^2 - 2 a b) is one product of matrices.
    left = np.column_stack([a, (a * a).sum(axis=1), np.ones(len(a))])
    right = 5 * np.column_stack([-2 * b, np.ones(len(b)), (b * b).sum(axis=1)]).T
    rows = max(BLOCK // max(len(b), 1), 1)
    for first in range(0, len(a), rows):
        block = slice(first, first + rows)
        square = np.maximum(left[block] @ right, 0.0)
        r = np.sqrt(square)
        decay = np.exp(-r)
        if with_slope:
            slope[block] = 5 / 3 * (1 + r) * decay
        value[block] = variance * ((1 + r + square / 3) * decay + 1)
    return value, slope


def covariance_of_runs(runs: Array, variance: float, *, with_slope: bool = False) -> tuple[Array, Array]:
    """Return the covariance of runs, shape (n, n), with a small term on its diagonal, and its slopes."""
    covariance, slope = covariance_between(runs, runs, 1.0, with_slope=with_slope)
    covariance.flat[:: len(runs) + 1] += JITTER
    covariance *= variance
    return covariance, slope


def evidence_gradient(runs: Array, covariance: Array, slope: Array, outer: Array, variance: float) -> Array:
    """Return the gradient of a log evidence by log lengths and log amplitude, shape (d + 1,)."""
    # The derivative of the log evidence by the covariance matrix is ``outer``.
    slope = slope * (variance * outer)
    by_length = [(slope * np.subtract.outer(x, x) ** 2).sum() for x in runs.T]
    return np.array([*by_length, 2 * (outer * covariance).sum()])


def negative_log_posterior(
    evidence: float, gradient: Array, score: Array, scale: Array
) -> tuple[float, Array]:
    """Return the negative log posterior density of k parameters with a normal prior, and its gradient."""
    return 0.5 * score @ score - evidence, score / scale - gradient


def principal_axes(points: Array) -> list[Array]:
    """Return [principal axes of points as columns, shape (d, d)], or [] if at most d points differ."""
    if len(np.unique(points, axis=0)) <= points.shape[1]:
        return []
    return [np.linalg.eigh(np.atleast_2d(np.cov(points.T)))[1]]


def thinned(order: NDArray[np.intp], most: int) -> NDArray[np.intp]:
    """Return at most ``most`` indices of ``order``, rising: half are the first, the others are spread."""
    if len(order) <= most:
        return np.sort(order)
    first, others = order[: most // 2], np.sort(order[most // 2 :])
    even = others[np.linspace(0, len(others) - 1, most - len(first)).round().astype(int)]
    return np.sort(np.append(first, even))
