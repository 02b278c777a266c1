"""Upper bounds on the probability of a part of the event that no run of a sampler has met.

Some runs are draws from the wide distribution up to a given rarity (`wide_laws`), independently of the
surrogate. With confidence 1 - alpha, a part in which none of them fell has an expected number Q of these
draws below log(1 / alpha). How probable such a part can be depends on its shape. The bound is therefore
stated for sets of any shape, and for modes: a mode lies beyond the plane that is perpendicular to its point x
nearest to the origin, and contains the ball of radius 1 / curvature that touches this plane at x.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Self

import numpy as np
from scipy.special import betaincc, chdtri, ndtr, ndtri

from fewruns.arrays import Array
from fewruns.constants import BEYOND, FEW, REACH, UNSEEN_ALPHA
from fewruns.errors import require
from fewruns.wide_laws import rarity

STEPS = 600  # number of steps of the integrals over the rarity, and of distances of modes
RARITIES = (np.arange(STEPS) + 0.5) / STEPS * REACH


@dataclass(frozen=True)
class Certificate:
    """The bound on the probability of an unobserved part of the event that is required for convergence.

    Attributes
    ----------
    share
        Largest allowed ratio of the bound, which has a confidence of 95 %, to the estimate. By default, a
        sampler uses 1000, which detects only a search that has found an extremely improbable part.
    curvature
        Largest curvature of the parts that must be excluded, one over a length in normal scores; 0 stands for
        half-spaces.
    filled
        Smallest share of the points in such a part in which the event happens.

    Examples
    --------
    >>> strict = Certificate(share=1.0, curvature=0.2)
    """

    share: float
    curvature: float
    filled: float = 1.0

    def __post_init__(self) -> None:
        fits = self.share > 0 and 0 <= self.curvature < math.inf and 0 < self.filled <= 1
        expected = "share above 0, curvature finite and not negative, filled above 0 and at most 1"
        require("certificate", self, expected, fits=fits)


# By default, an unobserved half-space must not be more than a thousand times as probable as the estimate. If
# the search has found the main part of the event, the usual runs are enough for this. If it has found only a
# remote part with a billionth of the probability, they are not, and the sampler continues.
BY_DEFAULT = Certificate(share=1000.0, curvature=0.0)


@dataclass(frozen=True)
class Unseen:
    """Bounds (confidence 1 - `UNSEEN_ALPHA`) on the probability of a part of the event that no run met."""

    runs: float  # number of draws from the wide distribution on which the bounds are based
    mode: float  # bound for modes of the given curvature
    anything: float  # bound for sets of any shape

    @classmethod
    def after(
        cls, wide_draws: Array, dimension: int, reach: float, curvature: float, filled: float = 1.0
    ) -> Self:
        """Return the bounds after draws of the wide law, rows of number, smallest and largest rarity."""
        mode = _nearest(wide_draws * [filled, 1, 1], dimension, reach, curvature)
        probability = filled * float(ndtr(-_caps(dimension, curvature)[0][mode]))
        return cls(float(wide_draws[:, 0].sum()), probability, bound_of_any_set(wide_draws))


def look_beyond(wide_draws: Array, dimension: int, reach: float, curvature: float, share: float) -> float:
    """Return the smallest rarity of the next defensive runs, chosen to exclude unobserved modes quickly.

    It maximises the probability that a run is in the nearest mode that is not excluded, but no mode that must
    be excluded, whose probability is at least ``share``, may be out of reach of the runs.
    """
    distances, caps = _caps(dimension, curvature)
    mode = _nearest(wide_draws, dimension, reach, curvature)
    nearest, farthest = rarity(np.outer([distances[mode], -ndtri(share)], np.eye(dimension)[0]))
    if dimension > FEW:  # the nearest points of all modes are in the bulk of the normal distribution
        farthest = max(farthest, reach - BEYOND)
    cap, middle = (values[reach >= RARITIES][::-1] for values in (caps[mode], RARITIES))
    begin = middle - REACH / STEPS / 2
    mean = np.cumsum(cap) / (np.arange(len(cap)) + 1)  # from each of these rarities to the reach
    mean[(begin < nearest) | (begin > farthest)] = 0.0
    return float(begin[mean.argmax()]) if mean.any() else 0.0


def _nearest(wide_draws: Array, dimension: int, reach: float, curvature: float) -> int:
    """Return the index of the nearest mode of `_caps` that is not excluded, or of the last mode."""
    caps = _caps(dimension, curvature)[1]
    expected = caps @ np.where(reach >= RARITIES, _draws_at(wide_draws, RARITIES), 0.0) * REACH / STEPS
    likely = np.flatnonzero(expected <= -math.log(UNSEEN_ALPHA))
    return int(likely[0]) if len(likely) else len(caps) - 1


def _draws_at(wide_draws: Array, at: Array) -> Array:
    """Return the number of draws per unit of rarity, in all directions, at given rarities, shape (k,)."""
    runs, begin, end = wide_draws.T[:, :, None]
    return (runs / (end - begin) * ((begin < at) & (at <= end))).sum(axis=0)


def bound_of_any_set(wide_draws: Array) -> float:
    """Return the largest probability of an unobserved set, which is a ball about the origin."""
    expected = np.concatenate([[0.0], np.cumsum(_draws_at(wide_draws, RARITIES)) * REACH / STEPS])
    surface = np.interp(-math.log(UNSEEN_ALPHA), expected, np.arange(STEPS + 1) / STEPS * REACH)
    return -math.expm1(-surface)


@lru_cache
def _caps(dimension: int, curvature: float) -> tuple[Array, Array]:
    """Return k distances of modes, and the shares of the directions at `RARITIES` in them, (k, STEPS)."""
    radius = np.sqrt(chdtri(dimension, np.exp(-RARITIES)))
    distances = np.linspace(0, radius[-1], STEPS)
    return distances, np.array([_cap(radius, distance, dimension, curvature) for distance in distances])


def _cap(radius: Array, distance: float, dimension: int, curvature: float) -> Array:
    """Return the share of each sphere about the origin that a mode covers, for radii of shape (k,)."""
    r, b = radius, distance
    # A point at radius r is in the ball if curvature (r^2 + b^2) / 2 + b <= (1 + curvature b) r cosine.
    t = (curvature * (r * r + b * b) / 2 + b) / (r * (1 + curvature * b))
    if dimension == 1:
        return np.where(t > 1, 0.0, np.where(t > -1, 0.5, 1.0))
    half = (dimension - 1) / 2
    return betaincc(half, half, np.clip((1 + t) / 2, 0, 1))
