"""The search for the event: runs at all rarities, where a regression of the scores predicts the event."""

from dataclasses import dataclass

import numpy as np

from fewruns.arrays import Array, Flags, Generator
from fewruns.constants import BEYOND, CANDIDATES, IN_VAIN, PATIENCE, REACH, SEARCHED
from fewruns.gaussian_process import EventSurrogate
from fewruns.graded import GradedSurrogate, end_of_events, graded
from fewruns.pools import Space
from fewruns.progress import PLAIN, SEARCH, WIDE, PlainBatch, Progress
from fewruns.wide_laws import draw_at, draw_wide, rarity


@dataclass(frozen=True)
class Search:
    """The search of a sampler."""

    progress: Progress
    space: Space  # the space of the coordinates in which the search takes place
    step: float  # the search ends with one run in every step of rarity of this size

    @property
    def goes_on(self) -> bool:
        """Whether the search continues: it needs an event and one run in every step of rarity."""
        progress = self.progress
        pending = [each.batch for each in progress.asked if getattr(each.batch, "phase", None) == SEARCH]
        searched = progress.searched + sum(len(batch.z) for batch in pending) / self.reach
        return not progress.happened.any() or (not progress.estimates and searched < 1 / self.step)

    @property
    def reach(self) -> float:
        """Rarity up to which the search extends: that of the most probable known event plus `BEYOND`."""
        return min(self.progress.rarest + BEYOND, REACH)

    def batch(self, most: int, generator: Generator) -> PlainBatch:
        """Choose up to ``most`` runs for the next batch; in a search in vain, some are draws of the law."""
        progress, n, turn = self.progress, min(most, SEARCHED), self._turn(self.progress.searched)
        in_vain = not progress.happened.any() and progress.searched >= PATIENCE
        if turn == 1:
            return PlainBatch(generator.standard_normal((n, progress.z.shape[1])), PLAIN)
        known = self.space.coordinates(progress.z), progress.happened, progress.score
        z = draw_approach(n, self.reach, *known, generator, in_vain=in_vain, in_bulk=turn == 2)
        return PlainBatch(self.space.draw(z, generator), SEARCH)

    def unguided_batch(self, n: int, reach: float, generator: Generator) -> PlainBatch:
        """Draw n runs while all outcomes are equal: wide draws up to a rarity, or draws of the law."""
        dimension = self.progress.z.shape[1]
        if self._turn(len(self.progress.z) / REACH) == 1:
            return PlainBatch(generator.standard_normal((n, dimension)), PLAIN)
        return PlainBatch(draw_wide(n, dimension, generator, reach), WIDE)

    def _turn(self, spent: float) -> int:
        """Return 0, 1 and 2 in turn if the search is in vain after many runs per unit of rarity; otherwise 0.

        In turn 1, the batch is drawn from the law. Such draws find events in the bulk of the law, where
        the search has few runs, and bound their probability.
        """
        in_vain = not self.progress.happened.any() and spent >= IN_VAIN
        return len(self.progress.sizes) % 3 if in_vain else 0


def target_outcome(rarity: Array, outcome: Array, happened: Flags, at: Array) -> Array:
    """Return the value below which the outcome of a new run should be, at m rarities ``at``, shape (m,)."""
    if happened.any():
        return np.full(len(at), end_of_events(outcome, happened))
    order = np.argsort(rarity)
    smallest = np.minimum.accumulate(outcome[order])
    return smallest[np.maximum(np.searchsorted(rarity[order], at) - 1, 0)]


def draw_approach(
    runs: int,
    rarest: float,
    z: Array,
    happened: Flags,
    score: Array,
    generator: Generator,
    *,
    in_vain: bool = False,
    in_bulk: bool = False,
) -> Array:
    """Draw the n points of a batch of the search: one in each step of rarity up to ``rarest``, (n, d).

    The steps become narrower as the rarity increases, because runs far out can find all parts of the event,
    but runs near the origin only the nearest ones. If the search was ``in_vain`` for long, scores may be
    misleading, and half of the runs follow a surrogate of the flags instead. With ``in_bulk``, the steps of
    rarity are equally probable under the law.
    """
    each = max(CANDIDATES // runs, 2)
    steps = np.repeat(np.arange(runs), each) + generator.random(runs * each)
    # The square root makes the density of the runs grow like the rarity.
    at = -np.log1p(-steps / runs) if in_bulk else np.sqrt(steps / runs) * rarest
    candidates = draw_at(at, z.shape[1], generator)
    outcome = graded(happened, score)
    surrogate = GradedSurrogate(z.shape[1])
    surrogate.fit(z, outcome, learn=True)
    chance = surrogate.probability(candidates, target_outcome(rarity(z), outcome, happened, at))
    if in_vain:
        flags = EventSurrogate(z.shape[1])
        flags.fit(z, happened, learn=False)
        by_flags = np.repeat(generator.random(runs) < 0.5, each)
        chance[by_flags] = flags.probability(candidates[by_flags])
    share = chance.reshape(runs, each) ** 2
    marks = np.cumsum(share, axis=1)
    chosen = (marks < generator.random((runs, 1)) * marks[:, -1:]).sum(1)
    return candidates.reshape(runs, each, -1)[np.arange(runs), chosen]
