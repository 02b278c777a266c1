"""The design of a batch: the search for the event, and the second phase, with a pool for each purpose."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fewruns.arrays import Array, Flags
from fewruns.belief import Belief
from fewruns.constants import (
    CANDIDATES,
    CORE,
    FRINGE,
    FRINGE_WEIGHT,
    KERNELS,
    MOST_POOL,
    NOISY_FRINGE,
    NOISY_FRINGE_WEIGHT,
    POOL,
    POOL_PER_RUN,
)
from fewruns.gaussian_process import EventSurrogate
from fewruns.graded import GradedSurrogate, end_of_events, graded
from fewruns.pools import Defence, Pool, draw_pool
from fewruns.progress import Progress
from fewruns.two_phase import Prediction, TwoPhaseBatch, draw_batch, expect, predict
from fewruns.wide_laws import draw_at, rarity, truncated


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
    generator: np.random.Generator,
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


@dataclass(frozen=True)
class SecondPhase:
    """The second phase of a sampler, in which batches give estimates; see `sampler`."""

    belief: Belief  # the surrogates, fitted to all runs so far
    progress: Progress  # the runs so far; the method `batch` replaces its attribute ``centres``
    runs: int  # number n of runs of a batch that are sampled
    cover: Array  # runs of the batch that only exclude modes, shape (m, d); their weight is 0
    aimed_cover: Flags  # whether an event was known to be possible at these runs, shape (m,)
    defence: Defence
    # Factor for the inclusion probabilities at points, as in `Sampler`.
    emphasis: Callable[[Array], Array] | None
    generator: np.random.Generator

    def batch(self) -> TwoPhaseBatch:
        """Draw a pool, choose runs from it, and return them as a batch; ``progress.centres`` is replaced."""
        prediction, fringe_limit = self._look_ahead()
        pool = self._pool(self._pool_size)
        expected = expect(pool, fringe_limit, self._fringe, self.emphasis)
        given = self.runs, self.defence, self.cover, self.aimed_cover, self.belief.foresee
        return draw_batch(pool, expected, prediction, *given, self.generator)

    def _look_ahead(self) -> tuple[Prediction, float]:
        """Move the centres; return the prediction for the next batch, and the largest weight of the fringe.

        All of this is computed from a separate pool. The pool of the batch must not determine its own
        distribution or the weight of the batch, because the estimate would then be biased.
        """
        progress, fringe_limit = self.progress, 0.0
        # The very first pool is drawn from the wide distribution and has few important points. A second pool,
        # drawn around these points, has more.
        for _ in range(1 if progress.centres is not None else 2):
            pool = self._pool(self._pool_size // 2)
            core = np.where(pool.probability >= CORE, pool.probability, 0.0)
            if not core.any():
                # The event is so small that no wide draw meets it; pools around its known points do.
                if progress.happened.any():
                    progress.centres = progress.z[progress.happened]
                continue
            w = pool.weight
            fringe_limit = (w @ (w * core)) / (w * core).sum()
            fringe_limit *= NOISY_FRINGE_WEIGHT if self._is_noisy else FRINGE_WEIGHT
            mattered = expect(pool, fringe_limit, self._fringe).probability if self._is_noisy else core
            share = truncated(w * np.sqrt(mattered))
            progress.centres = pool.z[self.generator.choice(len(w), KERNELS, p=share / share.sum())]
        expected = expect(pool, fringe_limit, self._fringe, self.emphasis)
        return predict(pool, expected, max(self.runs, 1), self._pool_size, self.defence), fringe_limit

    def _pool(self, size: int) -> Pool:
        """Draw a pool with the surrogate's predicted probabilities."""
        belief = self.belief
        return draw_pool(belief.space, self.progress.centres, size, belief.probability, self.generator)

    @property
    def _fringe(self) -> float:
        """Smallest predicted probability of a point of the fringe."""
        return NOISY_FRINGE if self._is_noisy else FRINGE

    @property
    def _is_noisy(self) -> bool:
        """Whether the outcomes of most runs are random."""
        return self.progress.repeats.vary_often

    @property
    def _pool_size(self) -> int:
        """Number of points of the pool of a batch."""
        return max(min(POOL * max(self.belief.space.dimension - 2, 1), MOST_POOL), POOL_PER_RUN * self.runs)
