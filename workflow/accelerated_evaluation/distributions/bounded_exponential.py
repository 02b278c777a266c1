"""Bounded exponential distribution (paper, section III.B.1)."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq
from scipy.special import exprel

from accelerated_evaluation.distributions.protocol import Array


@dataclass(frozen=True)
class BoundedExponential:
    """Density proportional to exp(-rate x) on ``[lower, upper)``.

    Parameters
    ----------
    rate
        Any real number if ``upper`` is finite, zero (uniform) and negative (rising) ones included, as
        exponential tilting reaches them; positive if ``upper`` is infinite.
    lower, upper
        Bounds of the support; ``upper`` may be infinite.
    """

    rate: float
    lower: float = 0.0
    upper: float = math.inf

    def __post_init__(self) -> None:
        if not (math.isfinite(self.lower) and self.lower < self.upper):
            raise ValueError(f"bounds must satisfy -inf < lower < upper, got [{self.lower}, {self.upper})")
        if not math.isfinite(self.rate) or (self.rate <= 0 and math.isinf(self.upper)):
            raise ValueError(f"rate must be finite, and positive on an unbounded support, got {self.rate}")

    @classmethod
    def from_mean(cls, mean: float, lower: float = 0.0, upper: float = math.inf) -> "BoundedExponential":
        """Return the member with the given mean: maximum likelihood and Cross-Entropy both ask for it.

        The mean falls strictly in the rate, from ``upper`` to ``lower``, so there is one root.

        Raises
        ------
        ValueError
            If the mean is not strictly inside the support.
        """
        if not lower < mean < upper:
            raise ValueError(f"the mean must lie inside ({lower}, {upper}), got {mean}")
        if math.isinf(upper):
            return cls(1 / (mean - lower), lower, upper)
        width = upper - lower
        share = (mean - lower) / width
        # The mean of exp(-s y) on [0, 1] lies below 1 / s, so the root is inside (-1/(1-share), 1/share).
        scaled = brentq(lambda s: _unit_mean(s) - share, -1 / (1 - share), 1 / share, xtol=1e-13, rtol=1e-15)
        return cls(scaled / width, lower, upper)

    @property
    def n_parameters(self) -> int:
        """Number of free parameters: the rate."""
        return 1

    @property
    def _width(self) -> float:
        return self.upper - self.lower

    def _log_integral(self, width: ArrayLike) -> Array:
        """Log of the integral of exp(-rate y) from 0 to ``width``, stable for every real rate."""
        width = np.asarray(width, dtype=float)
        if math.isinf(self._width) and np.ndim(width) == 0 and np.isinf(width):
            return np.asarray(-math.log(self.rate))
        with np.errstate(divide="ignore"):
            exponent = -self.rate * width
            return np.log(width) + np.maximum(exponent, 0) + np.log(exprel(-np.abs(exponent)))

    def _log_integral_to_upper(self, y: Array) -> Array:
        """Log of the integral of exp(-rate t) for t from y to the upper bound."""
        if math.isinf(self._width):
            return -self.rate * y - math.log(self.rate)
        return -self.rate * y + self._log_integral(self._width - y)

    def _offset(self, x: ArrayLike) -> Array:
        return np.clip(np.asarray(x, dtype=float), self.lower, self.upper) - self.lower

    def logpdf(self, x: ArrayLike) -> Array:
        """Log density; -inf outside the support."""
        x = np.asarray(x, dtype=float)
        inside = (x >= self.lower) & (x < self.upper)
        return np.where(inside, -self.rate * self._offset(x) - self._log_integral(self._width), -np.inf)

    def cdf(self, x: ArrayLike) -> Array:
        """P(X <= x)."""
        y = self._offset(x)
        if math.isinf(self._width):
            return -np.expm1(-self.rate * y)
        return np.exp(self._log_integral(y) - self._log_integral(self._width))

    def sf(self, x: ArrayLike) -> Array:
        """P(X > x)."""
        return np.exp(self.logsf(x))

    def logsf(self, x: ArrayLike) -> Array:
        """Log P(X > x)."""
        return self._log_integral_to_upper(self._offset(x)) - self._log_integral(self._width)

    def ppf(self, q: ArrayLike) -> Array:
        """Inverse of cdf (paper, appendix A)."""
        q = np.asarray(q, dtype=float)
        return self.upper - self._short_side(q) if self.rate < 0 else self.lower + self._long_side(q)

    def isf(self, q: ArrayLike) -> Array:
        """Inverse of sf."""
        q = np.asarray(q, dtype=float)
        return self.upper - self._long_side(q) if self.rate < 0 else self.lower + self._short_side(q)

    def _long_side(self, q: Array) -> Array:
        """Distance from the denser bound below which a share ``q`` of the mass lies."""
        rate = abs(self.rate)
        if rate * self._width < 1e-12:
            return q * self._width
        with np.errstate(divide="ignore"):
            return np.minimum(-np.log1p(q * np.expm1(-rate * self._width)) / rate, self._width)

    def _short_side(self, q: Array) -> Array:
        """Distance from the denser bound beyond which a share ``q`` of the mass lies."""
        rate = abs(self.rate)
        if rate * self._width < 1:
            return self._long_side(1 - q)
        with np.errstate(divide="ignore"):
            return np.minimum(-np.log(q + (1 - q) * np.exp(-rate * self._width)) / rate, self._width)

    def mean(self) -> float:
        """Return E X."""
        if math.isinf(self._width):
            return self.lower + 1 / self.rate
        return self.lower + self._width * _unit_mean(self.rate * self._width)

    def rvs(self, generator: np.random.Generator, size: int) -> Array:
        """Independent draws, shape (size,), by the inverse cdf."""
        return self.ppf(generator.random(size))

    @property
    def theta_limit(self) -> float:
        """Tilts must stay below this: the rate, on an unbounded support."""
        return self.rate if math.isinf(self._width) else math.inf

    def cumulant(self, theta: float) -> float:
        """Return kappa(theta) = log E exp(theta X)."""
        tilted = self.tilt(theta)
        return theta * self.lower + float(
            tilted._log_integral(self._width) - self._log_integral(self._width)
        )

    def tilt(self, theta: float) -> "BoundedExponential":
        """Exponential change of measure: the rate falls by ``theta`` (paper, section IV.B)."""
        return BoundedExponential(self.rate - theta, self.lower, self.upper)


def _unit_mean(scaled_rate: float) -> float:
    """Mean of the density proportional to exp(-s y) on [0, 1]: 1/s - 1/(e^s - 1)."""
    s = abs(scaled_rate)
    if s < 1e-2:
        mean = 0.5 - s / 12 + s**3 / 720
    else:
        mean = 1 / s - (1 / math.expm1(s) if s < 700 else 0.0)
    return mean if scaled_rate >= 0 else 1 - mean
