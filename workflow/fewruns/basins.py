"""Basins: places away from the known event at which the scores have a minimum, and may have an event nearby.

A cover excludes wide parts of the event. The scores also show parts that are too narrow for it: a run with a
smaller score than all runs around it may be next to such a part. It is followed until a later run near it is
not closer to the event. Earlier runs near it prove nothing, because they may all be on one side of it.
"""

import math

import numpy as np
from scipy.special import chdtri

from fewruns.arrays import Array, Flags, Indices
from fewruns.constants import BASIN_CLOSED, CANDIDATES
from fewruns.graded import GradedSurrogate, graded
from fewruns.wide_laws import rarity


def open_basins(z: Array, happened: Flags, score: Array, reach: float) -> Indices:
    """Return the runs that are local minima of the scores, and have no later run near them.

    A local minimum has a smaller score than its 2 d nearest runs, none of which is an event. If an event is
    within 2 `BASIN_CLOSED`, the scores lead to it. Runs beyond the rarity ``reach`` are left out, also as
    neighbours.
    """
    inside = np.flatnonzero(rarity(z) <= reach)
    z, happened, score, (n, d) = z[inside], happened[inside], score[inside], z[inside].shape
    if n <= 2 * d:
        return np.empty(0, np.intp)
    outcome, distance = graded(happened, score), _distances(z)
    nearest = np.argsort(distance, axis=1)[:, : 2 * d]
    is_lowest = (outcome[:, None] < outcome[nearest]).all(axis=1)
    is_last = ~np.triu(distance <= BASIN_CLOSED).any(axis=1)
    is_known = (distance[:, happened] <= 2 * BASIN_CLOSED).any(axis=1)
    return inside[is_lowest & is_last & ~is_known & ~happened]


def probe(
    n: int,
    basins: Indices,
    z: Array,
    happened: Flags,
    score: Array,
    reach: float,
    generator: np.random.Generator,
) -> Array:
    """Return n points, shape (n, d), near the basins in turn, where a regression predicts small scores.

    They are not beyond the rarity ``reach``. They are at most as far from the run in the basin as its nearest
    run, or at most 2 `BASIN_CLOSED`, so that a step down a slope ends in the open. They are `BASIN_CLOSED`
    apart, because points at the same place would close the basin of each other without having shown that the
    scores become larger beyond them.
    """
    outcome, d = graded(happened, score), z.shape[1]
    surrogate = GradedSurrogate(d)
    surrogate.fit(z, outcome, learn=True)
    length = np.maximum(_distances(z).min(axis=1), 2 * BASIN_CLOSED)
    points, farthest = np.empty((0, d)), math.sqrt(chdtri(d, math.exp(-reach)))
    for basin in np.resize(basins[np.argsort(outcome[basins])], n):
        step = generator.normal(size=(CANDIDATES // n, d))
        step *= length[basin] / np.linalg.norm(step, axis=1, keepdims=True)
        near = z[basin] + step * generator.random((len(step), 1)) ** (1 / d)
        near *= np.minimum(farthest / np.linalg.norm(near, axis=1, keepdims=True), 1.0)
        apart = np.linalg.norm(near[:, None] - points, axis=2).min(axis=1, initial=np.inf)
        apart = np.minimum(apart, BASIN_CLOSED)
        near = near[apart >= apart.max()]  # all of them, unless the basin is full of points
        points = np.vstack([points, near[surrogate.expect(near)[0].argmin()]])
    return points


def _distances(z: Array) -> Array:
    """Return the distances between n runs, shape (n, n), with infinity on the diagonal."""
    square = (z * z).sum(axis=1)
    distance = np.sqrt(np.maximum(square[:, None] + square - 2 * z @ z.T, 0.0))
    np.fill_diagonal(distance, np.inf)
    return distance
