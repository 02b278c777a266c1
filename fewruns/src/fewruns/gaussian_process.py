"""The surrogate of an event: Gaussian process classification of the flags by expectation propagation.

See Rasmussen and Williams (2006), section 3.6. The lengths have the largest posterior density.
"""

import math
from collections.abc import Callable, Sequence
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpotrf, dpotrs, dtrtri, dtrtrs
from scipy.optimize import minimize
from scipy.spatial import cKDTree
from scipy.special import log_ndtr, ndtr

from fewruns.arrays import BLOCK, Array
from fewruns.constants import (
    AMPLITUDE,
    AMPLITUDE_SPREAD,
    COST,
    DAMPING,
    FIRST_PRECISION,
    JITTER,
    LEARNING_STEPS,
    LEAST_PRECISION,
    LEAST_VARIANCE,
    LENGTH,
    LENGTH_SPREAD,
    LOG_AMPLITUDE_BOUNDS,
    LOG_LENGTH_BOUNDS,
    MOST_RUNS,
    MOST_STEPS,
    OUTWARD,
    OUTWARD_SPREAD,
    ROUGHLY_SETTLED,
    SETTLED,
    SYSTEM_LENGTH,
    UNUSED,
)
from fewruns.problems import Predecessor

LOG_ROOT_2PI = 0.5 * math.log(2 * math.pi)


def covariance_between(
    a: Array, b: Array, variance: float, *, with_slope: bool = False
) -> tuple[Array, Array]:
    """Return the covariances between points of shapes (n, d) and (m, d), and their slopes, shapes (n, m).

    Slopes are computed if ``with_slope`` is true. They are -2 times the derivatives of the
    correlations with respect to the squared distance.
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


def with_distance(z: Array) -> Array:
    """Return points, shape (n, d), with the distance from the origin as a further coordinate, (n, d + 1)."""
    return np.column_stack([z, np.linalg.norm(z, axis=1)])


def negative_log_posterior(
    evidence: float, gradient: Array, score: Array, scale: Array
) -> tuple[float, Array]:
    """Return the negative log posterior density of k parameters with a normal prior, and its gradient."""
    return float(0.5 * score @ score - evidence), score / scale - gradient


def most_probable(
    loss: Callable[..., tuple[float, Array]],
    known: tuple[Array, Array],
    centre: Array,
    dimension: int,
    bounds: Sequence[tuple[float, float]],
    steps: int,
    *,
    curved: bool,
) -> tuple[float, Array]:
    """Return the smallest loss, and its log parameters, optimised from the prior median in few steps.

    The first parameters are the log lengths along d coordinates and the distance. If the boundary is
    ``curved`` around the origin, the distance from it matters. Otherwise its length is fixed, at its prior
    median, so that the prior has no influence. ``known`` are runs and outcomes.
    """
    centre = centre.copy()
    centre[dimension] = math.log(1 / OUTWARD if curved else UNUSED)
    of_distance = LOG_LENGTH_BOUNDS if curved else (math.log(UNUSED),) * 2
    limits = [LOG_LENGTH_BOUNDS] * dimension + [of_distance, *bounds]
    options, given = {"maxiter": steps}, (*known, centre)
    found = minimize(loss, centre, given, "L-BFGS-B", jac=True, bounds=limits, options=options)
    return float(found.fun) + COST * curved, found.x


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


def _scaled_on_both_sides(covariance: Array, root: Array) -> Array:
    """Return I + S^1/2 K S^1/2 for a diagonal S^1/2 in ``root``."""
    scaled = np.empty(covariance.shape, order="F")  # the column order of LAPACK avoids a copy
    np.multiply(covariance, root[:, None], out=scaled)
    scaled *= root
    scaled[np.diag_indices(len(root))] += 1
    return scaled


def _log_evidence(
    factor: Array, sites: tuple[Array, Array], mean: Array, cavity: tuple[Array, Array], log_mass: Array
) -> float:
    """Return the log evidence by expectation propagation (Rasmussen and Williams, eq. 3.65)."""
    (precision, shift), (rest, centre) = sites, cavity
    both = precision + rest
    return (
        log_mass.sum()
        - np.log(np.diag(factor)).sum()
        + 0.5 * (np.log1p(precision / rest).sum() + shift @ mean - (shift * shift / both).sum())
        + 0.5 * (centre * rest / both * (precision * centre - 2 * shift)).sum()
    )


def selected_runs(runs: Array, event: NDArray[np.bool_], most: int) -> NDArray[np.intp]:
    """Return the indices of at most ``most`` runs, shape (n, d): half are nearest to the other flag."""
    n = len(event)
    if n <= most:
        return np.arange(n)
    distance = np.full(n, np.inf)
    if event.any() and not event.all():
        distance[event] = cKDTree(runs[~event]).query(runs[event])[0]
        distance[~event] = cKDTree(runs[event]).query(runs[~event])[0]
    return thinned(np.argsort(distance, kind="stable"), most)


class EventSurrogate:
    """Predicted probability of the event at any point, given the flags of the simulated points.

    Its coordinates are those of the points along the axes and, if the runs show that it matters, the distance
    from the origin. If there is a predecessor, the points have one more coordinate, 0 for the system under
    test and 1 for the predecessor. The length of this coordinate determines how much the runs of one system
    say about the other.
    """

    def __init__(
        self, dimension: int, predecessor: Predecessor | None = None, amplitude: float = AMPLITUDE
    ) -> None:
        self._predecessor = predecessor
        lengths = [*[LENGTH * math.sqrt(dimension)] * dimension, UNUSED]
        lengths += [SYSTEM_LENGTH] if predecessor else []
        self.axes = np.eye(dimension)  # directions along which the lengths are measured, as columns
        # Logarithms of the lengths, of those of the distance and of the systems, and of the amplitude.
        self.theta = np.log([*lengths, amplitude])
        # Precision, and precision times mean, of the Gaussian factor that approximates the likelihood of each
        # flag, those of the predecessor first.
        self.sites = np.empty((2, 0))
        self.left_out = np.empty(0)  # probability of the event at each fitted run, from the others
        self._kept = np.arange(0)
        self._centre = self.theta.copy()
        self._scale = np.array([*[LENGTH_SPREAD] * len(lengths), AMPLITUDE_SPREAD])
        self._scale[dimension] = OUTWARD_SPREAD

    def fit(self, z: Array, event: NDArray[np.bool_], *, learn: bool, turned: Sequence[Array] = ()) -> None:
        """Fit the surrogate to runs, shape (n, d); ``learn`` lengths and amplitude along the best axes."""
        if self._predecessor is not None:
            event = np.append(self._predecessor.happened, event)
        sign = np.where(event, 1.0, -1.0)
        if learn:
            found = [self._learn(axes, z, sign) for axes in (np.eye(z.shape[1]), *turned)]
            best = min(found, key=itemgetter(0))
            curved = self._learn(best[1], z, sign, curved=True)
            _, self.axes, self.theta = min(best, curved, key=itemgetter(0))
            self.sites = np.empty((2, 0))
        runs, sign = self._keep(z, sign)
        self._lengths, self._variance = np.exp(self.theta[:-1]), math.exp(2 * self.theta[-1])
        self._runs = runs / self._lengths
        covariance, _ = covariance_of_runs(self._runs, self._variance)
        _, self._factor, self._root, self._weights = self._propagate(covariance, sign, tolerance=SETTLED)

    def _learn(
        self, axes: Array, z: Array, sign: Array, *, curved: bool = False
    ) -> tuple[float, Array, Array]:
        """Return the smallest loss along given axes, the axes, and theta."""
        self.axes, self.sites = axes, np.empty((2, 0))
        bounds = [LOG_LENGTH_BOUNDS] * (self._predecessor is not None) + [LOG_AMPLITUDE_BOUNDS]
        given = self._keep(z, sign), self._centre, len(axes), bounds, LEARNING_STEPS
        loss, theta = most_probable(self._loss, *given, curved=curved)
        return loss, axes, theta

    def _keep(self, z: Array, sign: Array) -> tuple[Array, Array]:
        """Return the runs for the fit, those of the predecessor first, and their signs; add missing sites."""
        runs = self._placed(z)
        if (other := self._predecessor) is not None:
            known = with_distance(other.z @ self.axes)
            runs = np.vstack([np.column_stack([known, np.ones(len(known))]), runs])
        new = np.repeat([[FIRST_PRECISION], [0.0]], len(sign) - self.sites.shape[1], axis=1)
        self.sites = np.hstack([self.sites, new])
        self._kept = selected_runs(runs / np.exp(self.theta[:-1]), sign > 0, MOST_RUNS)
        return runs[self._kept], sign[self._kept]

    def probability(self, z: Array) -> Array:
        """Return the predicted probability of the event, shape (m,), at points z, shape (m, d)."""
        covariance = covariance_between(self._placed(z) / self._lengths, self._runs, self._variance)[0]
        mean = covariance @ self._weights
        covariance *= self._root
        # The transpose has the column order of LAPACK, so it is not copied.
        scaled = dtrtrs(self._factor, covariance.T, lower=1, overwrite_b=1)[0]
        variance = np.maximum(2 * self._variance - np.einsum("ij,ij->j", scaled, scaled), 0.0)
        return ndtr(mean / np.sqrt(1 + variance))

    def _placed(self, z: Array) -> Array:
        """Return points in coordinates along the axes, with their distance and the system under test."""
        z = with_distance(z @ self.axes)
        return z if self._predecessor is None else np.column_stack([z, np.zeros(len(z))])

    def _propagate(
        self, covariance: Array, sign: Array, tolerance: float
    ) -> tuple[float, Array, Array, Array]:
        """Return log evidence, Cholesky factor of I + S^1/2 K S^1/2, root of S, and weights K^-1 mean."""
        (precision, shift), previous = self.sites[:, self._kept], math.inf
        for _ in range(MOST_STEPS):
            root = np.sqrt(precision)
            factor, _ = dpotrf(_scaled_on_both_sides(covariance, root), lower=1, clean=1, overwrite_a=1)
            inverse = dtrtri(factor, lower=1)[0]
            diagonal = np.einsum("ij,ij->j", inverse, inverse)  # of the inverse of I + S^1/2 K S^1/2
            variance = np.maximum(1 - diagonal, LEAST_VARIANCE) / precision
            weights = shift - root * dpotrs(factor, root * (covariance @ shift), lower=1)[0]
            mean = covariance @ weights
            # The cavity is the posterior without the site itself.
            rest = np.maximum(1 / variance - precision, LEAST_PRECISION)
            centre = (mean / variance - shift) / rest
            width = np.sqrt(1 + 1 / rest)
            score = sign * centre / width
            log_mass = log_ndtr(score)
            evidence = _log_evidence(factor, (precision, shift), mean, (rest, centre), log_mass)
            if abs(evidence - previous) < tolerance:
                break
            previous = evidence
            # The new site is such that cavity times site has the moments of cavity times probit. The ratio of
            # the normal density to its integral is computed from logarithms, because both may underflow.
            hazard = np.exp(-0.5 * score * score - LOG_ROOT_2PI - log_mass)
            matched_mean = centre + sign * hazard / (rest * width)
            matched_variance = 1 / rest - hazard * (score + hazard) / (rest * width) ** 2
            target = np.maximum(1 / matched_variance - rest, LEAST_PRECISION)
            precision = (1 - DAMPING) * precision + DAMPING * target
            shift = (1 - DAMPING) * shift + DAMPING * (matched_mean / matched_variance - centre * rest)
        self.sites[:, self._kept] = precision, shift
        self.left_out = ndtr(centre / width)
        return evidence, factor, root, weights

    def _loss(self, theta: Array, z: Array, sign: Array, centre: Array) -> tuple[float, Array]:
        """Return the negative log posterior density of log lengths and log amplitude, and its gradient."""
        variance = math.exp(2 * theta[-1])
        runs = z / np.exp(theta[:-1])
        covariance, slope = covariance_of_runs(runs, variance, with_slope=True)
        evidence, factor, root, weights = self._propagate(covariance, sign, tolerance=ROUGHLY_SETTLED)
        inverse = dtrtrs(factor, np.diag(root), lower=1)[0]
        outer = 0.5 * (np.outer(weights, weights) - inverse.T @ inverse)
        gradient = evidence_gradient(runs, covariance, slope, outer, variance)
        return negative_log_posterior(evidence, gradient, (theta - centre) / self._scale, self._scale)
