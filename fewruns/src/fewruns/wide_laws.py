"""Distributions in the space of normal scores from which the points of a pool are drawn."""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.spatial.distance import cdist
from scipy.special import chdtr, chdtrc, chdtri, gammaincinv, gammaln

from fewruns.arrays import BLOCK, Array, Generator
from fewruns.constants import REACH, SMALLEST_SPREAD


def draw_wide(n: int, dimension: int, generator: Generator, reach: float = REACH) -> Array:
    """Draw n points, shape (n, d), with uniform directions and uniform rarities up to ``reach``."""
    return draw_at(generator.uniform(0, reach, n), dimension, generator)


def draw_at(rarity: Array, dimension: int, generator: Generator) -> Array:
    """Draw points, shape (n, d), with given rarities, shape (n,), in uniform directions."""
    radius = np.sqrt(chdtri(dimension, np.exp(-rarity)))
    z = generator.normal(size=(len(rarity), dimension))
    return z * (radius / np.linalg.norm(z, axis=1))[:, None]


def rarity(z: Array) -> Array:
    """Return the rarity -log P(|Z| > |z|), shape (n,), of points z, shape (n, d), for a standard normal Z."""
    return -_log_tail((z * z).sum(1), z.shape[1])


def log_normal_to_wide(z: Array) -> Array:
    """Return the log ratio of the standard normal to the wide density at z, shape (n,)."""
    log_tail = _log_tail((z * z).sum(1), z.shape[1])
    return np.where(log_tail >= -REACH, log_tail + math.log(REACH), np.inf)


def _log_tail(square: Array, dimension: int) -> Array:
    """Return log P(|Z|^2 > square) for a standard normal Z, computed from the smaller tail probability."""
    tail = square > 2 * gammaincinv(dimension / 2, 0.5)  # beyond the median
    log_tail = np.empty_like(square)
    with np.errstate(divide="ignore"):  # where the tail underflows
        log_tail[tail] = np.log(chdtrc(dimension, square[tail]))
    log_tail[~tail] = np.log1p(-chdtr(dimension, square[~tail]))
    return log_tail


def bound_without_event(runs: float, alpha: float) -> float:
    """Return an upper bound, with confidence 1 - alpha, on P(event) if no wide draw was an event.

    It is reached by the ball about the origin with the probability 1 - alpha^(1/runs) under the wide law.
    """
    return -math.expm1(-REACH * (1 - alpha ** (1 / max(runs, 1))))


def log_normal(z: Array) -> Array:
    """Return the log density, shape (n,), of the standard normal distribution at points z, shape (n, d)."""
    return -0.5 * (z * z).sum(1) - z.shape[1] / 2 * math.log(2 * math.pi)


def truncated(weight: Array) -> Array:
    """Return importance weights truncated at their mean times the root of their number (Ionides 2008)."""
    # Without it, a single point may outweigh all others in many dimensions, and become every centre.
    return np.minimum(weight, weight.mean() * math.sqrt(len(weight)))


@dataclass(frozen=True)
class KernelMixture:
    """A mixture of Student-t kernels with d degrees of freedom and of the wide distribution."""

    centres: Array  # centres of the kernels, shape (k, d)
    width: Array  # scale of the kernels in each dimension, shape (d,)
    wide_share: float  # share of the wide distribution

    @classmethod
    def about(cls, points: Array, wide_share: float) -> Self:
        """Return the mixture of kernels around points, shape (k, d), with widths by Silverman's rule."""
        k, d = points.shape
        return cls(points, np.maximum(points.std(0), SMALLEST_SPREAD) * k ** (-1 / (d + 4)), wide_share)

    def draw(self, n: int, generator: Generator) -> Array:
        """Draw n points, shape (n, d); the first ``wide_share`` n, rounded down, are wide draws."""
        wide, d = int(self.wide_share * n), self.centres.shape[1]
        step = generator.normal(size=(n - wide, d)) / np.sqrt(generator.chisquare(d, (n - wide, 1)) / d)
        centre = self.centres[generator.integers(len(self.centres), size=n - wide)]
        return np.vstack([draw_wide(wide, d, generator), centre + self.width * step])

    def log_normal_ratio(self, z: Array) -> Array:
        """Return the log ratio of the standard normal to the mixture density at points z, shape (n,)."""
        d, share = z.shape[1], self.wide_share
        scale = self.width * math.sqrt(d)
        # The density of a kernel is exp(constant) (1 + |z - centre|^2 / scale^2)^-d. With d degrees of
        # freedom, the exponent (degrees + d) / 2 of Student's density is the integer d.
        constant = gammaln(d) - gammaln(d / 2) - d / 2 * math.log(d * math.pi) - np.log(self.width).sum()
        normal = log_normal(z)
        wide = math.log(share) + normal - log_normal_to_wide(z)
        kernels = math.log1p(-share) + constant + np.log(_mean_kernel(z / scale, self.centres / scale))
        return normal - np.logaddexp(wide, kernels)


def _mean_kernel(a: Array, b: Array) -> Array:
    """Return the mean over the rows of b of (1 + |a - b|^2)^-d, for each row of a, shape (len(a),)."""
    mean, rows = np.empty(len(a)), max(BLOCK // len(b), 1)
    for first in range(0, len(a), rows):
        block = slice(first, first + rows)
        square = 1 + cdist(a[block], b, "sqeuclidean")
        mean[block] = (square ** -float(a.shape[1])).mean(axis=1)
    return mean
