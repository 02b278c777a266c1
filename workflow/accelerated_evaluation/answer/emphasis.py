"""A factor of the inclusion probabilities, so that the estimates are equally precise under all draws.

Without this factor, the runs are chosen such that the probability under the mean law has the smallest error.
The draws with the largest probabilities dominate this mean. The draws with the smallest probabilities, which
determine the lower end of the interval, have their events at places with few runs. The variance of the
difference estimator under draw k is a sum of w^2 r_k^2 e^2 / pi over the pool, with r_k = f_k / f_mean and
the error e of the surrogate. Divided by P_k^2 and averaged over the draws, it is smallest for inclusion
probabilities pi that are proportional to w e times

    emphasis = sqrt(mean over k of (r_k / P_k)^2).
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.spatial import cKDTree

from accelerated_evaluation.answer.reweighting import SampledPosterior
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.smooth.mean import MeanLaw

POINTS = 150  # largest number of points at which the emphasis is evaluated
DRAWS = 20  # number of draws that represent all draws, because the emphasis need not be exact


@dataclass(frozen=True)
class Emphasis:
    """Factor of the inclusion probabilities, as a function of the normal scores.

    Attributes
    ----------
    law
        The mean law that is sampled.
    few
        The mean of k of its draws, which are chosen at equal steps of the rank of their probabilities.
    probabilities
        Probability of the event under each of the k draws, divided by the mean over all draws, shape (k,).
    """

    law: MeanLaw
    few: MeanLaw
    probabilities: Array

    @classmethod
    def of(cls, law: MeanLaw, posterior: SampledPosterior) -> Self:
        """Return the factor of the inclusion probabilities that follows from preliminary estimates.

        Parameters
        ----------
        law
            The mean law that is sampled.
        posterior
            Estimates of the probability of the event under each draw of the law, from the runs so far.
        """
        known = posterior.probabilities
        chosen = np.argsort(known)[((np.arange(DRAWS) + 0.5) / DRAWS * known.size).astype(int)]
        return cls(law, law.subset(chosen), known[chosen] / known.mean())

    def __call__(self, z: Array) -> Array:
        """Return the emphasis at normal scores z, shape (n, 3); shape (n,).

        It is 1 at points that do not correspond to any cut-in. If there are more than `POINTS` points, it is
        evaluated at `POINTS` of them, and every other point gets the value of the nearest evaluated one.
        """
        if len(z) > POINTS:
            few = z[np.linspace(0, len(z) - 1, POINTS).astype(int)]
            return self(few)[cKDTree(few).query(z)[1]]
        with np.errstate(divide="ignore", invalid="ignore"):  # points so far out that the range underflows
            ratios = np.exp(self.few.log_ratios(self.few.from_normal_scores(z)))
            emphasis = np.sqrt(np.mean((ratios / self.probabilities[:, None]) ** 2, axis=0))
        return np.where(np.isfinite(emphasis), emphasis, 1.0)
