"""Pareto distribution: the single parametric model of R^-1 in the authors' earlier work (section II)."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from accelerated_evaluation.distributions.protocol import Array


@dataclass(frozen=True)
class Pareto:
    """P(X > x) = (lower / x)^shape for x >= lower > 0; its tail has no exponential change of measure."""

    shape: float
    lower: float

    def __post_init__(self) -> None:
        if not (0 < self.shape < math.inf and 0 < self.lower < math.inf):
            raise ValueError(f"shape and lower must be positive and finite, got {self.shape}, {self.lower}")

    upper = math.inf
    n_parameters = 1

    def _log_excess(self, x: ArrayLike) -> Array:
        """Log of x / lower; 0 below the support."""
        return np.log1p((np.maximum(np.asarray(x, dtype=float), self.lower) - self.lower) / self.lower)

    def logpdf(self, x: ArrayLike) -> Array:
        """Log density; -inf outside the support."""
        density = math.log(self.shape / self.lower) - (self.shape + 1) * self._log_excess(x)
        return np.where(np.asarray(x) < self.lower, -np.inf, density)

    def logsf(self, x: ArrayLike) -> Array:
        """Log P(X > x)."""
        return -self.shape * self._log_excess(x)

    def sf(self, x: ArrayLike) -> Array:
        """P(X > x)."""
        return np.exp(self.logsf(x))

    def cdf(self, x: ArrayLike) -> Array:
        """P(X <= x)."""
        return -np.expm1(self.logsf(x))

    def isf(self, q: ArrayLike) -> Array:
        """Inverse of sf."""
        with np.errstate(divide="ignore"):
            return self.lower * np.exp(-np.log(np.asarray(q, dtype=float)) / self.shape)

    def ppf(self, q: ArrayLike) -> Array:
        """Inverse of cdf."""
        with np.errstate(divide="ignore"):
            return self.lower * np.exp(-np.log1p(-np.asarray(q, dtype=float)) / self.shape)

    def mean(self) -> float:
        """Return E X; infinite for shapes of at most one."""
        return self.lower * self.shape / (self.shape - 1) if self.shape > 1 else math.inf

    def rvs(self, generator: np.random.Generator, size: int) -> Array:
        """Independent draws, shape (size,), by the inverse cdf."""
        return self.ppf(generator.random(size))
