"""Surrogate of an event: the probability that it happens at a point that was not simulated.

Gaussian process classification of the event flag: Phi(latent) with a Gaussian process as latent function.
Its posterior is approximated by expectation propagation (Rasmussen and Williams 2006, section 3.6); its
lengths and amplitude are those of highest posterior density.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import dpotrf, dpotri, dpotrs
from scipy.optimize import minimize
from scipy.special import log_ndtr, ndtr

from accelerated_evaluation.distributions.protocol import Array
from accelerated_evaluation.methods.surrogate.constants import (
    AMPLITUDE,
    AMPLITUDE_SPREAD,
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
    ROUGHLY_SETTLED,
    SETTLED,
    SWEEPS,
)

LOG_ROOT_2PI = 0.5 * math.log(2 * math.pi)


@njit(cache=True)
def _matern(squared: Array, value: Array, slope: Array) -> None:
    """Matern 5/2 correlation at squared distances, and -2 times its derivative by them."""
    for i in range(squared.size):
        r = math.sqrt(5 * squared[i])
        decay = math.exp(-r)
        value[i] = (1 + r + r * r / 3) * decay
        slope[i] = 5 / 3 * (1 + r) * decay


def _correlation(a: Array, b: Array, lengths: Array) -> tuple[Array, Array]:
    a, b = a / lengths, b / lengths
    squared = np.maximum((a * a).sum(1)[:, None] + (b * b).sum(1) - 2 * a @ b.T, 0.0)
    value, slope = np.empty_like(squared), np.empty_like(squared)
    _matern(squared.ravel(), value.ravel(), slope.ravel())
    return value, slope


class EventSurrogate:
    """Probability of the event at any point, given the flags of the points that were run.

    The covariance of the latent function is amplitude^2 (1 + Matern 5/2), with one length a dimension.

    Parameters
    ----------
    dimension
        Number d of normal scores.
    """

    def __init__(self, dimension: int) -> None:
        self.theta = np.log([*[LENGTH] * dimension, AMPLITUDE])
        self.sites = np.empty((2, 0))
        self._centre = self.theta.copy()
        self._scale = np.array([*[LENGTH_SPREAD] * dimension, AMPLITUDE_SPREAD])

    def fit(self, z: Array, event: NDArray[np.bool_], *, learn: bool, restart: bool = False) -> None:
        """Condition on runs.

        Parameters
        ----------
        z, event
            Normal scores, shape (n, d), and flags, shape (n,); earlier runs first.
        learn
            Whether to look for better lengths and amplitude.
        restart
            Whether the flags of earlier runs have changed.
        """
        sign = np.where(event, 1.0, -1.0)
        known = 0 if restart else self.sites.shape[1]
        new = np.repeat([[FIRST_PRECISION], [0.0]], len(sign) - known, axis=1)
        self.sites = np.hstack([self.sites[:, :known], new])
        if learn:
            bounds = [LOG_LENGTH_BOUNDS] * (len(self.theta) - 1) + [LOG_AMPLITUDE_BOUNDS]
            self.theta = minimize(
                self._loss,
                self.theta,
                (z, sign),
                "L-BFGS-B",
                jac=True,
                bounds=bounds,
                options={"maxiter": LEARNING_STEPS},
            ).x
        self._z, self._lengths, self._variance = z, np.exp(self.theta[:-1]), math.exp(2 * self.theta[-1])
        covariance = self._covariance(_correlation(z, z, self._lengths)[0], self._variance)
        _, self._factor, self._root, self._weights = self._propagate(covariance, sign, tolerance=SETTLED)

    def probability(self, z: Array) -> Array:
        """Probability of the event at points z, shape (m, d)."""
        covariance = self._variance * (_correlation(self._z, z, self._lengths)[0] + 1)
        scaled = solve_triangular(
            self._factor, self._root[:, None] * covariance, lower=True, check_finite=False
        )
        variance = np.maximum(2 * self._variance - np.einsum("ij,ij->j", scaled, scaled), 0.0)
        return ndtr(covariance.T @ self._weights / np.sqrt(1 + variance))

    @staticmethod
    def _covariance(correlation: Array, variance: float) -> Array:
        return variance * (correlation + 1 + JITTER * np.eye(len(correlation)))

    def _propagate(
        self, covariance: Array, sign: Array, tolerance: float
    ) -> tuple[float, Array, Array, Array]:
        """Propagate expectations, all sites at once, until the log evidence is known to ``tolerance``.

        Returns the log evidence, the Cholesky factor of I + S^1/2 K S^1/2, S^1/2, and the mean's weights.
        """
        (precision, shift), previous = self.sites, math.inf
        for _ in range(SWEEPS):
            root = np.sqrt(precision)
            factor, _ = dpotrf(np.eye(len(sign)) + root[:, None] * covariance * root, lower=1, clean=1)
            variance = np.maximum(1 - np.diag(dpotri(factor, lower=1)[0]), LEAST_VARIANCE) / precision
            weights = shift - root * dpotrs(factor, root * (covariance @ shift), lower=1)[0]
            mean = covariance @ weights
            # the cavity: everything but the site itself
            rest = np.maximum(1 / variance - precision, LEAST_PRECISION)
            centre = (mean / variance - shift) / rest
            width = np.sqrt(1 + 1 / rest)
            score = sign * centre / width
            log_mass = log_ndtr(score)
            both = precision + rest
            evidence = (
                log_mass.sum()
                - np.log(np.diag(factor)).sum()
                + 0.5 * (np.log1p(precision / rest).sum() + shift @ mean - (shift * shift / both).sum())
                + 0.5 * (centre * rest / both * (precision * centre - 2 * shift)).sum()
            )
            if abs(evidence - previous) < tolerance:
                break
            previous = evidence
            hazard = np.exp(-0.5 * score * score - LOG_ROOT_2PI - log_mass)
            matched_mean = centre + sign * hazard / (rest * width)
            matched_variance = 1 / rest - hazard * (score + hazard) / (rest * width) ** 2
            target = np.maximum(1 / matched_variance - rest, LEAST_PRECISION)
            precision = (1 - DAMPING) * precision + DAMPING * target
            shift = (1 - DAMPING) * shift + DAMPING * (matched_mean / matched_variance - centre * rest)
        self.sites = np.array([precision, shift])
        return evidence, factor, root, weights

    def _loss(self, theta: Array, z: Array, sign: Array) -> tuple[float, Array]:
        """Negative log posterior density of the log lengths and log amplitude, and its gradient."""
        lengths, variance = np.exp(theta[:-1]), math.exp(2 * theta[-1])
        correlation, slope = _correlation(z, z, lengths)
        covariance = self._covariance(correlation, variance)
        evidence, factor, root, weights = self._propagate(covariance, sign, tolerance=ROUGHLY_SETTLED)
        inverse = solve_triangular(factor, np.diag(root), lower=True, check_finite=False)
        outer = 0.5 * (np.outer(weights, weights) - inverse.T @ inverse)
        by_length = variance * outer * slope
        gradient = [(by_length * np.subtract.outer(x, x) ** 2).sum() for x in (z / lengths).T]
        gradient.append(2 * (outer * covariance).sum())
        score = (theta - self._centre) / self._scale
        return 0.5 * score @ score - evidence, score / self._scale - np.array(gradient)
