"""How a batch of the second phase is designed: a prediction from one pool, and runs chosen from another."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.methods.surrogate.belief import Belief
from accelerated_evaluation.methods.surrogate.constants import (
    CORE,
    FRINGE,
    FRINGE_WEIGHT,
    KERNELS,
    NOISY_FRINGE,
    NOISY_FRINGE_WEIGHT,
    POOL,
    POOL_PER_RUN,
)
from accelerated_evaluation.methods.surrogate.pools import Defence, Pool, draw_pool
from accelerated_evaluation.methods.surrogate.progress import Progress
from accelerated_evaluation.methods.surrogate.two_phase import (
    Prediction,
    TwoPhaseBatch,
    draw_batch,
    expect,
    predict,
)
from accelerated_evaluation.methods.surrogate.wide_laws import truncated


@dataclass(frozen=True)
class SecondPhase:
    """The second phase of a sampler, as its module describes it in steps 2 and 3.

    Attributes
    ----------
    belief
        The surrogates, fitted to all runs so far.
    progress
        The runs so far. `batch` moves the centres of its pools.
    runs
        Number n of runs of a batch.
    defence
        Defensive share of the runs.
    emphasis
        Factor of the inclusion probabilities at points, shape (n,); None if the probability under the sampled
        law alone is wanted.
    generator
        Source of all randomness.
    """

    belief: Belief
    progress: Progress
    runs: int
    defence: Defence
    emphasis: Callable[[Array], Array] | None
    generator: np.random.Generator

    def batch(self) -> TwoPhaseBatch:
        """Choose the runs of a batch from a pool."""
        prediction, fringe_limit = self._look_ahead()
        pool = self._pool(self._pool_size)
        expected = expect(pool, fringe_limit, self._fringe, self.emphasis)
        foresee = self.belief.foresee
        return draw_batch(pool, expected, prediction, self.runs, self.defence, foresee, self.generator)

    def _look_ahead(self) -> tuple[Prediction, float]:
        """Return what the next batch will be worth, and the largest weight of a point of the fringe.

        Also moves the centres of the next pool to where w sqrt(p) is large. All this comes from a pool of its
        own: nothing of the batch's own pool may decide where that is drawn or how much the batch counts.
        """
        progress, fringe_limit = self.progress, 0.0
        # The first pool of all is drawn from the wide law and finds few points that matter; a second one,
        # drawn about these, finds more.
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
        return predict(pool, expected, self.runs, self._pool_size, self.defence), fringe_limit

    def _pool(self, size: int) -> Pool:
        """Return points of the first phase with their weights, the surrogate there, and the defensive law."""
        belief = self.belief
        return draw_pool(belief.space, self.progress.centres, size, belief.probability, self.generator)

    @property
    def _fringe(self) -> float:
        """Least probability of the fringe."""
        return NOISY_FRINGE if self._is_noisy else FRINGE

    @property
    def _is_noisy(self) -> bool:
        """Whether an outcome is one draw of a probability in most runs."""
        return self.progress.repeats.vary_often

    @property
    def _pool_size(self) -> int:
        """Number of points of the pool of a batch."""
        return max(POOL, POOL_PER_RUN * self.runs)
