"""Pools: large samples of points that need no simulation, from which the runs of a batch are chosen.

The points of a pool are drawn around the important points of the previous pool, and in part from the wide
distribution (`wide_laws.draw_wide`). With few normal scores, they are drawn in the space of these scores.
With many normal scores, they are drawn in the space of a few coordinates, with random components across them.
A part of such a pool is drawn from the wide distribution of all normal scores, because the event may depend
on directions that were not learnt.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fewruns.arrays import Array
from fewruns.constants import (
    ALONG,
    DEFENCE,
    EVEN,
    REACH,
    WHOLE_SHARE,
    WIDE_SHARE,
)
from fewruns.subspace import Space, Subspace
from fewruns.wide_laws import (
    KernelMixture,
    WideLaw,
    draw_wide,
    log_normal_to_wide,
    rarity,
)


@dataclass(frozen=True)
class Pool:
    """The m points of a pool, drawn from a density h; arrays of shape (m,).

    Attributes
    ----------
    z
        The points, shape (m, d).
    weight
        Importance weights phi / h, where phi is the standard normal density.
    probability
        Predicted probability of the event.
    wide
        Density of the wide distribution divided by h.
    rarity
        -log P(|Z| > |z|) for a standard normal Z.
    """

    z: Array
    weight: Array
    probability: Array
    wide: Array
    rarity: Array

    def within(self, begin: float, end: float) -> Array:
        """Return the density of the wide distribution truncated to given rarities, divided by h, shape (m,).

        The truncated distribution is uniform in rarity from ``begin`` to ``end``.
        """
        there = (begin < self.rarity) & (self.rarity <= end)
        return np.where(there, self.wide * REACH / (end - begin), 0.0)

    def guard(self, reach: float, defence: "Defence") -> Array:
        """Return the probability of each point of the pool under the choice of defensive runs, shape (m,).

        A share `EVEN` of the runs is spread evenly over the points. The other runs follow the wide
        distribution up to the rarity ``reach``. Points with weight 0 get none of the evenly spread runs,
        because they may not correspond to any encounter. If ``defence.beyond`` is between 0 and ``reach``,
        the evenly spread runs are only the share `EVEN` of the default share `DEFENCE`, and all other
        defensive runs follow the wide distribution beyond this rarity.

        Parameters
        ----------
        reach
            Rarity beyond which the event has almost no probability.
        defence
            Share and smallest rarity of the defensive runs.
        """
        evenly = np.where(self.weight > 0, EVEN, 0.0)
        if not 0 < defence.beyond < reach:
            return evenly + (1 - EVEN) * self.within(0.0, reach)
        return DEFENCE * evenly + (defence.share - EVEN * DEFENCE) * self.within(defence.beyond, reach)


@dataclass(frozen=True)
class Defence:
    """The defensive runs of a batch, which are chosen independently of the surrogate.

    Attributes
    ----------
    share
        Share of the defensive runs among the runs of the batch.
    beyond
        Rarity beyond which the defensive runs search for an unobserved part of the event that must be
        excluded; 0 if there is none.
    """

    share: float = DEFENCE
    beyond: float = 0.0

    def zones(self, reach: float) -> list[tuple[float, float]]:
        """Return the intervals of rarity, up to ``reach``, with uniform density of the defensive runs."""
        return [(0.0, self.beyond), (self.beyond, reach)] if 0 < self.beyond < reach else [(0.0, reach)]


@dataclass(frozen=True)
class SubspacePool(Pool):
    """A pool for many normal scores, with defensive runs along the coordinates as well as across them.

    Attributes
    ----------
    along
        The same points in the space of the coordinates, with the wide distribution of the coordinates.
    """

    along: Pool

    def guard(self, reach: float, defence: Defence) -> Array:
        """Return the probability of each point of the pool under the choice of defensive runs, shape (m,).

        A share `ALONG` of the default defensive runs follows the wide distribution of the few coordinates on
        which the event depends. The others are distributed as in `Pool.guard`. ``reach`` is the rarity
        beyond which the event has almost no probability, and ``defence`` the share of the defensive runs.
        """
        share, mean = ALONG * DEFENCE / defence.share, defence.share if 0 < defence.beyond < reach else 1.0
        return (1 - share) * super().guard(reach, defence) + share * mean * self.along.within(0.0, reach)


def draw_pool(
    space: Space,
    centres: Array | None,
    size: int,
    believed: Callable[[Array], Array],
    generator: np.random.Generator,
) -> Pool:
    """Return a pool of randomly drawn points, with their weights and predicted probabilities.

    The points are drawn from kernels around the centres, with the share `WIDE_SHARE` from the wide
    distribution. If there are no centres, all points are drawn from the wide distribution.

    Parameters
    ----------
    space
        The coordinates on which the event depends.
    centres
        Centres of the kernels, shape (k, d); None if there are none yet.
    size
        Number m of points.
    believed
        Function that returns the predicted probability of the event at points of shape (m, d), shape (m,).
    generator
        Source of all randomness.
    """
    law = WideLaw(space.dimension)
    if centres is not None:
        law = KernelMixture.about(space.coordinates(centres), WIDE_SHARE)
    if isinstance(space, Subspace):
        return _draw_in_subspace(space, law, size, believed, generator)
    z = law.draw(size, generator)
    log_weight = law.log_normal_ratio(z)
    wide = np.exp(log_weight - log_normal_to_wide(z))
    return Pool(z, np.exp(log_weight), believed(z), wide, rarity(z))


def _draw_in_subspace(
    space: Subspace,
    law: WideLaw | KernelMixture,
    size: int,
    believed: Callable[[Array], Array],
    generator: np.random.Generator,
) -> SubspacePool:
    whole = int(WHOLE_SHARE * size)
    share = whole / size
    z = draw_wide(whole, len(space.axes), generator)
    coordinates = law.draw(size - whole, generator)
    z = np.vstack([z, space.draw(coordinates, generator)])
    coordinates = np.vstack([space.coordinates(z[:whole]), coordinates])
    by_whole, by_law = log_normal_to_wide(z), law.log_normal_ratio(coordinates)
    log_weight = -np.logaddexp(math.log(share) - by_whole, math.log1p(-share) - by_law)
    weight, probability = np.exp(log_weight), believed(z)
    wide, wide_along = (np.exp(log_weight - by) for by in (by_whole, log_normal_to_wide(coordinates)))
    along = Pool(coordinates, weight, probability, wide_along, rarity(coordinates))
    return SubspacePool(z, weight, probability, wide, rarity(z), along)
