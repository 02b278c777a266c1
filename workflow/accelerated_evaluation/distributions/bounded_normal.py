"""Bounded normal distribution (paper, section III.B.2)."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import log_ndtr, ndtri_exp

from accelerated_evaluation.distributions.protocol import Array

_NODES, _NODE_WEIGHTS = np.polynomial.legendre.leggauss(16)
_LOG_SQRT_2PI = 0.5 * math.log(2 * math.pi)


@dataclass(frozen=True)
class BoundedNormal:
    """Normal distribution with ``location`` and ``sd``, conditional on ``[lower, upper)``.

    The paper fits it with mean 0; exponential tilting moves the mean to theta sd^2.
    """

    sd: float
    lower: float = 0.0
    upper: float = math.inf
    location: float = 0.0

    def __post_init__(self) -> None:
        if not self.lower < self.upper:
            raise ValueError(f"bounds must satisfy lower < upper, got [{self.lower}, {self.upper})")
        if not (self.sd > 0 and math.isfinite(self.sd) and math.isfinite(self.location)):
            raise ValueError(f"sd must be positive and finite, got sd {self.sd}, location {self.location}")

    @property
    def n_parameters(self) -> int:
        """Number of free parameters: the standard deviation (the location is 0 in the paper's fits)."""
        return 1

    def _score(self, x: ArrayLike) -> Array:
        return (np.clip(np.asarray(x, dtype=float), self.lower, self.upper) - self.location) / self.sd

    @property
    def _a(self) -> float:
        return (self.lower - self.location) / self.sd

    @property
    def _b(self) -> float:
        return (self.upper - self.location) / self.sd

    @property
    def _log_mass(self) -> float:
        return float(log_normal_mass(self._a, self._b))

    def logpdf(self, x: ArrayLike) -> Array:
        """Log density; -inf outside the support."""
        x = np.asarray(x, dtype=float)
        inside = (x >= self.lower) & (x < self.upper)
        density = -0.5 * self._score(x) ** 2 - _LOG_SQRT_2PI - math.log(self.sd) - self._log_mass
        return np.where(inside, density, -np.inf)

    def cdf(self, x: ArrayLike) -> Array:
        """P(X <= x)."""
        return np.exp(log_normal_mass(self._a, self._score(x)) - self._log_mass)

    def sf(self, x: ArrayLike) -> Array:
        """P(X > x)."""
        return np.exp(self.logsf(x))

    def logsf(self, x: ArrayLike) -> Array:
        """Log P(X > x)."""
        return log_normal_mass(self._score(x), self._b) - self._log_mass

    def ppf(self, q: ArrayLike) -> Array:
        """Inverse of cdf (paper, appendix A), solved in logarithms."""
        q = np.asarray(q, dtype=float)
        with np.errstate(divide="ignore"):
            return self._quantile(np.log(q), np.log1p(-q))

    def isf(self, q: ArrayLike) -> Array:
        """Inverse of sf."""
        q = np.asarray(q, dtype=float)
        with np.errstate(divide="ignore"):
            return self._quantile(np.log1p(-q), np.log(q))

    def _quantile(self, log_below: Array, log_above: Array) -> Array:
        """Return the point with the given log shares of the mass below and above it."""
        log_cdf = np.logaddexp(log_above + log_ndtr(self._a), log_below + log_ndtr(self._b))
        log_sf = np.logaddexp(log_above + log_ndtr(-self._a), log_below + log_ndtr(-self._b))
        # Each side is solved where it is the smaller, and so the more exact.
        score = np.where(log_cdf < log_sf, ndtri_exp(np.minimum(log_cdf, 0)), -ndtri_exp(np.minimum(log_sf, 0)))
        return np.clip(self.location + self.sd * score, self.lower, self.upper)

    def mean(self) -> float:
        """Return E X."""
        log_density = [-0.5 * z * z - _LOG_SQRT_2PI - self._log_mass for z in (self._a, self._b)]
        mean = self.location + self.sd * (math.exp(log_density[0]) - math.exp(log_density[1]))
        return min(max(mean, self.lower), self.upper)

    def second_moment(self) -> float:
        """Return E X^2 for location 0, what the maximum-likelihood equation of sd matches."""
        edges = [
            z * math.exp(-0.5 * z * z - _LOG_SQRT_2PI - self._log_mass) if math.isfinite(z) else 0.0
            for z in (self._a, self._b)
        ]
        return self.sd**2 * (1 + edges[0] - edges[1])

    def rvs(self, generator: np.random.Generator, size: int) -> Array:
        """Independent draws, shape (size,), by the inverse cdf."""
        return self.ppf(generator.random(size))

    theta_limit = math.inf

    def cumulant(self, theta: float) -> float:
        """Return kappa(theta) = log E exp(theta X)."""
        shift = theta * self.location + 0.5 * (theta * self.sd) ** 2
        return shift + self.tilt(theta)._log_mass - self._log_mass

    def tilt(self, theta: float) -> "BoundedNormal":
        """Exponential change of measure: the location moves by theta sd^2 (paper, section IV.B)."""
        return BoundedNormal(self.sd, self.lower, self.upper, self.location + theta * self.sd**2)


def log_normal_mass(a: ArrayLike, b: ArrayLike) -> Array:
    """Log of Phi(b) - Phi(a), without a difference of nearly equal numbers.

    Both tails are reduced to the lower one. Where the interval is so short that the density hardly
    changes over it, the integral is taken by Gauss-Legendre quadrature instead of a difference.
    """
    a, b = np.broadcast_arrays(np.asarray(a, dtype=float), np.asarray(b, dtype=float))
    flip = a > 0
    low, high = np.where(flip, -b, a), np.where(flip, -a, b)
    with np.errstate(divide="ignore", invalid="ignore"):
        tail = log_ndtr(high) + np.log1p(-np.exp(log_ndtr(low) - log_ndtr(high)))
        width = high - low
        reach = np.maximum(np.abs(low), np.abs(high))
        short = width * np.maximum(reach, 1) < 1
        if not np.any(short):
            return tail
        middle = np.where(short, 0.5 * (low + high), 0.0)
        half = np.where(short, 0.5 * width, 1.0)
        shape = -middle[..., None] * half[..., None] * _NODES - 0.5 * (half[..., None] * _NODES) ** 2
        integral = np.log(half) + np.log(np.exp(shape) @ _NODE_WEIGHTS) - 0.5 * middle**2 - _LOG_SQRT_2PI
    return np.where(short, integral, tail)
