"""Where other parts of the event may be: around known events, and at minima of the scores.

A surrogate may be nearly certain that an event which a run has met has no surroundings. The pools then have
no points there, and no batch of the estimate shows the error. The *centres* of the pool, which are important
points, show how much of the estimate belongs to the part of an event. Two points belong to the same part if
the ball of which they are opposite ends contains no other outcome (Gabriel), or by way of further events.

A ball is *open* if it contains an event of a small part, and no other outcome, and is so probable that the
estimate would be too low by a required share if the event happened in all of the ball.
"""

import math
from collections.abc import Callable
from functools import partial

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.spatial.distance import pdist
from scipy.special import chdtri, chndtr

from fewruns.arrays import Array, Flags, Indices
from fewruns.constants import (
    BASIN_CLOSED,
    BLOCKS,
    CANDIDATES,
    CENTRE_NEAR,
    DESCENT_LENGTHS,
    DESCENTS,
    DOUBT,
    FINE_NOISE,
    FLAT,
    GRADED_RUNS,
    MINIMUM_CLOSED,
    MODES,
    NOISE,
    POINTS_OF_WAY,
    PROBES,
    PROPOSALS,
    REACH,
    SURROUNDED,
    WAYS,
)
from fewruns.graded import GradedSurrogate, end_of_events, graded, say_more
from fewruns.two_phase import choose_covering
from fewruns.wide_laws import draw_wide, rarity


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
    """Return up to n points, shape (m, d), near the basins in turn, where a regression predicts small scores.

    They are not beyond the rarity ``reach``. They are at most as far from the run in the basin as its nearest
    run, or at most 2 `BASIN_CLOSED`, so that a step down a slope ends in the open. They are `BASIN_CLOSED`
    apart, because points at the same place would close the basin of each other without having shown that the
    scores become larger beyond them.
    """
    outcome, d = graded(happened, score), z.shape[1]
    surrogate = GradedSurrogate(d)
    surrogate.fit(z, outcome, learn=True)
    n = min(n, PROBES * len(basins))
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
        points = np.vstack([points, near[surrogate.mean(near).argmin()]])
    return points


def _distances(z: Array) -> Array:
    """Return the distances between n runs, shape (n, n), with infinity on the diagonal."""
    square = (z * z).sum(axis=1)
    distance = np.sqrt(np.maximum(square[:, None] + square - 2 * z @ z.T, 0.0))
    np.fill_diagonal(distance, np.inf)
    return distance


def open_minima(
    n: int, z: Array, happened: Flags, score: Array, centres: Array, reach: float, begins: float = REACH
) -> Array:
    """Return up to n points at minima of a regression of the scores, (m, d); none if all minima are known.

    A minimum is known if a run or a centre is near it, or if the regression does not rise on the straight way
    from it to one of the nearest centres. Points and runs beyond the rarity ``reach`` are left out. With more
    than `SURROUNDED` inputs, the minima of the mean less `DOUBT` standard deviations must also be known, if
    an event is possible there and if they are within the rarity ``begins``, where every part that matters
    has points. No two points are at the same place, because they would not show that the scores rise around
    them.
    """
    inside, d = rarity(z) <= reach, z.shape[1]
    z, happened, score = z[inside], happened[inside], score[inside]
    found = np.empty((0, d))
    if not len(centres) or not happened.any() or not say_more(happened, score):
        return found
    outcome, generator = graded(happened, score), np.random.Generator(np.random.PCG64(len(z)))
    surrogate, kept = GradedSurrogate(d, FINE_NOISE if d > SURROUNDED else NOISE), _spread(z, happened)
    surrogate.fit(z[kept], outcome[kept], learn=True)
    near, level = MINIMUM_CLOSED * math.sqrt(d), end_of_events(outcome, happened)
    # With many inputs there may be no run in a large part of the space, and no minimum shows an event there.
    searches = [(0.0, reach), (DOUBT, min(begins, reach))]
    for doubt, rarest in searches if d > SURROUNDED else searches[:1]:
        start, farthest = draw_wide(DESCENTS, d, generator, rarest), math.sqrt(chdtri(d, math.exp(-rarest)))
        bound = partial(_lower, surrogate, doubt)
        points, value = _descend(bound, start, farthest, generator)
        is_new = (cKDTree(z).query(points)[0] > near) & (cKDTree(centres).query(points)[0] > CENTRE_NEAR)
        is_new &= (value < level) | (doubt == 0)
        order = np.argsort(value)
        points, value = points[order[is_new[order]]], value[order[is_new[order]]]
        while len(points) and len(found) < n:  # the lowest first, and then only those apart from it
            if _rise(bound, points[0], centres) > max(level - value[0], 0.0) + FLAT:
                found = np.vstack([found, points[0]])
            apart = np.linalg.norm(points - points[0], axis=1) > 2 * near
            points, value = points[apart], value[apart]
        if len(found):
            break
    # A few further points are around the minima.
    n = min(n, PROBES * len(found))
    around = generator.normal(size=(n, d)) * near / math.sqrt(d)
    around[: len(found)] = 0.0
    return np.resize(found, (n, d)) + around if len(found) else found


def _spread(z: Array, happened: Flags) -> Indices:
    """Return at most `GRADED_RUNS` runs, few of them events, which say nothing about distant minima."""
    events, others = np.flatnonzero(happened), np.flatnonzero(~happened)
    few = events[_apart(z[events], max(GRADED_RUNS // 4, GRADED_RUNS - len(others)))]
    return np.sort(np.append(few, others[_apart(z[others], GRADED_RUNS - len(few))]))


def _apart(z: Array, most: int) -> Indices:
    """Return at most ``most`` of n points, shape (n, d), each as far as possible from those before it."""
    chosen, distance = [0], np.full(len(z), np.inf)
    while len(chosen) < min(most, len(z)):
        distance = np.minimum(distance, np.linalg.norm(z - z[chosen[-1]], axis=1))
        distance[chosen[-1]] = -1.0  # points at the same place are chosen last, and none of them twice
        chosen.append(int(distance.argmax()))
    return np.array(chosen)


def _lower(surrogate: GradedSurrogate, doubt: float, z: Array) -> Array:
    """Return the mean of a regression less ``doubt`` standard deviations at z, shape (m, d)."""
    if not doubt:
        return surrogate.mean(z)
    mean, deviation = surrogate.expect(z)
    return mean - doubt * deviation


def _descend(
    bound: Callable[[Array], Array], z: Array, farthest: float, generator: np.random.Generator
) -> tuple[Array, Array]:
    """Return where random steps end that lower a function of points, (m, d), and its values there, (m,).

    The points stay within the distance ``farthest`` of the origin.
    """
    (m, d), value = z.shape, bound(z)
    for length in DESCENT_LENGTHS:
        step = length * generator.normal(size=(m, PROPOSALS, d)) / math.sqrt(d)
        tried = z[:, None] + step
        tried *= np.minimum(farthest / np.linalg.norm(tried, axis=2, keepdims=True), 1.0)
        values = bound(tried.reshape(-1, d)).reshape(m, PROPOSALS)
        best = np.arange(m), values.argmin(axis=1)
        z = np.where((values[best] < value)[:, None], tried[best], z)
        value = np.minimum(value, values[best])
    return z, value


def _rise(bound: Callable[[Array], Array], point: Array, centres: Array) -> float:
    """Return by how much a function of points rises at least on the way from a point to near centres."""
    nearest = np.argsort(np.linalg.norm(centres - point, axis=1))[:WAYS]
    steps = np.linspace(0, 1, POINTS_OF_WAY + 2)[:-1]
    ways = point + steps[:, None] * (centres[nearest] - point)[:, None]
    values = bound(ways.reshape(-1, len(point))).reshape(len(nearest), -1)
    return float((values.max(axis=1) - values[:, 0]).min())
