"""Where the scores leave room for another part of the event: how far around it a run excludes the event.

A score says how close a run came to the event. How far from the event a run with such a score can be is
learnt from the known parts: no run with at least the score s is nearer to a known event than the distance
rho(s). If the scores decrease towards an unknown part at most `STEEPER` times as steeply, no point of this
part is within the *clearance* rho(s) / `STEEPER` of the run. Only the order of the scores matters. If they
jump, or are the same next to the event and far from it, rho is small, and the runs exclude little around
them.

The parts in question are balls of a given probability, which are the smaller the nearer they are to the
origin. A ball is *open* if it is outside the clearances of all runs, and contains no run and no known event.
"""

from functools import partial

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist
from scipy.special import chndtrinc

from fewruns.arrays import Array, Flags
from fewruns.constants import RADII, ROUNDS, SMALLEST_BALL, STEEPER, TRIED_BALLS
from fewruns.cover import close, draw_modes, room


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
    z: Array,
    clearance: Array,
    known: Array,
    probability: float,
    largest: float,
    generator: np.random.Generator,
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
