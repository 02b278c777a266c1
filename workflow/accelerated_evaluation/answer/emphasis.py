"""Where runs are wanted so that the probability is known equally well under every draw of the law.

Runs under the mean law are chosen so that the probability under the mean law has the smallest error. The
draws with the largest probabilities dominate the mean, and the draws with the smallest ones, which determine
the lower end of the interval, put their events where few runs are. The variance of the difference estimator
under draw k is a sum of w^2 r_k^2 e^2 / pi over the pool, with r_k = f_k / f_mean and the error e of the
surrogate. Divided by P_k^2 and averaged over the draws, it is smallest for inclusion probabilities pi in
proportion to w e times

    emphasis = sqrt(mean over k of (r_k / P_k)^2).
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.spatial import cKDTree

from accelerated_evaluation.answer.reweighting import SampledPosterior
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.smooth.mean import MeanLaw

POINTS = 150  # at which the emphasis is evaluated
DRAWS = 20  # that stand for all: the emphasis need not be exact


@dataclass(frozen=True)
class Emphasis:
    """Factor of the inclusion probabilities at normal scores.

    Attributes
    ----------
    law
        The law that is sampled.
    few
        The mean law of some of its draws, at equal steps of the rank of their probabilities.
    probabilities
        Probability of the event under each of them over the mean of all, shape (k,).
    """

    law: MeanLaw
    few: MeanLaw
    probabilities: Array

    @classmethod
    def of(cls, law: MeanLaw, posterior: SampledPosterior) -> Self:
        """Return the emphasis by what is known of the probabilities."""
        known = posterior.probabilities
        chosen = np.argsort(known)[((np.arange(DRAWS) + 0.5) / DRAWS * known.size).astype(int)]
        return cls(law, law.only_draws(chosen), known[chosen] / known.mean())

    def __call__(self, z: Array) -> Array:
        """Return the emphasis at normal scores, shape (n, 3); it is 1 where no cut-in has such scores.

        Of many points some are evaluated, and each of the others has the emphasis of the nearest of them.
        """
        if len(z) > POINTS:
            few = z[np.linspace(0, len(z) - 1, POINTS).astype(int)]
            return self(few)[cKDTree(few).query(z)[1]]
        with np.errstate(divide="ignore", invalid="ignore"):  # so far out that the range is 0 to rounding
            ratios = np.exp(self.few.log_ratios(self.few.from_normal_scores(z)))
            emphasis = np.sqrt(np.mean((ratios / self.probabilities[:, None]) ** 2, axis=0))
        return np.where(np.isfinite(emphasis), emphasis, 1.0)
