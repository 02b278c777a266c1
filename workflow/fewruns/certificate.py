"""Upper bounds on the probability of a part of the event that no run of a sampler has observed.

Some runs are draws from the wide distribution up to a given rarity (both are defined in `wide_laws`),
independently of the surrogate. Let Q(A) be the expected number of these draws in a part A of the event. The
probability that no draw is in A is at most exp(-Q(A)). Therefore, with confidence 1 - alpha, a part in which
there is no draw has Q(A) < log(1 / alpha). How probable such a part can be depends on its shape, which is
unknown. The bound is therefore stated twice: for parts of one kind, which are called modes, and for sets of
any shape.

Let x be the point of a mode that is nearest to the origin. The mode lies beyond the plane through x that is
perpendicular to x, and contains the ball of radius 1 / curvature that touches this plane at x. A half-space
has the curvature 0. A mode counts as unobserved if no run was in it up to the rarity that the event reaches.
Farther out, it may be connected with the known part of the event. Notebook 10 derives both bounds.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Self

import numpy as np
from scipy.special import betaincc, chdtri, ndtr, ndtri

from fewruns.arrays import Array
from fewruns.constants import BEYOND, FEW, REACH, UNSEEN_ALPHA
from fewruns.wide_laws import rarity

STEPS = 600  # number of steps of the integrals over the rarity, and of distances of modes
RARITIES = (np.arange(STEPS) + 0.5) / STEPS * REACH


@dataclass(frozen=True)
class Certificate:
    """The bound on the probability of an unobserved mode that is required before an estimate has converged.

    Attributes
    ----------
    share
        Largest allowed ratio of the bound on the probability of an unobserved mode to the estimate.
    curvature
        Largest curvature of the modes that must be excluded, one over a length in normal scores.
    filled
        Smallest share of the encounters in such a mode in which the event happens. If it is below 1, the
        event happens in a draw from the mode only with this probability, and more draws are needed to exclude
        the mode.
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


# By default, an unobserved half-space must not be more than a thousand times as probable as the estimate. If
# the search has found the main part of the event, the usual runs are enough for this. If it has found only a
# remote part with a billionth of the probability, they are not, and the sampler continues.
BY_DEFAULT = Certificate(share=1000.0, curvature=0.0)


@dataclass(frozen=True)
class Unseen:
    """Bounds on the probability of a part of the event that no run has observed.

    The confidence of each bound is 1 - `UNSEEN_ALPHA`.

    Attributes
    ----------
    runs
        Number of draws from the wide distribution on which the bounds are based.
    mode, anything
        Upper bound on the probability of an unobserved part that is a mode, and of one that has any shape.
    """

    runs: float
    mode: float
    anything: float

    @classmethod
    def after(
        cls, wide_draws: Array, dimension: int, reach: float, curvature: float, filled: float = 1.0
    ) -> Self:
        """Return bounds on the probability of a part of the event that contains none of the draws.

        Parameters
        ----------
        wide_draws
            For each of k groups of draws from the wide distribution: their number, and the smallest and
            largest rarity of the group, shape (k, 3).
        dimension
            Number of normal scores.
        reach
            Largest rarity up to which draws can exclude a mode.
        curvature
            Largest curvature of the mode, one over a length in normal scores.
        filled
            Smallest share of the encounters in the mode in which the event happens.
        """
        mode = _nearest(wide_draws * [filled, 1, 1], dimension, reach, curvature)
        probability = filled * float(ndtr(-_caps(dimension, curvature)[0][mode]))
        return cls(float(wide_draws[:, 0].sum()), probability, _bound_of_any_set(wide_draws))


def look_beyond(wide_draws: Array, dimension: int, reach: float, curvature: float, share: float) -> float:
    """Return the smallest rarity of the next defensive runs, chosen to exclude unobserved modes quickly.

    Defensive runs are drawn from the wide distribution between the returned rarity and ``reach``. They are
    meant to exclude the mode nearest to the origin among those that the runs so far do not exclude. The
    returned rarity maximises the probability that a defensive run is in this mode. It does not exceed the
    rarity of the nearest point of the least probable mode that must be excluded, so that no mode that must be
    excluded is out of reach of the runs.

    Parameters
    ----------
    wide_draws, dimension, reach, curvature
        Draws so far (number, smallest and largest rarity of each of k groups, shape (k, 3)), number of
        normal scores, largest rarity of the defensive runs, and largest curvature of the modes.
    share
        Probability of the least probable mode that must be excluded.
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


def _bound_of_any_set(wide_draws: Array) -> float:
    """Return the largest probability that an unobserved set of any shape can have.

    The worst set is a ball about the origin, because the ratio of the expected number of draws to the
    probability is smallest there. The ball whose surface has the rarity u has the probability 1 - exp(-u).
    """
    expected = np.concatenate([[0.0], np.cumsum(_draws_at(wide_draws, RARITIES)) * REACH / STEPS])
    surface = np.interp(-math.log(UNSEEN_ALPHA), expected, np.arange(STEPS + 1) / STEPS * REACH)
    return -math.expm1(-surface)


@lru_cache
def _caps(dimension: int, curvature: float) -> tuple[Array, Array]:
    """Return distances of modes from the origin, and the shares of directions that the modes cover.

    The distances have shape (k,). The shares have shape (k, STEPS), with a column for each of `RARITIES`.
    """
    radius = np.sqrt(chdtri(dimension, np.exp(-RARITIES)))
    distances = np.linspace(0, radius[-1], STEPS)
    return distances, np.array([_cap(radius, distance, dimension, curvature) for distance in distances])


def _cap(radius: Array, distance: float, dimension: int, curvature: float) -> Array:
    """Return the share of each sphere about the origin that a mode covers, for radii of shape (k,).

    A half-space or a ball cuts a cap {cosine >= t} out of a sphere. For a uniform direction, (1 + cosine) / 2
    has a beta distribution with both parameters (d - 1) / 2. In one dimension there are only two directions.
    """
    r, b = radius, distance
    # A point at radius r is in the ball if curvature (r^2 + b^2) / 2 + b <= (1 + curvature b) r cosine.
    t = (curvature * (r * r + b * b) / 2 + b) / (r * (1 + curvature * b))
    if dimension == 1:
        return np.where(t > 1, 0.0, np.where(t > -1, 0.5, 1.0))
    half = (dimension - 1) / 2
    return betaincc(half, half, np.clip((1 + t) / 2, 0, 1))
