"""The second phase of a sampler, in which each batch gives an estimate: the design of a batch."""

from dataclasses import dataclass

import numpy as np

from fewruns.arrays import Array, Function, Generator
from fewruns.belief import Belief
from fewruns.constants import CORE, FRINGE_WEIGHT, KERNELS, MOST_POOL, NOISY_FRINGE_WEIGHT, POOL, POOL_PER_RUN
from fewruns.pools import Defence, Pool, draw_pool
from fewruns.progress import Progress
from fewruns.two_phase import Prediction, TwoPhaseBatch, draw_batch, expect, predict
from fewruns.wide_laws import truncated


@dataclass(frozen=True)
class SecondPhase:
    """The second phase of a sampler, in which batches give estimates; see `sampler`."""

    belief: Belief  # the surrogates, fitted to all runs so far
    progress: Progress  # the runs so far
    runs: int  # number n of runs of the batch
    defence: Defence
    # Factor for the inclusion probabilities at points, as in `Sampler`.
    emphasis: Function | None
    generator: Generator

    def batch(self, cover: Array, known: Belief) -> tuple[TwoPhaseBatch, Array | None]:
        """Draw a pool, choose runs from it, and return them as a batch, with the centres of the pool.

        If there are runs ``cover``, shape (m, d), that exclude other parts of the event, they are the batch.
        An event is expected where the surrogates ``known`` predict that it is possible.
        """
        centres, prediction, fringe_limit = self._look_ahead()
        if len(cover):
            aimed = known.probability(cover) >= CORE
            return TwoPhaseBatch.of_cover(cover, aimed, prediction, self.belief.foresee(cover)), centres
        pool = self._pool(centres, self._pool_size)
        expected = expect(pool, fringe_limit, self.emphasis)
        given = self.runs, self.defence, self.belief.foresee
        return draw_batch(pool, expected, prediction, *given, self.generator), centres

    def _look_ahead(self) -> tuple[Array | None, Prediction, float]:
        """Return centres and prediction for the next batch, and the largest weight of the fringe.

        All of this is computed from a separate pool. The pool of the batch must not determine its own
        distribution or the weight of the batch, because the estimate would then be biased.
        """
        progress, centres, fringe_limit = self.progress, self.progress.centres, 0.0
        # The very first pool is drawn from the wide distribution and has few important points. A second pool,
        # drawn around these points, has more.
        for _ in range(1 if centres is not None else 2):
            pool = self._pool(centres, self._pool_size // 2)
            core = np.where(pool.probability >= CORE, pool.probability, 0.0)
            if not core.any():
                # The event is so small that no wide draw meets it; pools around its known points do.
                if progress.happened.any():
                    centres = progress.z[progress.happened]
                continue
            w = pool.weight
            fringe_limit = (w @ (w * core)) / (w * core).sum()
            fringe_limit *= NOISY_FRINGE_WEIGHT if self.progress.is_noisy else FRINGE_WEIGHT
            mattered = expect(pool, fringe_limit).probability if self.progress.is_noisy else core
            share = truncated(w * np.sqrt(mattered))
            centres = pool.z[self.generator.choice(len(w), KERNELS, p=share / share.sum())]
        expected = expect(pool, fringe_limit, self.emphasis)
        prediction = predict(pool, expected, self.runs, self._pool_size, self.defence)
        return centres, prediction, fringe_limit

    def _pool(self, centres: Array | None, size: int) -> Pool:
        """Draw a pool around centres, shape (k, d), with the surrogate's predicted probabilities."""
        return draw_pool(self.belief.space, centres, size, self.belief.probability, self.generator)

    @property
    def _pool_size(self) -> int:
        """Number of points of the pool of a batch."""
        return max(min(POOL * max(self.belief.space.dimension - 2, 1), MOST_POOL), POOL_PER_RUN * self.runs)
