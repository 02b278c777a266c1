"""What a sampler can have missed: a bound on the probability of a part of the event that no run has met.

Some runs are draws of the wide law, whatever the surrogate believes. If N of them meet a part A of the event
with probability W(A) each, none of them meets it with probability at most exp(-N W(A)). So with confidence
1 - alpha, an unseen part has W(A) < m = log(1 / alpha) / N. What probability such a part can have depends on
its shape, which nobody knows, so the bound is stated for a kind of parts: modes of limited curvature.

A mode lies beyond the plane through its point nearest to the origin, and holds the ball of radius 1 /
curvature that touches this plane there. Curvature 0 is that of half-spaces. `wide_laws.bound_without_event`
bounds any set at all. docs/sampler.md derives both.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import betaincc, chdtri, ndtr

from accelerated_evaluation.distributions.protocol import Array
from accelerated_evaluation.methods.surrogate.constants import REACH, UNSEEN_ALPHA

STEPS = 600  # of the integral over the rarity, and of the distances that are tried


@dataclass(frozen=True)
class Certificate:
    """What must be excluded before an estimate has converged.

    Attributes
    ----------
    share
        An unseen mode may have at most this multiple of the estimate.
    curvature
        Largest curvature of the modes, one over a length in normal scores.
    """

    share: float = 1.0
    curvature: float = 0.0

    def __post_init__(self) -> None:
        if not (self.share > 0 and 0 <= self.curvature < math.inf):
            raise ValueError(f"share must be positive and curvature finite and not negative, got {self}")


# By default an estimate has not converged while an unseen half-space can have more probability.
HALF_SPACES = Certificate()


def bound_of_modes(runs: float, dimension: int, curvature: float) -> float:
    """Return what P(A) cannot exceed, with confidence 1 - `UNSEEN_ALPHA`, for a mode A that no run met.

    Parameters
    ----------
    runs
        Number N of draws of the wide law, none of which met the mode.
    dimension
        Number of normal scores.
    curvature
        Largest curvature of the mode, one over a length in normal scores.

    Returns
    -------
    float
        Phi(-b), where b is the smallest distance at which a mode has less than the mass m.
    """
    distances, masses = _masses_of_modes(dimension, curvature)
    missed = np.flatnonzero(masses <= _largest_mass(runs))
    return float(ndtr(-distances[missed[0] if len(missed) else -1]))


def _largest_mass(runs: float) -> float:
    """Return the largest mass m under the wide law that none of N draws may have met."""
    return min(-math.log(UNSEEN_ALPHA) / max(runs, 1.0), 1.0)


@lru_cache
def _masses_of_modes(dimension: int, curvature: float) -> tuple[Array, Array]:
    """Return distances of modes from the origin, and their masses under the wide law, shapes (k,)."""
    rarity = (np.arange(STEPS) + 0.5) / STEPS * REACH
    radius = np.sqrt(chdtri(dimension, np.exp(-rarity)))
    distances = np.linspace(0, radius[-1], STEPS)
    return distances, np.array([_cap(radius, b, dimension, curvature).mean() for b in distances])


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
