"""What a sampler can have missed: a bound on the probability of parts of the event that no run has met.

Some runs are draws of the wide law, whatever the surrogate believes. If N of them would meet a part A of the
event with probability W(A) each, none of them meets it with probability at most exp(-N W(A)). So with
confidence 1 - alpha, an unseen part has W(A) < m = log(1 / alpha) / N. What probability it can have depends
on its shape, of which nobody knows anything; so the shape is the assumption that the bound is stated for.

A mode of radius rho is a part that lies beyond the plane through its point nearest to the origin, and that
holds the ball of radius rho which touches that plane there. An infinite radius gives the half-spaces, and 0
any set at all. docs/sampler.md derives the bounds.
"""

import math
from functools import lru_cache

import numpy as np
from scipy.special import betaincc, chdtri, ndtr

from accelerated_evaluation.distributions.protocol import Array
from accelerated_evaluation.methods.surrogate.constants import REACH, UNSEEN_ALPHA

STEPS = 600  # of the integral over the rarity, and of the distances that are tried


def unseen_bound(runs: float, dimension: int, radius: float) -> float:
    """Return what the probability of an unseen part cannot exceed, with confidence 1 - `UNSEEN_ALPHA`.

    Parameters
    ----------
    runs
        Number N of draws of the wide law, none of which met the part.
    dimension
        Number of normal scores.
    radius
        Radius of the modes that the bound is for, in normal scores: infinite for half-spaces, 0 for any set.
    """
    mass = -math.log(UNSEEN_ALPHA) / max(runs, 1.0)
    # Of all sets of this mass the ball about the origin has the largest probability.
    any_set = -math.expm1(-REACH * min(mass, 1.0))
    if radius == 0:
        return any_set
    distances, masses = _masses_of_modes(dimension, radius)
    beyond = np.flatnonzero(masses <= mass)
    nearest = distances[beyond[0]] if len(beyond) else distances[-1]
    return min(any_set, float(ndtr(-nearest)))


@lru_cache
def _masses_of_modes(dimension: int, radius: float) -> tuple[Array, Array]:
    """Return distances of modes from the origin, and their masses under the wide law, shapes (k,)."""
    rarity = (np.arange(STEPS) + 0.5) / STEPS * REACH
    r = np.sqrt(chdtri(dimension, np.exp(-rarity)))
    distances = np.linspace(0, r[-1], STEPS)
    return distances, np.array([_share_of_directions(r, b, radius, dimension).mean() for b in distances])


def _share_of_directions(r: Array, distance: float, radius: float, dimension: int) -> Array:
    """Return the share of each sphere of radius r, shape (k,), that a mode at a distance covers.

    The part of a sphere in a half-space or ball is a cap, {cosine of the angle >= t}. For a uniform direction
    (1 + cosine) / 2 has a beta law with both parameters (d - 1) / 2; in one dimension there are two directions.
    """
    centre = distance + radius
    t = distance / r if math.isinf(radius) else (r * r + centre * centre - radius * radius) / (2 * r * centre)
    if dimension == 1:
        return np.where(t > 1, 0.0, np.where(t > -1, 0.5, 1.0))
    half = (dimension - 1) / 2
    return betaincc(half, half, np.clip((1 + t) / 2, 0, 1))
