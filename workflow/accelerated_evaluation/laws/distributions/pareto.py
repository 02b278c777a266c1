"""Pareto distribution: the single parametric model of R^-1 in the authors' earlier work (section II)."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.distributions.described import Described, Parameter, distribution


@distribution("Pareto")
@dataclass(frozen=True)
class Pareto(Described):
    """The distribution P(X > x) = (lower / x)^shape for x >= lower > 0.

    The distribution cannot be tilted exponentially, because E exp(theta X) is infinite for every theta > 0.
    """

    shape: float
    lower: float

    parameters: ClassVar[Mapping[str, Parameter]] = {"shape": Parameter(power=0, symbol="k")}
    upper = math.inf

    def __post_init__(self) -> None:
        if not (0 < self.shape < math.inf and 0 < self.lower < math.inf):
            raise ValueError(f"shape and lower must be positive and finite, got {self.shape}, {self.lower}")

    @classmethod
    def fit(cls, x: Array, lower: float, upper: float = math.inf) -> "Pareto":
        """Return the maximum-likelihood fit to a sample x, shape (n,), above ``lower``.

        The estimate of the shape is n / sum log(x / lower). ValueError is raised if ``upper`` is finite,
        because this distribution has no upper bound.
        """
        return cls(float(x.size / np.log(x / lower).sum()), lower).rebounded(lower, upper)

    def rebounded(self, lower: float, upper: float) -> "Pareto":
        """Return the distribution with the same shape and another lower bound; ``upper`` must be infinite."""
        if upper != math.inf:
            raise ValueError(f"a Pareto distribution has no upper bound, got {upper}")
        return Pareto(self.shape, lower)

    def _log_excess(self, x: ArrayLike) -> Array:
        """Log of x / lower; 0 below the support."""
        return np.log1p((np.maximum(np.asarray(x, dtype=float), self.lower) - self.lower) / self.lower)

    def logpdf(self, x: ArrayLike) -> Array:
        """Return the log density at x; -inf outside the support."""
        density = math.log(self.shape / self.lower) - (self.shape + 1) * self._log_excess(x)
        return np.where(np.asarray(x) < self.lower, -np.inf, density)

    def logsf(self, x: ArrayLike) -> Array:
        """Return log P(X > x)."""
        return -self.shape * self._log_excess(x)

    def cdf(self, x: ArrayLike) -> Array:
        """Return P(X <= x)."""
        return -np.expm1(self.logsf(x))

    def isf(self, q: ArrayLike) -> Array:
        """Return x with P(X > x) = q, accurate for small q."""
        with np.errstate(divide="ignore", over="ignore"):
            return self.lower * np.exp(-np.log(np.asarray(q, dtype=float)) / self.shape)

    def ppf(self, q: ArrayLike) -> Array:
        """Return the quantile x with P(X <= x) = q."""
        with np.errstate(divide="ignore", over="ignore"):
            return self.lower * np.exp(-np.log1p(-np.asarray(q, dtype=float)) / self.shape)

    def mean(self) -> float:
        """Return E X, which is infinite if the shape is at most one."""
        return self.lower * self.shape / (self.shape - 1) if self.shape > 1 else math.inf
