"""Cross-fitting: better control variates for completed batches, from surrogates fitted to all other batches.

The estimate of a batch keeps its mean for any control variate that does not depend on the outcomes of the
batch. Each batch gets the predictions of a surrogate that was fitted without its group of batches
(Chernozhukov and others 2018). A small dependence remains, because later batches were designed with the
outcomes of earlier ones; the tests and the benchmark find no bias.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from threadpoolctl import threadpool_limits

from fewruns.arrays import Array
from fewruns.belief import Belief
from fewruns.sampler import Sampler
from fewruns.two_phase import TwoPhaseBatch

FOLDS = 5


@dataclass(frozen=True)
class Control:
    """A control variate of a batch: predicted probabilities of the event at the points of the batch."""

    runs: Array  # its values at the runs of the batch, shape (n,)
    # Its values at the m points of the pool that the batch has kept, divided by the control variate with
    # which the batch was drawn, shape (m,).
    kept: Array

    @classmethod
    def own(cls, batch: TwoPhaseBatch) -> "Control":
        """Return the control variate with which a batch was drawn."""
        return cls(batch.control, np.ones(len(batch.kept)))

    @classmethod
    def by(cls, belief: Belief, batch: TwoPhaseBatch) -> "Control":
        """Return the control variate that another surrogate predicts for a batch.

        It is 0 at runs where the batch had none, because its kept points then represent no such part.
        """
        if not len(batch.kept):
            return cls.own(batch)
        runs = np.where(batch.control > 0, belief.probability(batch.z), 0.0)
        return cls(runs, belief.probability(batch.kept) / batch.kept_control)


def cross_fitted(sampler: Sampler, stored: int) -> list[Control]:
    """Return control variates for the last ``stored`` batches, each from a surrogate fitted without it."""
    progress, sizes = sampler.progress, [len(batch.z) for batch in sampler.progress.batches]
    ends = len(progress.z) - sum(sizes) + np.cumsum([0, *sizes])
    runs = [np.arange(*part) for part in pairwise(ends)][-stored:]
    batches, controls = progress.batches[-stored:], []
    with threadpool_limits(1, "blas"):  # the matrices are small
        for fold in range(min(FOLDS, stored)):
            belief = sampler.belief.refitted(progress.without(np.concatenate(runs[fold::FOLDS])))
            controls.append([Control.by(belief, batch) for batch in batches[fold::FOLDS]])
    return [controls[place % FOLDS][place // FOLDS] for place in range(stored)]
