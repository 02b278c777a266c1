"""A bound on the probability of a part of the event that no run of a sampler has met.

Some runs are draws of the wide law, cut at some rarity, whatever the surrogate believes. If Q(A) is the
number of them that is expected in a part A of the event, none is there with probability at most exp(-Q(A)).
So with confidence 1 - alpha, an unseen part has Q(A) < log(1 / alpha). What probability such a part can have
depends on its shape, which nobody knows, so the bound is stated for a kind of parts, and for any set.

A mode lies beyond the plane through its point nearest to the origin, and holds the ball of radius 1 /
curvature that touches this plane there; curvature 0 is that of a half-space. It is unseen if none of its
points up to the rarity of the event was met: farther out it may run together with what is known.
Notebook 10 derives both bounds.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Self

import numpy as np
from scipy.special import betaincc, chdtri, ndtr, ndtri

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.methods.surrogate.constants import BEYOND, FEW, REACH, UNSEEN_ALPHA
from accelerated_evaluation.methods.surrogate.wide_laws import rarity

STEPS = 600  # of the integrals over the rarity, and of the distances that are tried
RARITIES = (np.arange(STEPS) + 0.5) / STEPS * REACH


@dataclass(frozen=True)
class Certificate:
    """The bound that is required before an estimate has converged.

    Attributes
    ----------
    share
        Largest allowed ratio of the probability of an unmet mode to the estimate.
    curvature
        Largest curvature of the modes that must be excluded, one over a length in normal scores.
    filled
        Smallest share of the encounters in such a mode in which the event happens. If it is below 1, a draw
        in the mode meets the event only with this probability, and more draws are needed to exclude it.
    """

    share: float
    curvature: float
    filled: float = 1.0

    def __post_init__(self) -> None:
        if not (self.share > 0 and 0 <= self.curvature < math.inf and 0 < self.filled <= 1):
            raise ValueError(
                "share must be positive, curvature finite and not negative, and filled above 0 and at most "
                f"1, got {self}"
            )


# By default half-spaces must be excluded that are a thousand times as probable as the estimate. Where the
# event was found at its main part, the usual runs exclude them. Where it was found at a far end only, at a
# billionth of its probability, they do not, and the sampler goes on.
BY_DEFAULT = Certificate(share=1000.0, curvature=0.0)


@dataclass(frozen=True)
class Unseen:
    """Bounds on the probability of a part of the event that no run has met.

    They hold with confidence 1 - `UNSEEN_ALPHA`.

    Attributes
    ----------
    runs
        Number of draws from the wide distribution on which the bounds are based.
    mode, anything
        Bounds on the probability of the event in a mode, and in any set.
    """

    runs: float
    mode: float
    anything: float

    @classmethod
    def after(
        cls, wide_draws: Array, dimension: int, reach: float, curvature: float, filled: float = 1.0
    ) -> Self:
        """Return the bounds after some draws from the wide distribution.

        Parameters
        ----------
        wide_draws
            Number of draws, and the rarities between which they were made, shape (k, 3).
        dimension
            Number of normal scores.
        reach
            Rarity up to which no point of the mode was met.
        curvature
            Largest curvature of the mode, one over a length in normal scores.
        filled
            Share of the encounters in the mode in which the event happens.
        """
        mode = _nearest(wide_draws * [filled, 1, 1], dimension, reach, curvature)
        probability = filled * float(ndtr(-_caps(dimension, curvature)[0][mode]))
        return cls(float(wide_draws[:, 0].sum()), probability, _bound_of_any_set(wide_draws))


def unseen_in_words(diagnostics: Mapping[str, float]) -> str:
    """Return a sentence with the two bounds on the probability of unobserved parts of the event.

    They are ``unseen_mode`` and ``unseen_any`` in the diagnostics of an estimate.
    """
    return (
        f"a part of the event that no run has met: at most {diagnostics['unseen_mode']:.1g} if a half-space, "
        f"{diagnostics['unseen_any']:.1g} if of any shape ({1 - UNSEEN_ALPHA:.0%} confidence)"
    )


def look_beyond(wide_draws: Array, dimension: int, reach: float, curvature: float, share: float) -> float:
    """Return the rarity beyond which draws are most likely to meet the nearest mode that is not excluded.

    It never exceeds the rarity of the nearest point of the least probable mode that must be excluded.

    Parameters
    ----------
    wide_draws, dimension, reach, curvature
        As for `Unseen.after`.
    share
        Probability above which modes must be excluded.
    """
    distances, caps = _caps(dimension, curvature)
    mode = _nearest(wide_draws, dimension, reach, curvature)
    nearest, farthest = rarity(np.outer([distances[mode], -ndtri(share)], np.eye(dimension)[0]))
    if dimension > FEW:  # the nearest points of all modes are in the bulk and carry no information
        farthest = max(farthest, reach - BEYOND)
    cap, middle = (values[reach >= RARITIES][::-1] for values in (caps[mode], RARITIES))
    begin = middle - REACH / STEPS / 2
    mean = np.cumsum(cap) / (np.arange(len(cap)) + 1)  # from each of these rarities to the reach
    mean[(begin < nearest) | (begin > farthest)] = 0.0
    return float(begin[mean.argmax()]) if mean.any() else 0.0


def _nearest(wide_draws: Array, dimension: int, reach: float, curvature: float) -> int:
    """Return which of the modes of `_caps` is the nearest that is not excluded, or the last."""
    caps = _caps(dimension, curvature)[1]
    expected = caps @ np.where(reach >= RARITIES, _draws_at(wide_draws, RARITIES), 0.0) * REACH / STEPS
    likely = np.flatnonzero(expected <= -math.log(UNSEEN_ALPHA))
    return int(likely[0]) if len(likely) else len(caps) - 1


def _draws_at(wide_draws: Array, at: Array) -> Array:
    """Return the expected number of draws in all directions for a unit of rarity, shape (k,)."""
    runs, begin, end = wide_draws.T[:, :, None]
    return (runs / (end - begin) * ((begin < at) & (at <= end))).sum(axis=0)


def _bound_of_any_set(wide_draws: Array) -> float:
    """Return what P(A) cannot exceed for any set A.

    The worst set is a ball about the origin, because a unit of probability gets the fewest draws there. With
    a surface of rarity u it has the probability 1 - exp(-u).
    """
    expected = np.concatenate([[0.0], np.cumsum(_draws_at(wide_draws, RARITIES)) * REACH / STEPS])
    surface = np.interp(-math.log(UNSEEN_ALPHA), expected, np.arange(STEPS + 1) / STEPS * REACH)
    return -math.expm1(-surface)


@lru_cache
def _caps(dimension: int, curvature: float) -> tuple[Array, Array]:
    """Return distances of modes, shape (k,), and which share of the directions they cover at each rarity."""
    radius = np.sqrt(chdtri(dimension, np.exp(-RARITIES)))
    distances = np.linspace(0, radius[-1], STEPS)
    return distances, np.array([_cap(radius, distance, dimension, curvature) for distance in distances])


def _cap(radius: Array, distance: float, dimension: int, curvature: float) -> Array:
    """Return the share of spheres about the origin, of radii of shape (k,), that a mode covers.

    Half-space and ball cut a cap {cosine >= t} out of a sphere. (1 + cosine) / 2 of a uniform direction has
    a beta law with both parameters (d - 1) / 2; in one dimension there are only two directions.
    """
    r, b = radius, distance
    # A point at radius r is in the ball if curvature (r^2 + b^2) / 2 + b <= (1 + curvature b) r cosine.
    t = (curvature * (r * r + b * b) / 2 + b) / (r * (1 + curvature * b))
    if dimension == 1:
        return np.where(t > 1, 0.0, np.where(t > -1, 0.5, 1.0))
    half = (dimension - 1) / 2
    return betaincc(half, half, np.clip((1 + t) / 2, 0, 1))
