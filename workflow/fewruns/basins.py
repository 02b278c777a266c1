"""Basins: places away from the known event at which the scores have a minimum, and may have an event nearby.

A cover excludes wide parts of the event. The scores also show parts that are too narrow for it: a run with a
smaller score than all runs around it may be next to such a part. More runs near it then show whether it is.
"""

import numpy as np

from fewruns.arrays import Array, Flags, Indices
from fewruns.constants import BASIN_CLOSED, CANDIDATES, FEW
from fewruns.graded import GradedSurrogate, graded
from fewruns.wide_laws import rarity


def open_basins(z: Array, happened: Flags, score: Array, reach: float) -> Indices:
    """Return the runs that are local minima of the scores, and have no other run near them.

    A local minimum has a smaller score than its 2 d nearest runs, none of which is an event. Runs beyond the
    rarity ``reach`` are left out. With many inputs there are no neighbours, and so no basins.
    """
    n, d = z.shape
    if d > FEW or n <= 2 * d:
        return np.empty(0, np.intp)
    outcome, distance = graded(happened, score), _distances(z)
    nearest = np.argsort(distance, axis=1)[:, : 2 * d]
    is_lowest = (outcome[:, None] < outcome[nearest]).all(axis=1)
    is_alone = distance.min(axis=1) > BASIN_CLOSED
    return np.flatnonzero(is_lowest & is_alone & ~happened & (rarity(z) <= reach))


def probe(
    n: int, basins: Indices, z: Array, happened: Flags, score: Array, generator: np.random.Generator
) -> Array:
    """Return n points, shape (n, d), near the basins in turn, where a regression predicts small scores.

    They are at most as far from the run in the basin as its nearest run.
    """
    outcome, d = graded(happened, score), z.shape[1]
    surrogate = GradedSurrogate(d)
    surrogate.fit(z, outcome, learn=True)
    length = _distances(z).min(axis=1)
    points = []
    for basin in np.resize(basins[np.argsort(outcome[basins])], n):
        step = generator.normal(size=(CANDIDATES // n, d))
        step *= length[basin] / np.linalg.norm(step, axis=1, keepdims=True)
        near = z[basin] + step * generator.random((len(step), 1)) ** (1 / d)
        points.append(near[surrogate.expect(near)[0].argmin()])
    return np.array(points)


def _distances(z: Array) -> Array:
    """Return the distances between n runs, shape (n, n), with infinity on the diagonal."""
    square = (z * z).sum(axis=1)
    distance = np.sqrt(np.maximum(square[:, None] + square - 2 * z @ z.T, 0.0))
    np.fill_diagonal(distance, np.inf)
    return distance
