"""Pools: large samples of points that need no simulation, from which the runs of a batch are chosen.

With many normal scores, they are drawn in the space of a few coordinates, with random components across them,
and a part is drawn from the wide distribution of all normal scores, because the event may depend on
directions that were not learnt.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.special import chdtr, chdtrc, chdtri, gammaincinv, ndtr, ndtri_exp

from fewruns.arrays import Array, Function, Generator
from fewruns.constants import ALONG, DEFENCE, EVEN, LEAST_SINGULAR, REACH, WHOLE_SHARE
from fewruns.wide_laws import KernelMixture, draw_wide, log_normal_to_wide, rarity

OUTERMOST = 37.0  # largest normal score; tail probabilities beyond it underflow


@dataclass(frozen=True)
class WholeSpace:
    """The space of all normal scores, in which the coordinates of a point are its normal scores."""

    dimension: int

    def coordinates(self, z: Array) -> Array:
        """Return the coordinates in which points are searched: here the points z, (n, d), themselves."""
        return z

    def draw(self, coordinates: Array, generator: Generator) -> Array:
        """Return the points with given coordinates, shape (n, d), which are the coordinates themselves."""
        return coordinates


@dataclass(frozen=True)
class Subspace:
    """A subspace spanned by a few directions, with the distance from it as additional coordinate."""

    axes: Array  # orthonormal directions as columns, shape (d, k) with k < d

    @property
    def dimension(self) -> int:
        """Number of coordinates, k + 1."""
        return self.axes.shape[1] + 1

    @property
    def _across(self) -> int:
        return self.axes.shape[0] - self.axes.shape[1]

    def coordinates(self, z: Array) -> Array:
        """Return components of z along the k axes and score of the distance from them, (n, k + 1)."""
        along = z @ self.axes
        square = np.maximum((z * z).sum(1) - (along * along).sum(1), 0.0)
        return np.column_stack([along, outward(square, self._across)])

    def draw(self, coordinates: Array, generator: Generator) -> Array:
        """Draw points, shape (n, d), with given coordinates and uniform directions across the axes."""
        across = generator.normal(size=(len(coordinates), len(self.axes)))
        across -= (across @ self.axes) @ self.axes.T
        radius = np.sqrt(square_of_distance(coordinates[:, -1], self._across))
        across *= (radius / np.linalg.norm(across, axis=1))[:, None]
        return coordinates[:, :-1] @ self.axes.T + across


Space = WholeSpace | Subspace


def space_along(directions: Array | None, dimension: int) -> Space:
    """Return the space along directions, shape (d, k), or of all normal scores if they are None."""
    if directions is None:
        return WholeSpace(dimension)
    axes, length, _ = np.linalg.svd(directions, full_matrices=False)
    return Subspace(axes[:, length > LEAST_SINGULAR * length[0]])


def outward(square: Array, dimension: int) -> Array:
    """Return the normal scores of squared distances, from the smaller tail of the chi-squared law."""
    outer = square > 2 * gammaincinv(dimension / 2, 0.5)
    with np.errstate(divide="ignore"):  # where the smaller probability underflows
        smaller = np.log(np.where(outer, chdtrc(dimension, square), chdtr(dimension, square)))
    return np.where(outer, -1, 1) * np.maximum(ndtri_exp(smaller), -OUTERMOST)


def square_of_distance(score: Array, dimension: int) -> Array:
    """Return the squared distances whose normal scores are given, shape (n,); the inverse of `outward`."""
    smaller = ndtr(-np.minimum(np.abs(score), OUTERMOST))
    return np.where(score > 0, chdtri(dimension, smaller), 2 * gammaincinv(dimension / 2, smaller))


@dataclass(frozen=True)
class Pool:
    """The m points of a pool, drawn from a density h; arrays of shape (m,)."""

    z: Array  # the points, shape (m, d)
    weight: Array  # importance weights phi / h, where phi is the standard normal density
    probability: Array  # predicted probability of the event
    wide: Array  # density of the wide distribution divided by h
    rarity: Array  # -log P(|Z| > |z|) for a standard normal Z

    def within(self, begin: float, end: float) -> Array:
        """Return the density of the wide distribution between two rarities, divided by h, shape (m,)."""
        there = (begin < self.rarity) & (self.rarity <= end)
        return np.where(there, self.wide * REACH / (end - begin), 0.0)

    def guard(self, reach: float, defence: "Defence") -> Array:
        """Return the probability of each point under the choice of defensive runs, shape (m,).

        Points with weight 0 get none of the evenly spread runs, because they may not correspond to any input.
        """
        evenly = np.where(self.weight > 0, EVEN, 0.0)
        if not 0 < defence.beyond < reach:
            return evenly + (1 - EVEN) * self.within(0.0, reach)
        return DEFENCE * evenly + (defence.share - EVEN * DEFENCE) * self.within(defence.beyond, reach)


@dataclass(frozen=True)
class Defence:
    """The defensive runs of a batch, which are chosen independently of the surrogate."""

    share: float = DEFENCE  # share of the defensive runs among the runs of the batch
    # Rarity beyond which the defensive runs search for an unobserved part of the event that must be excluded;
    # 0 if there is none.
    beyond: float = 0.0

    def zones(self, reach: float) -> list[tuple[float, float]]:
        """Return the intervals of rarity, up to ``reach``, with uniform density of the defensive runs."""
        return [(0.0, self.beyond), (self.beyond, reach)] if 0 < self.beyond < reach else [(0.0, reach)]


@dataclass(frozen=True)
class SubspacePool(Pool):
    """A pool for many normal scores, with defensive runs along the coordinates as well as across them."""

    # The same points in the space of the coordinates, with the wide distribution of the coordinates.
    along: Pool

    def guard(self, reach: float, defence: Defence) -> Array:
        """Return what `Pool.guard` returns, with a share `ALONG` of the runs along the coordinates."""
        share, mean = ALONG * DEFENCE / defence.share, defence.share if 0 < defence.beyond < reach else 1.0
        return (1 - share) * super().guard(reach, defence) + share * mean * self.along.within(0.0, reach)


def draw_pool(
    space: Space, centres: Array | None, size: int, believed: Function, generator: Generator
) -> Pool:
    """Return a pool from kernels around centres, shape (k, d) or None, and the wide distribution.

    In a subspace, the share `WHOLE_SHARE` of the points is drawn from the wide distribution of all scores.
    """
    draw: Callable[..., Array] = partial(draw_wide, dimension=space.dimension)
    log_ratio: Function = log_normal_to_wide
    if centres is not None:
        law = KernelMixture.about(space.coordinates(centres), DEFENCE)
        draw, log_ratio = law.draw, law.log_normal_ratio
    if isinstance(space, WholeSpace):
        z = draw(size, generator=generator)
        log_weight = log_ratio(z)
        wide = np.exp(log_weight - log_normal_to_wide(z))
        return Pool(z, np.exp(log_weight), believed(z), wide, rarity(z))
    whole = int(WHOLE_SHARE * size)
    share = whole / size
    z = draw_wide(whole, len(space.axes), generator)
    coordinates = draw(size - whole, generator=generator)
    z = np.vstack([z, space.draw(coordinates, generator)])
    coordinates = np.vstack([space.coordinates(z[:whole]), coordinates])
    by_whole, by_law = log_normal_to_wide(z), log_ratio(coordinates)
    log_weight = -np.logaddexp(math.log(share) - by_whole, math.log1p(-share) - by_law)
    weight, probability = np.exp(log_weight), believed(z)
    wide, wide_along = (np.exp(log_weight - by) for by in (by_whole, log_normal_to_wide(coordinates)))
    along = Pool(coordinates, weight, probability, wide_along, rarity(coordinates))
    return SubspacePool(z, weight, probability, wide, rarity(z), along)
