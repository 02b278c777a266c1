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
    EVEN,
    FRINGE_WEIGHT,
    KERNELS,
    NEAREST,
    NEIGHBOURS,
    POOL,
    REACH,
    RELEARN,
    SEARCH,
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
    is_surprising,
    inclusion_probabilities,
    predict,
)
from accelerated_evaluation.methods.surrogate.wide_laws import (
    KernelMixture,
    draw_directions,
    draw_wide,
    log_normal_to_wide,
    rarity,
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
            progress.wide_runs += batch.wide_runs
            progress.estimates.append(estimate_batch(batch, happened))
            progress.counts = progress.counts and progress.estimates[-1].is_usable
            if is_surprising(batch, happened): 
                progress.predicted = 0.0
        else:
            nearest = rarity(batch.z[happened]).min(initial=REACH)
            if isinstance(batch, ApproachBatch):
                progress.searched = 0 if nearest < progress.nearest else progress.searched + len(batch.z)
            progress.nearest = min(nearest, progress.nearest)

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
        searching = not progress.happened.any() or (not progress.estimates and progress.searched < SEARCH)
        sought = progress.happened | self._is_near() if searching else progress.happened
        if self.simulations < START or not sought.any():
            return WideBatch(draw_wide(self.batch_size, self.dimension, self._generator))
        restart = searching or not progress.estimates
        learn = restart or self.simulations >= RELEARN * progress.learnt_at
        if learn:
            progress.learnt_at = self.simulations
        self._surrogate.fit(progress.z, sought, learn=learn, restart=restart)
        return ApproachBatch(self._approach()) if searching else self._two_phase_batch()

    def _is_near(self) -> Flags:
        """Return which runs came nearer to the event than most others of about the same rarity, shape (n,)."""
        order = np.argsort(rarity(self.progress.z))
        score = self.progress.score[order]
        near = np.zeros(len(order), bool)
        n, window = len(order), min(NEIGHBOURS, len(order))
        for i in range(n):
            first = min(max(i - window // 2, 0), n - window)
            near[order[i]] = (score[first : first + window] <= score[i]).sum() <= NEAREST * window
        return near

    def _approach(self) -> Array:
        """Return points where the event is expected, one in each of equal steps of rarity, shape (n, d)."""
        n = self.batch_size
        each = max(POOL // 2 // n, 10)
        steps = np.repeat(np.arange(n), each) + self._generator.random(n * each)
        z = draw_directions(steps / n * self.progress.nearest, self.dimension, self._generator)
        share = self._surrogate.probability(z).reshape(n, each) ** 2
        # The largest of share^(1/E) ... : a draw with probabilities in proportion to the share
        pick = np.argmax(np.log(self._generator.random(share.shape)) / share, axis=1)
        return z.reshape(n, each, -1)[np.arange(n), pick]

    def _pool(self, size: int) -> tuple[Array, Array, Array]:
        """Return points of the first phase, shape (m, d), their weights phi / h, and the surrogate there."""
        if self.progress.centres is None:
            z = draw_wide(size, self.dimension, self._generator)
            log_weight = log_normal_to_wide(z)
        else:
            law = KernelMixture.about(self.progress.centres, WIDE_SHARE)
            z = law.draw(size, self._generator)
            log_weight = law.log_normal_ratio(z)
        guard = EVEN + (1 - EVEN) * np.exp(log_weight - log_normal_to_wide(z))
        return z, np.exp(log_weight), self._surrogate.probability(z), guard

    def _look_ahead(self) -> tuple[Prediction, float]:
        """Return what the next batch will be worth, and the largest weight of a point of the fringe.

        Also moves the centres of the next pool to where w sqrt(p) is large. All this comes from a pool of its
        own: nothing of the batch's own pool may decide where that is drawn or how much the batch counts.
        """
        fringe_limit = 0.0
        # The first pool of all is drawn from the wide law and finds few points that matter; a second one,
        # drawn about these, finds more.
        for _ in range(1 if self.progress.centres is not None else 2):
            z, w, p, guard = self._pool(POOL // 2)
            core = np.where(p >= CORE, p, 0.0)
            if not core.any():
                break
            fringe_limit = FRINGE_WEIGHT * (w @ (w * core)) / (w * core).sum()
            share = w * np.sqrt(core)
            self.progress.centres = z[self._generator.choice(len(z), KERNELS, p=share / share.sum())]
        return predict(w, expect(w, p, fringe_limit), guard, self.batch_size, POOL), fringe_limit

    def _two_phase_batch(self) -> TwoPhaseBatch:
        """Choose runs from a pool, as the module says in steps 2 and 3."""
        prediction, fringe_limit = self._look_ahead()
        progress, before = self.progress, self.progress.predicted
        agrees = before > 0 and 1 / AGREEMENT < prediction.probability / before < AGREEMENT
        progress.counts = agrees and (progress.counts or prediction.variation < USABLE**2)
        if not progress.counts:
            progress.predicted = prediction.probability
        z, w, p, guard = self._pool(POOL)
        expected = expect(w, p, fringe_limit)
        inclusion = inclusion_probabilities(w * expected.spread, guard, self.batch_size)
        share = (guard - EVEN) / guard.sum()
        wide_runs = float((inclusion[share > 0] / share[share > 0]).min() * (1 - EVEN))
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
            is_usable=progress.counts,
            wide_runs=wide_runs,
            aimed=expected.probability[chosen] > 0,
            predicted=prediction.probability,
        )
