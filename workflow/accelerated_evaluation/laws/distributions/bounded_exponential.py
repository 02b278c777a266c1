"""Bounded exponential distribution (paper, section III.B.1), and the base class of bounded distributions."""

import math
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.distributions.described import Described, Parameter, distribution

LEAST = 1e-150  # smallest distance used as a divisor; its square is still a positive double


class Bounded(Described):
    """A distribution on ``[lower, upper)`` with a log-concave density that is known up to a constant factor.

    Integrals of the density f are computed relative to the largest value of f on their interval. They
    therefore neither overflow nor underflow, and tail probabilities do not suffer from cancellation.
    """

    lower: float
    upper: float

    @abstractmethod
    def _peak(self, low: Array | float, high: Array | float) -> Array:
        """Return the point of the interval with the largest density."""

    @abstractmethod
    def _log_relative(self, x: ArrayLike, reference: ArrayLike) -> Array:
        """Return log(f(x) / f(reference)), where f is the density up to a constant factor."""

    @abstractmethod
    def _integral(self, low: Array | float, high: Array | float) -> Array:
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

    def _share(self, low: Array | float, high: Array | float) -> tuple[Array, Array]:
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

    @np.errstate(over="ignore", divide="ignore")
    def logsf(self, x: ArrayLike) -> Array:
        """Return log P(X > x)."""
        share, log_factor = self._share(self._clip(x), self.upper)
        return np.log(share) + log_factor

    def cumulant(self, theta: float) -> float:
        """Return kappa(theta) = log E exp(theta X)."""
        tilted = self.tilt(theta)
        shift = float(self._log_relative(tilted._mode, self._mode))
        return theta * tilted._mode + shift + math.log(tilted._total / self._total)


@distribution("bounded exponential")
@dataclass(frozen=True)
class BoundedExponential(Bounded):
    """Density proportional to exp(-rate x) on ``[lower, upper)``."""

    # Any real number if `upper` is finite: zero (uniform density) and negative values (increasing density)
    # occur after exponential tilting. It must be positive if `upper` is infinite.
    rate: float
    lower: float = 0.0
    upper: float = math.inf

    parameters: ClassVar[Mapping[str, Parameter]] = {"rate": Parameter(power=-1, symbol=r"\lambda")}

    def __post_init__(self) -> None:
        if not (math.isfinite(self.lower) and self.lower < self.upper):
            raise ValueError(f"bounds must satisfy -inf < lower < upper, got [{self.lower}, {self.upper})")
        if not math.isfinite(self.rate) or (self.rate <= 0 and math.isinf(self.upper)):
            raise ValueError(f"rate must be finite, and positive on an unbounded support, got {self.rate}")

    @classmethod
    def from_mean(cls, mean: float, lower: float = 0.0, upper: float = math.inf) -> "BoundedExponential":
        """Return the bounded exponential distribution with the given mean.

        The maximum-likelihood estimate and the Cross-Entropy update are both found in this way. The mean
        decreases strictly with the rate, from ``upper`` to ``lower``, so there is exactly one solution.
        ValueError is raised if the mean is not strictly inside the support.
        """
        if not lower < mean < upper:
            raise ValueError(f"the mean must lie inside ({lower}, {upper}), got {mean}")
        if math.isinf(upper):
            return cls(1 / max(mean - lower, LEAST), lower, upper)
        below, above, width = mean - lower, upper - mean, max(upper - lower, LEAST)
        share = max(min(below, above) / width, LEAST)
        # The mean of the density proportional to exp(-s y) on [0, 1] is below 1 / s. The bracket is wider,
        # because of rounding.
        scaled = brentq(lambda s: _unit_mean(s) - share, -1, 2 / share, xtol=1e-13, rtol=1e-15)
        return cls(math.copysign(scaled / width, above - below), lower, upper)

    @classmethod
    def fit(cls, x: Array, lower: float, upper: float) -> "BoundedExponential":
        """Return the maximum-likelihood fit to a sample x, shape (n,), on [lower, upper).

        The fitted distribution has the same mean as the sample.
        """
        # If all values are nearly equal, rounding may place their mean on a bound.
        mean = np.clip(np.mean(x), np.nextafter(lower, upper), np.nextafter(upper, lower))
        return cls.from_mean(float(mean), lower, upper)

    @property
    def _width(self) -> float:
        return self.upper - self.lower

    @property
    def _is_flat(self) -> bool:
        """Whether the density is uniform to rounding."""
        return bool(abs(self.rate) * self._width < np.finfo(float).eps)

    def _peak(self, low: Array | float, high: Array | float) -> Array:
        return np.asarray(low if self.rate >= 0 else high)

    def _log_relative(self, x: ArrayLike, reference: ArrayLike) -> Array:
        return -self.rate * np.subtract(x, reference)

    def _integral(self, low: Array | float, high: Array | float) -> Array:
        width, steepness = np.subtract(high, low), abs(self.rate)
        return width if self._is_flat else -np.expm1(-steepness * width) / steepness

    def ppf(self, q: ArrayLike) -> Array:
        """Return the quantile x with P(X <= x) = q (paper, appendix A)."""
        q = np.asarray(q, dtype=float)
        x = self.lower + (self._near_dense(q) if self.rate >= 0 else self._near_thin(q))
        return np.clip(x, self.lower, self.upper)

    def isf(self, q: ArrayLike) -> Array:
        """Return x with P(X > x) = q, accurate for small q."""
        q = np.asarray(q, dtype=float)
        x = self.lower + self._beyond(q) if self.rate >= 0 else self.upper - self._near_dense(q)
        return np.clip(x, self.lower, self.upper)

    @np.errstate(divide="ignore")
    def _near_dense(self, q: Array) -> Array:
        """Distance from the bound with the larger density within which the probability is ``q``."""
        if self._is_flat:
            return q * self._width
        return -np.log1p(q * math.expm1(-abs(self.rate) * self._width)) / abs(self.rate)

    @np.errstate(divide="ignore")
    def _beyond(self, q: Array) -> Array:
        """Distance from the bound with the larger density beyond which the probability is ``q``."""
        fall = abs(self.rate) * self._width
        if fall < 1:
            return self._near_dense(1 - q)
        return -np.log(q + (1 - q) * math.exp(-fall)) / abs(self.rate)

    @np.errstate(divide="ignore")
    def _near_thin(self, q: Array) -> Array:
        """Distance from the bound with the smaller density within which the probability is ``q``."""
        if self._is_flat:
            return q * self._width
        fall = abs(self.rate) * self._width
        return np.logaddexp(0, np.log(q) + fall + math.log(-math.expm1(-fall))) / abs(self.rate)

    def mean(self) -> float:
        """Return the mean E X."""
        if math.isinf(self._width):
            return self.lower + 1 / self.rate
        return self.lower + self._width * _unit_mean(self.rate * self._width)

    @property
    def theta_limit(self) -> float:
        """Upper limit of theta in `tilt`: the rate if the support is unbounded, and infinity otherwise."""
        return self.rate if math.isinf(self._width) else math.inf

    def tilt(self, theta: float) -> "BoundedExponential":
        """Return the exponentially tilted distribution, whose rate is smaller by ``theta`` (section IV.B)."""
        return BoundedExponential(self.rate - theta, self.lower, self.upper)


def _unit_mean(scaled_rate: float) -> float:
    """Mean of the density proportional to exp(-s y) on [0, 1]: 1/s - 1/(e^s - 1)."""
    s = abs(scaled_rate)
    if s < 1e-2:  # where the two terms are nearly equal
        mean = 0.5 - s / 12 + s**3 / 720
    elif s < 700:
        mean = 1 / s - 1 / math.expm1(s)
    else:
        mean = 1 / s
    return mean if scaled_rate >= 0 else 1 - mean
