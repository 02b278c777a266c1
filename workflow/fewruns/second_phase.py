"""The design of a batch of the second phase: a prediction from one pool, and runs chosen from another."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fewruns.arrays import Array, Flags
from fewruns.belief import Belief
from fewruns.constants import (
    CORE,
    FRINGE,
    FRINGE_WEIGHT,
    KERNELS,
    NOISY_FRINGE,
    NOISY_FRINGE_WEIGHT,
    POOL,
    POOL_PER_RUN,
)
from fewruns.pools import Defence, Pool, draw_pool
from fewruns.progress import Progress
from fewruns.two_phase import Prediction, TwoPhaseBatch, draw_batch, expect, predict
from fewruns.wide_laws import truncated


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
        given = self.runs, self.defence, self.cover, self.aimed_cover, self.belief
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
                break
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
        return max(POOL, POOL_PER_RUN * self.runs)
