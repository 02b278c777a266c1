"""Common base class of the bounded exponential and the bounded normal distribution."""

import math
from abc import abstractmethod
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.distributions.described import Described

LEAST = 1e-150  # smallest distance used as a divisor; its square is still a positive double


class Bounded(Described):
    """A distribution on ``[lower, upper)`` with a log-concave density that is known up to a constant factor.

    Integrals of the density f are computed relative to the largest value of f on their interval. They
    therefore neither overflow nor underflow, and tail probabilities do not suffer from cancellation.
    """

    lower: float
    upper: float

    @abstractmethod
    def _peak(self, low: ArrayLike, high: ArrayLike) -> Array:
        """Return the point of the interval with the largest density."""

    @abstractmethod
    def _log_relative(self, x: ArrayLike, reference: ArrayLike) -> Array:
        """Log of f(x) / f(reference)."""

    @abstractmethod
    def _integral(self, low: ArrayLike, high: ArrayLike) -> Array:
        """Integral of f over the interval, divided by f at its peak."""

    @abstractmethod
    def tilt(self, theta: float) -> Self:
        """Return the exponentially tilted distribution, with density proportional to exp(theta x) f(x)."""

    @abstractmethod
    def ppf(self, q: ArrayLike) -> Array:
        """Return the quantile x with P(X <= x) = q."""

    # Cached, because every evaluation of a density or probability needs these two.
    @cached_property
    def _mode(self) -> float:
        return float(self._peak(self.lower, self.upper))

    @cached_property
    def _total(self) -> float:
        # Cached, because quantiles of mixtures need it in every step of their search.
        return float(self._integral(self.lower, self.upper))

    def _clip(self, x: ArrayLike) -> Array:
        """Return the nearest points of the support, limited to numbers whose sums are finite."""
        largest = np.finfo(float).max / 4
        return np.clip(np.asarray(x, dtype=float), max(self.lower, -largest), min(self.upper, largest))

    def _share(self, low: ArrayLike, high: ArrayLike) -> tuple[Array, Array]:
        """Return the probability between two points as a factor, and the log of another factor."""
        share = self._integral(low, high) / self._total
        return share, self._log_relative(self._peak(low, high), self._mode)

    @np.errstate(over="ignore")
    def logpdf(self, x: ArrayLike) -> Array:
        """Return the log density at x; -inf outside the support."""
        x = np.asarray(x, dtype=float)
        density = self._log_relative(self._clip(x), self._mode) - math.log(self._total)
        return np.where((x < self.lower) | (x >= self.upper), -np.inf, density)

    @np.errstate(over="ignore")
    def cdf(self, x: ArrayLike) -> Array:
        """Return P(X <= x)."""
        share, log_factor = self._share(self.lower, self._clip(x))
        return share * np.exp(log_factor)

    @np.errstate(over="ignore")
    def sf(self, x: ArrayLike) -> Array:
        """Return P(X > x)."""
        share, log_factor = self._share(self._clip(x), self.upper)
        return share * np.exp(log_factor)

    @np.errstate(over="ignore", divide="ignore")
    def logsf(self, x: ArrayLike) -> Array:
        """Return log P(X > x)."""
        share, log_factor = self._share(self._clip(x), self.upper)
        return np.log(share) + log_factor

    def rvs(self, generator: np.random.Generator, size: int) -> Array:
        """Return independent draws, shape (size,), by the inverse cdf."""
        return self.ppf(generator.random(size))

    def cumulant(self, theta: float) -> float:
        """Return kappa(theta) = log E exp(theta X)."""
        tilted = self.tilt(theta)
        shift = float(self._log_relative(tilted._mode, self._mode))
        return theta * tilted._mode + shift + math.log(tilted._total / self._total)
