"""Surrogate-guided sampling: the probability of a rare event from a few hundred simulations.

The event is a set in the space of normal scores, z ~ N(0, I). Every batch takes the same three steps.

1. Surrogate. The flags of all runs so far give p(z), the probability that the event happens at z.
2. First phase, without simulations. A pool of points z_j ~ h has the weights w_j = phi(z_j) / h(z_j), where h
   follows the places that mattered under the last surrogate, and is in part a wide law.
3. Second phase. From the pool n runs are chosen, most of them where w_j times the error of the surrogate is
   large, and a defensive share anywhere. With p as control variate they give an estimate Y whose mean, given
   all earlier batches, is P(event); see `two_phase`.

The estimate is the mean of Y over the batches, weighted by what was predicted before each batch was drawn.
Until the first event is seen, the surrogate learns where the runs of smallest score are, and follows the wide
law in place of phi, because nothing tells in advance which variable is rare. Notebook 10 derives the method.
"""

from dataclasses import replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike
from threadpoolctl import ThreadpoolController

from accelerated_evaluation.distributions.protocol import Array
from accelerated_evaluation.methods.estimate import Estimate, Stopping
from accelerated_evaluation.methods.surrogate import results
from accelerated_evaluation.methods.surrogate.constants import (
    AGREEMENT,
    CORE,
    FRINGE_WEIGHT,
    KERNELS,
    NEAREST,
    POOL,
    RELEARN,
    START,
    USABLE,
    WIDE_SHARE,
)
from accelerated_evaluation.methods.surrogate.gaussian_process import EventSurrogate
from accelerated_evaluation.methods.surrogate.state import (
    ApproachBatch,
    Batch,
    Progress,
    State,
    WideBatch,
)
from accelerated_evaluation.methods.surrogate.two_phase import (
    Flags,
    Prediction,
    TwoPhaseBatch,
    draw_systematically,
    estimate_batch,
    expect,
    inclusion_probabilities,
    predict,
)
from accelerated_evaluation.methods.surrogate.wide_laws import (
    KernelMixture,
    draw_wide,
    log_normal_to_wide,
)

# The matrices are small, so that several threads do not pay, and bytes must not depend on the number of
# cores.
BLAS = ThreadpoolController()


class Sampler:
    """Asks for batches of simulations and is told how they ended; for vehicles that are run elsewhere.

    Parameters
    ----------
    dimension
        Number d of normal scores.
    generator
        Source of all randomness.
    batch_size
        Number n of simulations asked for at once, up to a quarter of the pool.
    fingerprint
        Text that identifies the problem, so that a saved state is not taken up for another one.
    """

    def __init__(
        self, dimension: int, generator: np.random.Generator, batch_size: int = 10, *, fingerprint: str
    ) -> None:
        if not 1 <= batch_size <= POOL // 4:
            raise ValueError(f"batch_size must be from 1 to {POOL // 4}, got {batch_size}")
        self.dimension, self.batch_size, self.fingerprint = dimension, batch_size, fingerprint
        self.progress = Progress.start(dimension)
        self._generator = generator
        self._surrogate = EventSurrogate(dimension)

    # ---- simulations

    def ask(self) -> Array:
        """Return the normal scores to simulate next, shape (n, d); the same until `tell`."""
        return self._pending_batch().z

    def tell(self, happened: ArrayLike, score: ArrayLike | None = None) -> None:
        """Take the outcomes of the batch that was asked for last.

        Parameters
        ----------
        happened
            Whether the event happened, shape (n,).
        score
            A number that falls as the event comes nearer, shape (n,); None where only the flag is known.

        Raises
        ------
        ValueError
            If a shape is wrong, or a score is not a number. The outcomes are not taken then.
        """
        batch, progress = self._pending_batch(), self.progress
        happened = np.asarray(happened, dtype=bool)
        score = np.zeros(len(batch.z)) if score is None else np.asarray(score, dtype=float)
        if happened.shape != (len(batch.z),) or score.shape != (len(batch.z),):
            raise ValueError(
                f"asked for {len(batch.z)} simulations, told of {happened.shape} and {score.shape}"
            )
        if np.isnan(score).any():
            raise ValueError("a score is not a number")
        largest = np.finfo(float).max  # JSON has no infinity
        progress.z = np.vstack([progress.z, batch.z])
        progress.happened = np.append(progress.happened, happened)
        progress.score = np.append(progress.score, np.clip(score, -largest, largest))
        progress.pending = None
        if isinstance(batch, WideBatch):
            progress.wide_runs += len(batch.z)
        if isinstance(batch, TwoPhaseBatch):
            progress.estimates.append(estimate_batch(batch, happened))

    @property
    def simulations(self) -> int:
        """Number of simulations whose outcomes were told."""
        return len(self.progress.z)

    def has_converged(self, stopping: Stopping) -> bool:
        """Whether the interval is as narrow as asked, and enough events were seen."""
        return results.has_converged(self.progress, stopping)

    def estimate(self, stopping: Stopping) -> Estimate:
        """Return what the runs so far say; see `results.estimate`."""
        return results.estimate(self.progress, self.batch_size, stopping)

    # ---- saved state

    def state(self) -> State:
        """Return everything that is needed to go on; `resume` takes it up.

        Later outcomes do not change it: the sampler appends to its list, which is copied here, and puts new
        arrays in place of its own.
        """
        return State(
            fingerprint=self.fingerprint,
            dimension=self.dimension,
            batch_size=self.batch_size,
            progress=replace(self.progress, estimates=[*self.progress.estimates]),
            theta=self._surrogate.theta,
            sites=self._surrogate.sites,
            generator=self._generator.bit_generator.state,
        )

    @classmethod
    def resume(cls, state: State) -> Self:
        """Return the sampler of a state; it goes on as if it had never stopped."""
        bits = getattr(np.random, state.generator["bit_generator"])()
        bits.state = state.generator
        sampler = cls(
            state.dimension, np.random.Generator(bits), state.batch_size, fingerprint=state.fingerprint
        )
        sampler.progress = state.progress
        sampler._surrogate.theta, sampler._surrogate.sites = state.theta, state.sites
        return sampler

    # ---- design of a batch

    def _pending_batch(self) -> Batch:
        if self.progress.pending is None:
            with BLAS.limit(limits=1):
                self.progress.pending = self._design()
        return self.progress.pending

    def _design(self) -> Batch:
        """Choose the next batch, by what is known so far."""
        progress = self.progress
        sought, level = self._sought()
        if sought.all():
            return WideBatch(draw_wide(self.batch_size, self.dimension, self._generator))
        is_other_event = level != progress.level or progress.learnt_at == 0
        progress.level = level
        learn = is_other_event or self.simulations >= RELEARN * progress.learnt_at
        if learn:
            progress.learnt_at = self.simulations
        self._surrogate.fit(progress.z, sought, learn=learn, restart=is_other_event)
        return ApproachBatch(self._approach()) if level is not None else self._two_phase_batch()

    def _sought(self) -> tuple[Flags, float | None]:
        """Return the flags that the surrogate learns, shape (n,), and the score at which they begin.

        They are the event's own flags, without a score, once an event was seen. Before, the runs of smallest
        score stand for the event. If all flags are the same, there is nothing to learn: in the beginning, and
        without an event where no score is known.
        """
        progress = self.progress
        if self.simulations < START:
            return np.ones(self.simulations, bool), None
        if progress.happened.any():
            return progress.happened, None
        level = float(np.sort(progress.score)[NEAREST - 1])
        return progress.score <= level, level

    def _approach(self) -> Array:
        """Return points of the wide law where runs of small score are expected, shape (n, d)."""
        z = draw_wide(POOL // 2, self.dimension, self._generator)
        share = self._surrogate.probability(z) ** 2
        return z[self._generator.choice(len(z), self.batch_size, replace=False, p=share / share.sum())]

    def _pool(self, size: int) -> tuple[Array, Array, Array]:
        """Return points of the first phase, shape (m, d), their weights phi / h, and the surrogate there."""
        if self.progress.centres is None:
            z = draw_wide(size, self.dimension, self._generator)
            log_weight = log_normal_to_wide(z)
        else:
            law = KernelMixture.about(self.progress.centres, WIDE_SHARE)
            z = law.draw(size, self._generator)
            log_weight = law.log_normal_ratio(z)
        return z, np.exp(log_weight), self._surrogate.probability(z)

    def _look_ahead(self) -> tuple[Prediction, float]:
        """Return what the next batch will be worth, and the largest weight of a point of the fringe.

        Also moves the centres of the next pool to where w sqrt(p) is large. All this comes from a pool of its
        own: nothing of the batch's own pool may decide where that is drawn or how much the batch counts.
        """
        fringe_limit = 0.0
        # The first pool of all is drawn from the wide law and finds few points that matter; a second one,
        # drawn about these, finds more.
        for _ in range(1 if self.progress.centres is not None else 2):
            z, w, p = self._pool(POOL // 2)
            core = np.where(p >= CORE, p, 0.0)
            if not core.any():
                break
            fringe_limit = FRINGE_WEIGHT * (w @ (w * core)) / (w * core).sum()
            share = w * np.sqrt(core)
            self.progress.centres = z[self._generator.choice(len(z), KERNELS, p=share / share.sum())]
        return predict(w, expect(w, p, fringe_limit), self.batch_size, POOL), fringe_limit

    def _two_phase_batch(self) -> TwoPhaseBatch:
        """Choose runs from a pool, as the module says in steps 2 and 3."""
        prediction, fringe_limit = self._look_ahead()
        before, self.progress.predicted = self.progress.predicted, prediction.probability
        agrees = before > 0 and 1 / AGREEMENT < prediction.probability / before < AGREEMENT
        z, w, p = self._pool(POOL)
        expected = expect(w, p, fringe_limit)
        inclusion = inclusion_probabilities(w * expected.spread, self.batch_size)
        chosen = draw_systematically(z, w * np.sqrt(expected.probability), inclusion, self._generator)
        w = w / POOL
        return TwoPhaseBatch(
            z=z[chosen],
            weight=w[chosen],
            control=expected.control[chosen],
            inclusion=inclusion[chosen],
            controlled=float(w @ expected.control),
            controlled_square=float(w * w @ expected.control),
            importance=self.batch_size / max(prediction.variation, USABLE**2),
            predicted_variation=prediction.variation / self.batch_size,
            is_usable=prediction.variation < USABLE**2 and agrees,
        )
