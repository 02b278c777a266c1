"""A cover: runs that are so dense that every simple part of the event would contain one of them.

As in `certificate`, a mode lies beyond the plane that is perpendicular to its point x nearest to the origin,
and contains the ball of radius 1 / curvature that touches this plane at x. If u is the direction and b the
length of x, the centre of this ball is (b + 1 / curvature) u. A mode that contains a run would have been
observed. All runs count, whatever they were made for.

Where scores leave room for smaller parts (`clearance`), these are balls as well, and `close` chooses the runs
for both. Balls are rows of their centres and radii, shape (m, d + 1).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.distance import cdist
from scipy.special import chdtri, ndtr, ndtri

from fewruns.arrays import Array, Flags, Indices
from fewruns.constants import (
    CANDIDATES,
    COVER_MISSED,
    COVER_SHARE,
    FARTHEST,
    MODES,
    REACH,
    ROUNDEST,
    ROUNDNESS,
    ROUNDNESS_OF_FLAGS,
    TRIED_BALLS,
)
from fewruns.errors import require
from fewruns.two_phase import reach_of


@dataclass(frozen=True)
class Cover:
    """The requirement that the runs exclude all unobserved modes above a probability.

    Attributes
    ----------
    share
        Largest allowed ratio of the probability of an unobserved mode to the estimate.
    curvature
        Largest curvature of the modes, one over a length in normal scores.

    Examples
    --------
    >>> thorough = Cover(share=0.2, curvature=1.0)
    """

    share: float
    curvature: float

    def __post_init__(self) -> None:
        fits = self.share > 0 and 0 < self.curvature < math.inf
        require("cover", self, "share above 0, curvature finite and above 0", fits=fits)

    @classmethod
    def by_default(cls, dimension: int, *, with_scores: bool = True) -> "Cover":
        """Return the default cover for a number of inputs; modes are flatter if there are many."""
        curvature = (ROUNDNESS if with_scores else ROUNDNESS_OF_FLAGS) / dimension**2.5
        return cls(COVER_SHARE, min(curvature, ROUNDEST) if with_scores else curvature)

    def unseen(self, z: Array) -> float:
        """Return the probability of the farthest modes up to which all but `COVER_MISSED` contain a run."""
        generator = np.random.Generator(np.random.PCG64(z.shape[1]))
        u, b = draw_modes(MODES, z.shape[1], FARTHEST, generator)
        b = np.sort(b)
        missed = np.cumsum(room(self._balls(u, b), z) > 0) > COVER_MISSED * np.arange(1, MODES + 1)
        return float(ndtr(-b[missed.argmax()] if missed.any() else -FARTHEST))

    def next_runs(
        self, n: int, z: Array, probability: float, unseen: float, generator: np.random.Generator
    ) -> Array:
        """Return n points, shape (n, d), that exclude most modes at least as probable as ``probability``.

        The modes that are at least as probable as ``unseen`` contain a run z already (`unseen`).
        """
        dimension, farthest = z.shape[1], -float(ndtri(probability))
        # The near modes come first. They are a small share of all modes, but none of them may be missed.
        farthest = min(farthest, max(1.0, -2 * float(ndtri(unseen))))
        # Other modes than those of `unseen`, which would otherwise be excluded better than all others.
        modes = self._balls(*draw_modes(MODES, dimension, farthest, generator))
        if (is_open := room(modes, z) > 0).any():
            modes = modes[is_open]
        longest = np.sqrt(chdtri(dimension, np.exp(-max(REACH / 2, reach_of(probability)))))
        return close(n, modes, generator, longest=longest)

    def _balls(self, u: Array, b: Array) -> Array:
        """Return the balls of modes in t directions at t distances, shape (t, d + 1)."""
        return np.column_stack([u * (b + 1 / self.curvature)[:, None], np.full(len(b), 1 / self.curvature)])


def draw_modes(
    n: int, dimension: int, farthest: float, generator: np.random.Generator
) -> tuple[Array, Array]:
    """Return n random modes, more of them the farther out: directions, shape (n, d), and distances."""
    u = generator.normal(size=(n, dimension))
    return u / np.linalg.norm(u, axis=1)[:, None], farthest * np.sqrt(generator.random(n))


def room(balls: Array, z: Array, clearance: Array | float = 0.0) -> Array:
    """Return how far each of m balls is outside the clearances of runs z; negative if one is inside, (m,)."""
    return (cdist(balls[:, :-1], z) - clearance).min(axis=1, initial=np.inf) - balls[:, -1]


def close(
    n: int,
    balls: Array,
    generator: np.random.Generator,
    *,
    clearances: Callable[[Array], Array] = lambda points: np.zeros(len(points)),
    longest: float = math.inf,
) -> Array:
    """Return up to n points, shape (k, d), such that most balls contain one or are inside its clearance.

    ``clearances`` returns those that are expected of runs at points, by default 0. The points are at most as
    far from the origin as the tangents to a ball, where a point is in most balls, and as ``longest``.
    """
    tried = balls[generator.integers(len(balls), size=CANDIDATES)]
    points = generator.normal(size=tried[:, :-1].shape)
    points *= (tried[:, -1] * generator.random(CANDIDATES) / np.linalg.norm(points, axis=1))[:, None]
    points += tried[:, :-1]
    square = (tried[:, :-1] ** 2).sum(axis=1) - tried[:, -1] ** 2  # of the tangent; the origin may be inside
    far = np.minimum(np.where(square > 0, np.sqrt(np.abs(square)), np.inf), longest)
    points *= np.minimum(far / np.linalg.norm(points, axis=1), 1.0)[:, None]
    balls = balls[generator.permutation(len(balls))[:TRIED_BALLS]]
    inside = cdist(points, balls[:, :-1]) <= balls[:, -1] + clearances(points)[:, None]
    return points[choose_covering(inside, min(n, len(balls)))]


def choose_covering(inside: Flags, n: int) -> Indices:
    """Return up to n of m points such that most of t sets contain one, given what they contain, (m, t)."""
    open_sets = np.ones(inside.shape[1])
    chosen: list[np.intp] = []
    while len(chosen) < n and (gain := inside @ open_sets).any():
        chosen.append(gain.argmax())
        open_sets[inside[chosen[-1]]] = 0.0
    return np.array(chosen, dtype=np.intp)
