"""Surrogate of a graded outcome: what is expected at a point that was not simulated, and how surely.

This is Gaussian process regression (Rasmussen and Williams 2006, section 2.2). Its lengths, its amplitude and
its noise are those of highest posterior density.
"""

import math

import numpy as np
from scipy.linalg.lapack import dpotrf, dpotri, dpotrs, dtrtrs
from scipy.optimize import minimize

from accelerated_evaluation.distributions.protocol import Array
from accelerated_evaluation.methods.surrogate.constants import (
    AMPLITUDE_SPREAD,
    GRADED_STEPS,
    LEAST_VARIANCE,
    LENGTH,
    LENGTH_SPREAD,
    LOG_AMPLITUDE_BOUNDS,
    LOG_LENGTH_BOUNDS,
    LOG_NOISE_BOUNDS,
    NOISE,
    NOISE_SPREAD,
)
from accelerated_evaluation.methods.surrogate.kernel import (
    covariance_between,
    covariance_of_runs,
    evidence_gradient,
    negative_log_posterior,
)


class GradedSurrogate:
    """Gaussian process regression of outcomes of mean 0 and variance 1, with the covariance of `kernel`.

    Parameters
    ----------
    z
        Normal scores of the runs, shape (n, d).
    outcome
        Their outcomes, shape (n,).
    """

    def __init__(self, z: Array, outcome: Array) -> None:
        d = z.shape[1]
        self._z, self._outcome = z, outcome
        self._centre = np.log([*[LENGTH * math.sqrt(d)] * d, 1.0, NOISE])
        self._scale = np.array([*[LENGTH_SPREAD] * d, AMPLITUDE_SPREAD, NOISE_SPREAD])
        bounds = [LOG_LENGTH_BOUNDS] * d + [LOG_AMPLITUDE_BOUNDS, LOG_NOISE_BOUNDS]
        found = minimize(
            self._loss,
            self._centre,
            method="L-BFGS-B",
            jac=True,
            bounds=bounds,
            options={"maxiter": GRADED_STEPS},
        )
        self._lengths, self._variance = np.exp(found.x[:d]), math.exp(2 * found.x[d])
        covariance, _ = covariance_of_runs(z / self._lengths, self._variance)
        self._factor, self._weights = self._solve(covariance, math.exp(2 * found.x[-1]))

    def expect(self, z: Array) -> tuple[Array, Array]:
        """Return mean and standard deviation of the outcome without noise at points z, shapes (m,)."""
        covariance = covariance_between(self._z / self._lengths, z / self._lengths, self._variance)[0]
        scaled = dtrtrs(self._factor, covariance, lower=1)[0]
        variance = np.maximum(2 * self._variance - np.einsum("ij,ij->j", scaled, scaled), LEAST_VARIANCE)
        return covariance.T @ self._weights, np.sqrt(variance)

    def _solve(self, covariance: Array, noise_variance: float) -> tuple[Array, Array]:
        """Return the Cholesky factor of the covariance with noise, and its inverse times the outcomes."""
        factor, _ = dpotrf(covariance + noise_variance * np.eye(len(covariance)), lower=1, clean=1)
        return factor, dpotrs(factor, self._outcome, lower=1)[0]

    def _loss(self, theta: Array) -> tuple[float, Array]:
        """Negative log posterior density of the logarithms of the parameters, and its gradient."""
        variance, noise_variance = np.exp(2 * theta[-2:])
        runs = self._z / np.exp(theta[:-2])
        covariance, slope = covariance_of_runs(runs, variance, with_slope=True)
        factor, weights = self._solve(covariance, noise_variance)
        evidence = -0.5 * self._outcome @ weights - np.log(np.diag(factor)).sum()
        half = np.tril(dpotri(factor, lower=1)[0])
        inverse = half + np.tril(half, -1).T
        outer = 0.5 * (np.outer(weights, weights) - inverse)
        gradient = evidence_gradient(runs, covariance, slope, outer, variance)
        gradient = np.append(gradient, 2 * noise_variance * np.trace(outer))
        return negative_log_posterior(evidence, gradient, (theta - self._centre) / self._scale, self._scale)
