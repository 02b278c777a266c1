"""Where known parts of the event may be larger than the estimate knows: around known events.

A surrogate may be nearly certain that an event which a run has met has no surroundings. The pools then have
no points there, and no batch of the estimate shows the error. The *centres* of the pool, which are important
points, show how much of the estimate belongs to the part of an event. Two points belong to the same part if
the ball of which they are opposite ends contains no other outcome (Gabriel), or by way of further events.

A ball is *open* if it contains an event of a small part, and no other outcome, and is so probable that the
estimate would be too low by a required share if the event happened in all of the ball.
"""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.spatial.distance import pdist
from scipy.special import chndtr

from fewruns.arrays import Array, Flags
from fewruns.constants import BLOCKS, CANDIDATES, MODES
from fewruns.two_phase import choose_covering


def open_balls(z: Array, happened: Flags, centres: Array, probability: float, share: float) -> Array:
    """Return the open ones of `MODES` random balls for an estimate: centres and radii, shape (k, d + 1).

    Parts with at least ``share`` of the estimate are not examined, because its batches show their size.
    """
    dimension, known = z.shape[1], shares_of_parts(z, happened, centres)
    small = np.flatnonzero(known < share)
    small = np.resize(small, MODES if len(small) else 0)
    generator = np.random.Generator(np.random.PCG64(dimension))
    event, radius = z[happened][small], generator.random(len(small))
    radius *= np.linalg.norm(event, axis=1)
    balls = np.column_stack([_draw_in(np.column_stack([event, radius]), generator), radius])
    chance = chndtr(radius**2, dimension, (balls[:, :-1] ** 2).sum(axis=1))
    balls = balls[chance >= probability * (share + known[small])]
    return balls[cKDTree(z[~happened]).query(balls[:, :-1])[0] > balls[:, -1]]


def draw_in_balls_together(n: int, balls: Array, generator: np.random.Generator) -> Array:
    """Return n points, shape (n, d), that are in as many of k balls as possible."""
    points = _draw_in(balls[generator.integers(len(balls), size=CANDIDATES)], generator)
    inside = np.linalg.norm(points[:, None] - balls[:, :-1], axis=2) <= balls[:, -1]
    return points[choose_covering(inside, n)]


def shares_of_parts(z: Array, happened: Flags, centres: Array) -> Array:
    """Return the share of the centres that belong to the part of each of k events, shape (k,)."""
    points, others = np.vstack([centres, z[happened]]), cKDTree(z[~happened])
    distance, (i, j) = pdist(points), np.triu_indices(len(points), 1)
    part = np.arange(len(points))
    # The nearest pairs come first, and link most points, so that few of the other pairs must be examined.
    for pairs in np.array_split(np.argsort(distance), BLOCKS):
        pairs = pairs[part[i[pairs]] != part[j[pairs]]]
        middle = (points[i[pairs]] + points[j[pairs]]) / 2
        pairs = pairs[others.query(middle)[0] >= distance[pairs] / 2]
        links = coo_array((np.ones(len(pairs)), (part[i[pairs]], part[j[pairs]])), (len(points), len(points)))
        part = connected_components(links, directed=False)[1][part]
    share = np.bincount(part[: len(centres)], minlength=len(points)) / max(len(centres), 1)
    return share[part[len(centres) :]]


def _draw_in(balls: Array, generator: np.random.Generator) -> Array:
    """Return a uniform draw in each of k balls, shape (k, d)."""
    centre, radius = balls[:, :-1], balls[:, -1]
    step = generator.normal(size=centre.shape)
    length = radius * generator.random(len(radius)) ** (1 / centre.shape[1])
    return centre + step * (length / np.linalg.norm(step, axis=1))[:, None]
