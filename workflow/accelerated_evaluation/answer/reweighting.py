"""The posterior of the probability of an event, from estimates under every draw of the law."""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from fewruns.several_laws import LawEstimates, SeveralLaws
from numpy.typing import NDArray
from scipy.special import stdtrit

from accelerated_evaluation.answer.posterior import Posterior, shrunk_estimates
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.smooth.mean import MeanLaw

LEVEL = 0.8  # level of the interval whose width is compared with and without the sampling error
NOISE = 25  # number of equally likely values that represent the distribution of the sampling error of a draw
LEAST = 0.1  # lower bound of 1 + t c, for sampling errors so large that their distribution is unknown


@dataclass(frozen=True)
class SampledPosterior:
    """Estimates of the probability of an event under each of K draws of the law, with their sampling errors.

    Attributes
    ----------
    probabilities
        The estimates, shape (K,).
    errors
        Relative standard errors of the estimates, shape (K,).
    member
        Index of the law of each draw among the members of the family, shape (K,).
    batches
        Number of batches, one more than the degrees of freedom of the errors.
    shared
        Relative standard error that all estimates have in common; NaN if it is not known.
    own
        Relative standard error of each estimate that is independent of the common error, shape (K,); None if
        it is not known.
    unseen_lapses
        Bound on the probability that unobserved lapses (rare runs in which the vehicle behaves differently)
        add to each estimate; 0 if the vehicle does not lapse.
    """

    probabilities: Array
    errors: Array
    member: NDArray[np.int_]
    batches: int
    shared: float = math.nan
    own: Array | None = None
    unseen_lapses: float = 0.0

    @classmethod
    def of(cls, found: LawEstimates, member: NDArray[np.int_]) -> Self:
        """Return the posterior from the estimates under all draws, given the members of the draws."""
        return cls(found.probabilities, found.errors, member, found.batches, found.shared, found.own)

    @property
    def alone(self) -> Posterior:
        """The posterior of the probability without the sampling error, as if the estimates were exact.

        The estimates vary more than the probabilities, because each has an error of its own. If this error is
        known, the estimates are shrunk towards their median (`posterior.shrunk_estimates`).
        """
        known = self.probabilities if self.own is None else shrunk_estimates(self.probabilities, self.own)
        return Posterior(known, self.member)

    @property
    def whole(self) -> Posterior:
        """The posterior of the probability with the sampling error.

        Each draw is replaced by `NOISE` equally likely values of the probability, Y / (1 + t c), given its
        estimate Y and its relative error c, with t from Student's distribution. If the two parts of the error
        are known, c is the common part, and Y is the shrunk estimate of `alone`.
        """
        levels = (np.arange(NOISE) + 0.5) / NOISE
        t = stdtrit(self.batches - 1, levels)
        errors = self.errors if self.own is None else np.full(self.errors.size, self.shared)
        values = self.alone.probabilities[:, None] / np.maximum(1 + errors[:, None] * t, LEAST)
        return Posterior(values.ravel(), np.repeat(self.member, NOISE))

    @property
    def deviation(self) -> float:
        """Relative standard error that all draws share, or the root mean square of all errors if unknown."""
        return float(np.sqrt(np.mean(self.errors**2))) if self.own is None else self.shared

    @property
    def share_of_sampling(self) -> float:
        """Relative increase of the width of the 80 % interval by the sampling error, on the log scale.

        It is infinite if the sampling error is so large that `LEAST` is reached. The estimates of the draws
        then vary so much that the interval without the sampling error is too wide as well.
        """
        if 1 + self.deviation * stdtrit(self.batches - 1, 0.5 / NOISE) < LEAST:
            return math.inf
        (low, high), (low_alone, high_alone) = (part.interval(LEVEL) for part in (self.whole, self.alone))
        with np.errstate(divide="ignore", invalid="ignore"):
            return float(np.log(high / low) / np.log(high_alone / low_alone) - 1)


def draws_of(law: MeanLaw) -> SeveralLaws:
    """Return the draws of a mean law, under each of which the runs give an estimate."""

    def only(chosen: NDArray[np.intp]) -> SeveralLaws:
        return draws_of(law.only_draws(chosen))  # faster, but the ratios are to the mean of these draws

    return SeveralLaws(law.log_ratios, law.from_normal_scores, only)
