"""What the two Gaussian processes of the sampler share: covariance, derivatives, prior, and choice of runs.

The covariance is amplitude^2 (1 + Matern 5/2), with one length a dimension. The constant 1 is the variance
of an unknown mean. Points are given in units of the lengths.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from accelerated_evaluation.distributions.protocol import Array
from accelerated_evaluation.methods.surrogate.constants import JITTER


@njit(cache=True)
def _fill(
    cross: Array, a_square: Array, b_square: Array, variance: float, value: Array, slope: Array
) -> None:
    """Fill in covariances, variance (1 + Matern 5/2), and slopes of the Matern correlation.

    Parameters
    ----------
    cross
        Twice the inner products of points a and b, shape (n, m).
    a_square, b_square
        Squared norms of the points, shapes (n,) and (m,).
    variance
        Square of the amplitude.
    value
        Where the covariances are put, shape (n, m).
    slope
        Where -2 times the derivatives of the correlations by the squared distance are put, shape (n, m);
        empty if they are not wanted.
    """
    n, m = cross.shape
    r, decay = np.empty(m), np.empty(m)
    for i in range(n):
        # One loop for each operation: the processor takes several roots at once, but single exponentials.
        for j in range(m):
            r[j] = math.sqrt(5 * max(a_square[i] + b_square[j] - cross[i, j], 0.0))
        for j in range(m):
            decay[j] = math.exp(-r[j])
        for j in range(m):
            value[i, j] = variance * ((1 + r[j] + r[j] * r[j] / 3) * decay[j] + 1)
        if slope.size:
            for j in range(m):
                slope[i, j] = 5 / 3 * (1 + r[j]) * decay[j]


def covariance_between(
    a: Array, b: Array, variance: float, *, with_slope: bool = False
) -> tuple[Array, Array]:
    """Return covariances, shape (n, m), of points in units of the lengths, and the slopes if wanted."""
    cross = 2 * a @ b.T
    value, slope = np.empty_like(cross), np.empty_like(cross) if with_slope else np.empty((0, 0))
    _fill(cross, (a * a).sum(1), (b * b).sum(1), variance, value, slope)
    return value, slope


def covariance_of_runs(runs: Array, variance: float, *, with_slope: bool = False) -> tuple[Array, Array]:
    """Return the covariance of the runs, shape (n, n), with a little more on its diagonal, and the slopes."""
    covariance, slope = covariance_between(runs, runs, 1.0, with_slope=with_slope)
    covariance.flat[:: len(runs) + 1] += JITTER
    covariance *= variance
    return covariance, slope


def evidence_gradient(runs: Array, covariance: Array, slope: Array, outer: Array, variance: float) -> Array:
    """Return the gradient of a log evidence by the logarithms of lengths and amplitude, shape (d + 1,).

    Parameters
    ----------
    runs
        Points, shape (n, d).
    covariance, slope
        Of the runs, from `covariance_of_runs`, shape (n, n).
    outer
        Derivative of the log evidence by the covariance, shape (n, n).
    variance
        Square of the amplitude.
    """
    slope = slope * (variance * outer)
    by_length = [(slope * np.subtract.outer(x, x) ** 2).sum() for x in runs.T]
    return np.array([*by_length, 2 * (outer * covariance).sum()])


def negative_log_posterior(
    evidence: float, gradient: Array, score: Array, scale: Array
) -> tuple[float, Array]:
    """Return the negative log posterior density of the parameters under a normal prior, and its gradient.

    Parameters
    ----------
    evidence, gradient
        Log evidence, and its gradient by the parameters, shape (k,).
    score, scale
        Distance of the parameters from their prior mean in standard deviations, and these, shape (k,).
    """
    return 0.5 * score @ score - evidence, score / scale - gradient


def thinned(order: NDArray[np.intp], most: int) -> NDArray[np.intp]:
    """Return which runs to condition on, at most ``most``: half of them from the beginning of an order.

    The others are thinned evenly, in the order in which they were made.

    Parameters
    ----------
    order
        All runs, those that matter most first.
    most
        Largest number of runs to return.
    """
    if len(order) <= most:
        return np.sort(order)
    first, others = order[: most // 2], np.sort(order[most // 2 :])
    even = others[np.linspace(0, len(others) - 1, most - len(first)).round().astype(int)]
    return np.sort(np.append(first, even))
