"""A surrogate of the graded outcome: Gaussian process regression of its mean and standard deviation.

All runs are ranked by how close they came to the event, with the events first. The graded outcome of a run is
Phi^-1((rank - 1/2) / n). Only the order of the scores is used, because their scale may be arbitrary.
"""

import math
from operator import itemgetter

import numpy as np
from scipy.linalg.lapack import dpotrf, dpotri, dpotrs, dtrtrs
from scipy.special import ndtr, ndtri

from fewruns.arrays import Array, Flags
from fewruns.constants import (
    AMPLITUDE_SPREAD,
    GRADED_STEPS,
    LEAST_VARIANCE,
    LENGTH,
    LENGTH_SPREAD,
    LOG_AMPLITUDE_BOUNDS,
    LOG_NOISE_BOUNDS,
    MOST_RUNS,
    NOISE,
    OUTWARD_SPREAD,
    UNUSED,
)
from fewruns.gaussian_process import (
    covariance_between,
    covariance_of_runs,
    evidence_gradient,
    most_probable,
    negative_log_posterior,
    thinned,
    with_distance,
)


def graded(happened: Flags, score: Array) -> Array:
    """Return the graded outcome of each run, shape (n,); equal runs have their mean rank."""
    columns = np.column_stack([~happened, score])
    _, place, alike = np.unique(columns, axis=0, return_inverse=True, return_counts=True)
    rank = np.cumsum(alike) - (alike - 1) / 2  # equal runs have their mean rank
    return ndtri((rank[place.ravel()] - 0.5) / len(score))


def say_more(happened: Flags, score: Array) -> bool:
    """Return whether the scores of n runs say more than their flags: those without the event differ."""
    missed = score[~happened]
    return bool((missed != missed[:1]).any())


def end_of_events(outcome: Array, happened: Flags) -> float:
    """Return the graded outcome midway between the events and the other runs."""
    return float(outcome[happened].max() + outcome[~happened].min()) / 2


def solve(covariance: Array, outcome: Array, noise_variance: float) -> tuple[Array, Array]:
    """Return the Cholesky factor of the covariance with noise, and its inverse times the outcomes."""
    factor, _ = dpotrf(covariance + noise_variance * np.eye(len(covariance)), lower=1, clean=1)
    return factor, dpotrs(factor, outcome, lower=1)[0]


def evidence_of(covariance: Array, outcome: Array, noise_variance: float) -> tuple[float, Array]:
    """Return the log evidence of n outcomes, and its derivative by the covariance matrix, shape (n, n)."""
    factor, weights = solve(covariance, outcome, noise_variance)
    half = np.tril(dpotri(factor, lower=1)[0])
    outer = 0.5 * (np.outer(weights, weights) - (half + np.tril(half, -1).T))
    return -0.5 * outcome @ weights - np.log(np.diag(factor)).sum(), outer


class GradedSurrogate:
    """Gaussian process regression of the graded outcome, with the covariance of `covariance_between`."""

    def __init__(self, dimension: int) -> None:
        """Set the priors of the logarithms of the lengths, of the amplitude and of the noise."""
        # Logarithms of the lengths, that of the distance last, of the amplitude and of the noise.
        self.theta = np.log([*[LENGTH * math.sqrt(dimension)] * dimension, UNUSED, 1.0, NOISE[0]])
        self._centre = self.theta.copy()
        self._scale = np.array([*[LENGTH_SPREAD] * dimension, OUTWARD_SPREAD, AMPLITUDE_SPREAD, NOISE[1]])

    def fit(self, z: Array, outcome: Array, *, learn: bool) -> None:
        """Fit the regression to all runs or `MOST_RUNS` of them; ``learn`` its parameters again."""
        kept = thinned(np.argsort(outcome, kind="stable"), MOST_RUNS)  # the smallest outcomes first
        self._z, self._outcome = with_distance(z[kept]), outcome[kept]
        if learn:
            bounds = [LOG_AMPLITUDE_BOUNDS, LOG_NOISE_BOUNDS]
            given = (self._z, self._outcome), self._centre, z.shape[1], bounds, GRADED_STEPS
            found = [most_probable(self._loss, *given, curved=curved) for curved in (False, True)]
            self.theta = min(found, key=itemgetter(0))[1]
        self._runs = self._z / np.exp(self.theta[:-2])
        self._variance, noise_variance = np.exp(2 * self.theta[-2:])
        covariance, _ = covariance_of_runs(self._runs, self._variance)
        self._factor, self._weights = solve(covariance, self._outcome, noise_variance)

    def expect(self, z: Array) -> tuple[Array, Array]:
        """Return mean and standard deviation, without noise, of the outcome at z, shape (m, d)."""
        points = with_distance(z) / np.exp(self.theta[:-2])
        covariance, _ = covariance_between(points, self._runs, self._variance)
        mean = covariance @ self._weights
        # The transpose has the column order of LAPACK, so it is not copied.
        scaled = dtrtrs(self._factor, covariance.T, lower=1, overwrite_b=1)[0]
        variance = np.maximum(2 * self._variance - np.einsum("ij,ij->j", scaled, scaled), LEAST_VARIANCE)
        return mean, np.sqrt(variance)

    def probability(self, z: Array, below: float | Array, *, noisy: bool = False) -> Array:
        """Return the probability that the outcome at z, shape (m, d), is below one value or m values."""
        mean, deviation = self.expect(z)
        if noisy:
            deviation = np.hypot(deviation, math.exp(self.theta[-1]))
        return ndtr((below - mean) / deviation)

    def left_out(self, below: float) -> Array:
        """Return the probability of an outcome below a value at each fitted run, from the others, (n,).

        The equations are those of Sundararajan and Keerthi (2001).
        """
        precision = np.diag(dpotri(self._factor, lower=1)[0])  # of each outcome given the others
        deviation = np.sqrt(np.maximum(1 / precision - math.exp(2 * self.theta[-1]), LEAST_VARIANCE))
        return ndtr((below - self._outcome + self._weights / precision) / deviation)

    def _loss(self, theta: Array, z: Array, outcome: Array, centre: Array) -> tuple[float, Array]:
        """Return the negative log posterior density of the log parameters, and its gradient."""
        variance, noise_variance = np.exp(2 * theta[-2:])
        runs = z / np.exp(theta[:-2])
        covariance, slope = covariance_of_runs(runs, variance, with_slope=True)
        evidence, outer = evidence_of(covariance, outcome, noise_variance)
        gradient = evidence_gradient(runs, covariance, slope, outer, variance)
        gradient = np.append(gradient, 2 * noise_variance * np.trace(outer))
        return negative_log_posterior(evidence, gradient, (theta - centre) / self._scale, self._scale)
