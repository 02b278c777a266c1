"""The methods that every distribution of this library has."""

from typing import Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from accelerated_evaluation.base.arrays import Array


@runtime_checkable
class Distribution(Protocol):
    """A univariate distribution on ``[lower, upper)``.

    All functions work element by element on arrays of any shape. They are accurate in far tails: ``logsf``
    works in logarithms, and ``isf`` accepts probabilities down to the smallest positive double.
    """

    lower: float
    upper: float

    def logpdf(self, x: ArrayLike) -> Array:
        """Return the log density at x; -inf outside the support."""

    def cdf(self, x: ArrayLike) -> Array:
        """Return P(X <= x)."""

    def sf(self, x: ArrayLike) -> Array:
        """Return P(X > x)."""

    def logsf(self, x: ArrayLike) -> Array:
        """Return log P(X > x)."""

    def ppf(self, q: ArrayLike) -> Array:
        """Return the quantile x with P(X <= x) = q, for q in [0, 1]."""

    def isf(self, q: ArrayLike) -> Array:
        """Return x with P(X > x) = q, for q in [0, 1]; it is accurate for small q."""

    def mean(self) -> float:
        """Return the mean E X."""

    def rvs(self, generator: np.random.Generator, size: int) -> Array:
        """Return independent draws from the distribution, shape (size,)."""


@runtime_checkable
class Tiltable(Distribution, Protocol):
    """A distribution that can be tilted exponentially (change of measure; paper, section IV.B)."""

    theta_limit: float  # upper limit of the parameter theta of the tilting; it may be infinite

    def cumulant(self, theta: float) -> float:
        """Return kappa(theta) = log E exp(theta X), the log moment generating function."""

    def tilt(self, theta: float) -> Self:
        """Return the exponentially tilted distribution, with density exp(theta x - kappa(theta)) f(x)."""
