"""Empirical distribution, which is used for the recorded lead speeds."""

import numpy as np
from numpy.typing import ArrayLike

from accelerated_evaluation.base.arrays import Array


class Empirical:
    """The empirical distribution of recorded values: each value has the same probability."""

    def __init__(self, values: ArrayLike) -> None:
        self.values = np.sort(np.asarray(values, dtype=float))
        if self.values.size == 0:
            raise ValueError("an empirical distribution needs at least one value")
        self.lower, self.upper = float(self.values[0]), float(self.values[-1])

    def __repr__(self) -> str:
        return f"Empirical({self.values.size} values from {self.lower} to {self.upper}, mean {self.mean()})"

    def cdf(self, x: ArrayLike) -> Array:
        """Return P(X <= x)."""
        return np.searchsorted(self.values, x, side="right") / self.values.size

    def sf(self, x: ArrayLike) -> Array:
        """Return P(X > x)."""
        return 1 - self.cdf(x)

    def ppf(self, q: ArrayLike) -> Array:
        """Return the quantile: the smallest recorded value x with P(X <= x) >= q."""
        index = np.ceil(np.asarray(q, dtype=float) * self.values.size).astype(int) - 1
        return self.values[np.clip(index, 0, self.values.size - 1)]

    def isf(self, q: ArrayLike) -> Array:
        """Return the smallest recorded value x with P(X > x) <= q."""
        index = self.values.size - 1 - np.floor(np.asarray(q, dtype=float) * self.values.size).astype(int)
        return self.values[np.clip(index, 0, self.values.size - 1)]

    def mean(self) -> float:
        """Return the mean E X."""
        return float(self.values.mean())

    def rvs(self, generator: np.random.Generator, size: int) -> Array:
        """Return independent draws from the recorded values, shape (size,)."""
        return self.values[generator.integers(self.values.size, size=size)]
