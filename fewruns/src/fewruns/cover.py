"""Balls that contain no run: covers, and clearances, which show where the event may have another part.

As in `certificate`, a mode lies beyond the plane that is perpendicular to its point x nearest to the origin,
and contains the ball of radius 1 / curvature that touches this plane at x. If u is the direction and b the
length of x, the centre of this ball is (b + 1 / curvature) u. A mode that contains a run would have been
observed. With a *cover*, runs are so dense that every mode would contain one of them. All runs count,
whatever they were made for.

Scores leave room for smaller parts, which are balls as well. A score says how close a run came to the event.
How far from the event a run with such a score can be is learnt from the known parts: no run with at least the
score s is nearer to a known event than the distance rho(s). If the scores decrease towards an unknown part at
most `STEEPER` times as steeply, no point of this part is within the *clearance* rho(s) / `STEEPER` of the
run. Only the order of the scores matters. If they jump, or are the same next to the event and far from it,
rho is small, and the runs exclude little around them. The balls in question have a given probability, and are
the smaller the nearer they are to the origin. A ball is *open* if it is outside the clearances of all runs,
and contains no run and no known event. In a cover, all clearances are 0.

Balls are rows of their centres and radii, shape (m, d + 1).
"""

import math
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist
from scipy.special import chdtri, chndtrinc, ndtr, ndtri

from fewruns.arrays import Array, Flags, Function, Generator, Indices
from fewruns.constants import (
    CANDIDATES,
    COVER_MISSED,
    COVER_SHARE,
    FARTHEST,
    MODES,
    RADII,
    REACH,
    ROUNDEST,
    ROUNDNESS,
    ROUNDNESS_OF_FLAGS,
    ROUNDS,
    SMALLEST_BALL,
    STEEPER,
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

    def next_runs(self, n: int, z: Array, probability: float, unseen: float, generator: Generator) -> Array:
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


def draw_modes(n: int, dimension: int, farthest: float, generator: Generator) -> tuple[Array, Array]:
    """Return n random modes, more of them the farther out: directions, shape (n, d), and distances."""
    u = generator.normal(size=(n, dimension))
    return u / np.linalg.norm(u, axis=1)[:, None], farthest * np.sqrt(generator.random(n))


def room(balls: Array, z: Array, clearance: Array | float = 0.0) -> Array:
    """Return how far each of m balls is outside the clearances of runs z; negative if one is inside, (m,)."""
    return (cdist(balls[:, :-1], z) - clearance).min(axis=1, initial=np.inf) - balls[:, -1]


def close(
    n: int,
    balls: Array,
    generator: Generator,
    *,
    clearances: Function = lambda points: np.zeros(len(points)),
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


def clearances(z: Array, happened: Flags, score: Array, known: Array) -> Array:
    """Return the clearance of each of n runs, shape (n,), given points of known parts, shape (k, d).

    It is 0 for events. The scores of distant runs may be larger than those of all runs around a known part.
    But no run is farther from the event than another one is, and the distance between the two.
    """
    clearance, others = np.zeros(len(z)), ~happened
    distance, score = cKDTree(known).query(z[others])[0], score[others]
    order = np.argsort(score)
    least = np.minimum.accumulate(distance[order][::-1])[::-1]  # of all runs with at least this score
    least = least[np.searchsorted(score[order], score)]
    clearance[others] = (least + cdist(z[others], z[others])).min(axis=1) / STEEPER
    return clearance


def balls_with(probability: float, largest: float, d: int) -> tuple[Array, Array]:
    """Return radii up to ``largest``, and how far from the origin the balls of a probability begin, (k,)."""
    radius = np.geomspace(SMALLEST_BALL, 1.0, RADII) * largest
    return radius, np.maximum(np.sqrt(chndtrinc(radius**2, d, probability)) - radius, 0.0)


def find_open_balls(
    z: Array, clearance: Array, known: Array, probability: float, largest: float, generator: Generator
) -> Array:
    """Return open balls of a probability with radii up to ``largest``: centres and radii, shape (m, d + 1).

    Random balls are tried first, and then others around those that are most nearly open.
    """
    d = z.shape[1]
    radius, begin = balls_with(probability, largest, d)
    u, b = draw_modes(TRIED_BALLS, d, begin[-1], generator)
    centre = u * (b + np.interp(b, begin, radius))[:, None]
    points, clear = np.vstack([z, known]), np.append(clearance, np.zeros(len(known)))
    found = np.empty((0, d + 1))
    for _ in range(ROUNDS):
        own = np.interp(np.linalg.norm(centre, axis=1), begin + radius, radius)
        balls = np.column_stack([centre, own])
        gap = room(balls, points, clear)
        found = np.vstack([found, balls[gap > 0]])
        best = np.resize(np.argsort(-gap)[: TRIED_BALLS // 10], TRIED_BALLS)
        centre = centre[best] + generator.normal(size=centre.shape) * (own[best] / np.sqrt(d))[:, None]
        length = np.linalg.norm(centre, axis=1)
        centre *= np.minimum((begin + radius)[-1] / length, 1.0)[:, None]
    return found


def points_in_open_balls(
    n: int,
    z: Array,
    happened: Flags,
    score: Array,
    centres: Array,
    probability: float,
    largest: float,
    unknown: Array,
) -> Array:
    """Return up to n points, shape (m, d), that close most open balls; none if there is no open ball.

    Parameters
    ----------
    n
        Number of points.
    z, happened, score
        The runs.
    centres
        Important points of known parts, in addition to the events, shape (k, d).
    probability, largest
        Probability of the balls, and their largest radius.
    unknown
        Runs without a score, pending or failed, shape (m, d); their clearances are the expected ones.
    """
    known = np.vstack([z[happened], centres])
    generator = np.random.Generator(np.random.PCG64(len(z)))
    clearance = clearances(z, happened, score, known)
    expected = partial(_expected, z=z[~happened], clearance=clearance[~happened], known=known)
    runs, clear = np.vstack([z, unknown]), np.append(clearance, expected(unknown))
    balls = find_open_balls(runs, clear, known, probability, largest, generator)
    return close(n, balls, generator, clearances=expected) if len(balls) else z[:0]


def _expected(points: Array, z: Array, clearance: Array, known: Array) -> Array:
    """Return the clearances expected of new runs, shape (m,), from those of the runs z without the event.

    They change at most by 1 / `STEEPER` per unit of length, and are expected midway between their bounds.
    """
    apart, own = cdist(points, z) / STEEPER, clearance
    most = np.minimum((own + apart).min(axis=1), cKDTree(known).query(points)[0] / STEEPER)
    return (most + np.clip((own - apart).max(axis=1), 0.0, most)) / 2
