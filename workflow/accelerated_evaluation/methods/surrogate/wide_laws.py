"""Laws in the space of normal scores from which the points of a pool are drawn."""

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.special import gammaln
from scipy.stats import chi2

from accelerated_evaluation.distributions.protocol import Array

REACH = 60.0  # the wide law reaches to the radius that a standard normal exceeds with probability exp(-REACH)


def draw_wide(n: int, dimension: int, generator: np.random.Generator) -> Array:
    """Draw n points in uniform directions, -log P(|Z| > their radius) uniform on [0, REACH]; shape (n, d)."""
    radius = np.sqrt(chi2.isf(np.exp(-generator.uniform(0, REACH, n)), dimension))
    z = generator.normal(size=(n, dimension))
    return z * (radius / np.linalg.norm(z, axis=1))[:, None]


def log_normal_to_wide(z: Array) -> Array:
    """Log ratio of the standard normal density to the wide law's, shape (n,); infinite beyond its reach."""
    tail = chi2.logsf((z * z).sum(1), z.shape[1])
    return np.where(tail >= -REACH, tail + math.log(REACH), np.inf)


def bound_without_event(runs: int, alpha: float) -> float:
    """Return what P(event) cannot exceed, with confidence 1 - alpha, if no run of the wide law met it.

    The event has at most the mass 1 - alpha^(1/runs) under that law, in the worst case about the origin.
    """
    return -math.expm1(-REACH * (1 - alpha ** (1 / max(runs, 1))))


def log_normal(z: Array) -> Array:
    """Log density of the standard normal, shape (n,)."""
    return -0.5 * (z * z).sum(1) - z.shape[1] / 2 * math.log(2 * math.pi)


@dataclass(frozen=True)
class KernelMixture:
    """Student-t kernels with d degrees of freedom about ``centres``, and a share of the wide law.

    Parameters
    ----------
    centres
        Points about which to draw, shape (k, d).
    width
        Scale of the kernels in each dimension, shape (d,).
    wide_share
        Share of the wide law.
    """

    centres: Array
    width: Array
    wide_share: float

    @classmethod
    def about(cls, points: Array, wide_share: float) -> "KernelMixture":
        """Return kernels about a sample of points, shape (k, d), by Silverman's rule."""
        k, d = points.shape
        return cls(points, np.maximum(points.std(0), 0.1) * k ** (-1 / (d + 4)), wide_share)

    def draw(self, n: int, generator: np.random.Generator) -> Array:
        """Draw n points, the share of the wide law exactly; shape (n, d)."""
        wide, d = int(self.wide_share * n), self.centres.shape[1]
        step = generator.normal(size=(n - wide, d)) / np.sqrt(generator.chisquare(d, (n - wide, 1)) / d)
        centre = self.centres[generator.integers(len(self.centres), size=n - wide)]
        return np.vstack([draw_wide(wide, d, generator), centre + self.width * step])

    def log_normal_ratio(self, z: Array) -> Array:
        """Log ratio of the standard normal density to the mixture's, shape (n,)."""
        d = z.shape[1]
        scale = self.width * math.sqrt(d)
        constant = gammaln(d) - gammaln(d / 2) - d / 2 * math.log(d * math.pi) - np.log(self.width).sum()
        normal = log_normal(z)
        wide = math.log(self.wide_share) + normal - log_normal_to_wide(z)
        kernels = (
            math.log1p(-self.wide_share) + constant + np.log(_mean_kernel(z / scale, self.centres / scale))
        )
        return normal - np.logaddexp(wide, kernels)


@njit(cache=True)
def _mean_kernel(a: Array, b: Array) -> Array:
    """Mean over b of (1 + |a - b|^2)^-d, shape (len(a),)."""
    n, d = a.shape
    mean = np.empty(n)
    for i in range(n):
        total = 0.0
        for j in range(b.shape[0]):
            square = 1.0
            for k in range(d):
                square += (a[i, k] - b[j, k]) ** 2
            total += square**-d
        mean[i] = total / b.shape[0]
    return mean
