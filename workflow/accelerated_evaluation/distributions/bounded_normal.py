"""Bounded normal distribution (paper, section III.B.2)."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import erfcx, log_ndtr, ndtri_exp

from accelerated_evaluation.distributions.bounded import Bounded
from accelerated_evaluation.distributions.protocol import Array

_NODES, _NODE_WEIGHTS = np.polynomial.legendre.leggauss(12)
_MOMENT_NODES, _MOMENT_WEIGHTS = np.polynomial.legendre.leggauss(64)


@dataclass(frozen=True)
class BoundedNormal(Bounded):
    """Normal distribution with ``location`` and ``sd``, conditional on ``[lower, upper)``.

    Parameters
    ----------
    sd
        Standard deviation of the whole normal distribution, positive.
    lower, upper
        Bounds of the support; both may be infinite.
    location
        Mean of the whole normal distribution: 0 where the paper fits it, theta sd^2 after a tilt of that.
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

    def _peak(self, low: ArrayLike, high: ArrayLike) -> Array:
        return np.clip(self.location, low, high)

    def _log_relative(self, x: ArrayLike, reference: ArrayLike) -> Array:
        distances = np.subtract(x, self.location) + np.subtract(reference, self.location)
        return -np.subtract(x, reference) * distances / (2 * self.sd**2)

    def _integral(self, low: ArrayLike, high: ArrayLike) -> Array:
        peak = self._peak(low, high)
        offset = np.abs(peak - self.location)
        return self._fall(offset, peak - low) + self._fall(offset, high - peak)

    def _fall(self, offset: Array, width: Array) -> Array:
        """Integral over ``width`` of the falling side, from ``offset`` on, divided by the density there."""
        exponent = width * (2 * offset + width) / (2 * self.sd**2)
        scale = self.sd * math.sqrt(2)
        far = erfcx(offset / scale) - np.exp(-exponent) * erfcx((offset + width) / scale)
        short = exponent < 1
        # There the two terms are nearly equal, and the density hardly changes.
        width = np.where(short, width, 0.0)[..., None]
        t = width * (_NODES + 1) / 2
        density = np.exp(-t * (2 * offset[..., None] + t) / (2 * self.sd**2))
        near = (density * _NODE_WEIGHTS).sum(axis=-1) * width[..., 0] / 2
        return np.where(short, near, far * scale * math.sqrt(math.pi) / 2)

    def ppf(self, q: ArrayLike) -> Array:
        """Inverse of cdf (paper, appendix A), solved in logarithms to the rounding of sd and x - location."""
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
        a, b = ((bound - self.location) / self.sd for bound in (self.lower, self.upper))
        log_cdf = np.logaddexp(log_above + log_ndtr(a), log_below + log_ndtr(b))
        log_sf = np.logaddexp(log_above + log_ndtr(-a), log_below + log_ndtr(-b))
        # Each side is solved where it is the smaller, and so the more exact.
        side, smaller = np.where(log_cdf < log_sf, 1, -1), np.minimum(np.minimum(log_cdf, log_sf), 0)
        score = side * ndtri_exp(smaller)
        return np.clip(self.location + self.sd * score, self.lower, self.upper)

    def mean(self) -> float:
        """Return E X."""
        distance, share = self._quadrature()
        return self._mode + float((distance * share).sum())

    def second_moment(self) -> float:
        """Return E X^2, what the maximum-likelihood equation of sd matches."""
        distance, share = self._quadrature()
        return float((np.square(self._mode + distance) * share).sum())

    def _quadrature(self) -> tuple[Array, Array]:
        """Gauss-Legendre nodes, as distances from the mode, and their shares of the mass.

        They span the support as far as the density is above exp(-40) of its largest value.
        """
        mode = self._mode
        offset = abs(mode - self.location)
        reach = 80 * self.sd**2 / (offset + math.sqrt(offset**2 + 80 * self.sd**2))
        low, high = max(self.lower - mode, -reach), min(self.upper - mode, reach)
        distance = (low + high) / 2 + (high - low) / 2 * _MOMENT_NODES
        share = _MOMENT_WEIGHTS * np.exp(self._log_relative(mode + distance, mode))
        return distance, share / share.sum()

    theta_limit = math.inf

    def tilt(self, theta: float) -> "BoundedNormal":
        """Exponential change of measure: the location moves by theta sd^2 (paper, section IV.B)."""
        return BoundedNormal(self.sd, self.lower, self.upper, self.location + theta * self.sd**2)
