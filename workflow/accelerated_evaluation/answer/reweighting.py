"""The probability of an event under every draw of the law, from runs that were sampled under one law.

The surrogate-guided sampler estimates the probability of an event under the law that it samples. A batch also
gives an estimate under another law f_k, if the terms of its runs and of its control variate are multiplied by
f_k / f_sampled; see `methods.surrogate.two_phase` for the estimate of a batch. The weights of the batches in
the estimate are not changed, because they were determined before the batches were drawn.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from fewruns.combining import BatchEstimate, counted_batches
from fewruns.progress import Progress
from fewruns.two_phase import TwoPhaseBatch
from numpy.typing import NDArray
from scipy.special import stdtrit

from accelerated_evaluation.answer.crossfit import Control
from accelerated_evaluation.answer.posterior import Posterior, shrunk_estimates
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws import CutIns

LEVEL = 0.8  # level of the interval whose width is compared with and without the sampling error
NOISE = 25  # number of equally likely values that represent the distribution of the sampling error of a draw
LEAST = 0.1  # lower bound of 1 + t c, for sampling errors so large that their distribution is unknown
INNER = (0.1, 0.9)  # quantile levels between which draws are used for the shared error
SMALLEST = 1e-3  # lower bound of the estimate of a draw, as a share of the mean; estimates may be negative


@dataclass(frozen=True)
class Ratios:
    """Density ratios f_k / f_sampled of K draws of the law at the points of a batch.

    Attributes
    ----------
    runs
        Ratios at the n runs of the batch, shape (K, n).
    kept
        Ratios at the m points of the pool that the batch keeps to integrate its control variate, shape (K,
        m).
    """

    runs: Array
    kept: Array


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


class Reweighting:
    """Estimates of an event's probability under each of K draws of the law, from the runs of one sampler.

    The runs are reweighted with the ratios of the densities of a draw and of the law that was sampled. The
    ratios of a batch are computed once and kept.

    Parameters
    ----------
    ratios
        Function that returns log(f_k / f_sampled) at n cut-ins for all K draws, shape (K, n).
    cut_ins
        Function that maps normal scores, shape (n, d), to cut-ins, by the law that was sampled.
    member
        Index of the law of each draw among the members of the family, shape (K,).
    """

    def __init__(
        self,
        ratios: Callable[[CutIns], Array],
        cut_ins: Callable[[Array], CutIns],
        member: NDArray[np.int_],
    ) -> None:
        self._ratios, self._cut_ins, self.member = ratios, cut_ins, member
        self._known: dict[int, Ratios] = {}
        self._estimates: dict[int, tuple[Array, Array]] = {}

    def estimate(
        self,
        progress: Progress,
        happened: Array | None = None,
        controls: Sequence[Control] | None = None,
    ) -> SampledPosterior | None:
        """Estimate the probability of an event under each draw of the law.

        Parameters
        ----------
        progress
            The runs of the sampler.
        happened
            Whether the event happened in each run, shape (runs,); by default the event that was sampled.
        controls
            Control variates of the batches of `counted`, which are predicted probabilities of the event; by
            default those with which the batches were drawn. If they are given, the errors are divided into a
            common part and a part of each draw.

        Returns
        -------
        SampledPosterior or None
            The estimates with their relative errors; None if there are fewer than two batches of `counted`,
            or if the mean of the estimates is not positive.
        """
        counted = self.counted(progress)
        if len(counted) < 2:
            return None
        first = len(progress.batches) - len(counted)
        batches = progress.batches[first:]
        importance = np.array([estimate.importance for estimate in counted])
        importance /= importance.sum()
        known = progress.happened if happened is None else happened
        last = np.cumsum([len(batch.z) for batch in batches])
        flags = np.split(known[len(known) - last[-1] :], last[:-1])
        estimates, variances = np.zeros(self.member.size), np.zeros(self.member.size)
        parts = []
        for place, (weight, batch) in enumerate(zip(importance, batches, strict=True)):
            number = first + place
            if happened is None and controls is None:
                estimate, variance = self._sampled(number, batch, flags[place])
            else:
                control = Control.own(batch) if controls is None else controls[place]
                parts.append((weight, batch, self._ratios_of(number, batch), flags[place], control))
                estimate, variance = reweight(*parts[-1][1:])
            estimates += weight * estimate
            variances += weight**2 * variance
        if not estimates.mean() > 0:
            return None
        found = self._posterior(estimates, variances, importance, counted)
        return found if controls is None else divided(found, parts)

    def effective_events(self, progress: Progress) -> Array:
        """Return the effective number of events under each draw, (sum w)^2 / sum w^2 (Kish 1965), shape (K,).

        The sums are over the events of the batches of `counted`, with their weights w under the draw.

        Parameters
        ----------
        progress
            The runs of the sampler.
        """
        first, weights = len(progress.batches) - len(self.counted(progress)), []
        sizes = [len(batch.z) for batch in progress.batches]
        ends = len(progress.happened) - sum(sizes) + np.cumsum([0, *sizes])
        for number in range(first, len(progress.batches)):
            batch, estimate = progress.batches[number], progress.estimates[number - len(progress.batches)]
            happened = progress.happened[ends[number] : ends[number + 1]]
            shares = estimate.importance * happened * batch.weight / batch.inclusion
            weights.append(self._ratios_of(number, batch).runs * shares)
        of_events = np.hstack(weights)
        return of_events.sum(axis=1) ** 2 / np.maximum((of_events**2).sum(axis=1), np.finfo(float).tiny)

    @staticmethod
    def counted(progress: Progress) -> Sequence[BatchEstimate]:
        """Return the estimates of the batches on which the result of the sampler is based.

        `counted_batches` selects these batches. Only those whose runs are still stored are returned.

        Parameters
        ----------
        progress
            The runs of the sampler.
        """
        return counted_batches(progress.estimates)[-len(progress.batches) :] if progress.batches else []

    def _posterior(
        self, estimates: Array, variances: Array, importance: Array, counted: Sequence[BatchEstimate]
    ) -> SampledPosterior:
        """Return the estimates with their relative errors.

        An error is at least the predicted one, and at most 1 if the predicted one is. An error of 1 means
        that the runs contain no information about a draw, because the event is elsewhere under its law.
        """
        variations = np.array([batch.prediction.variation / batch.runs for batch in counted])
        predicted = np.sqrt(importance**2 @ variations)
        known = np.maximum(estimates, SMALLEST * estimates.mean())
        errors = np.clip(np.sqrt(variances) / known, predicted, max(predicted, 1.0))
        return SampledPosterior(known, errors, self.member, len(counted))

    def _sampled(self, number: int, batch: TwoPhaseBatch, happened: Array) -> tuple[Array, Array]:
        """Return the estimate of a batch for the sampled event, and its variance; both are computed once."""
        if number not in self._estimates:
            ratios = self._ratios_of(number, batch)
            self._estimates[number] = reweight(batch, ratios, happened, Control.own(batch))
        return self._estimates[number]

    def _ratios_of(self, number: int, batch: TwoPhaseBatch) -> Ratios:
        if number not in self._known:
            points = np.vstack([batch.z, *([batch.kept] if len(batch.kept) else [])])
            ratios = np.exp(self._ratios(self._cut_ins(points)))
            self._known[number] = Ratios(ratios[:, : len(batch.z)], ratios[:, len(batch.z) :])
        return self._known[number]


def reweight(batch: TwoPhaseBatch, ratios: Ratios, happened: Array, control: Control) -> tuple[Array, Array]:
    """Reweight one batch of simulations, so that it estimates the probability of the event under each draw.

    If all ratios are 1 and the control variate is that of the batch, the results are those of
    `combining.estimate_batch`, except that the kept points replace the whole pool.

    Parameters
    ----------
    batch
        A batch of the second phase, whose runs give an estimate; the runs of the first phase only search for
        the event.
    ratios
        The density ratios f_k / f_sampled of the K draws at the points of the batch.
    happened
        Whether the event happened in each of the n simulations, shape (n,).
    control
        The predicted probabilities of the event, which are the control variate.

    Returns
    -------
    estimate : numpy.ndarray
        Estimated probability under each draw, shape (K,).
    variance : numpy.ndarray
        Observed variance of each estimate, shape (K,).
    """
    n, points = len(happened), max(len(batch.kept), 1)
    terms = ratios.runs * (batch.weight * (happened - control.runs) / batch.inclusion)
    controlled = ratios.kept * (batch.controlled / points * control.kept)
    squares = controlled * ratios.kept @ batch.kept_weight + terms * ratios.runs @ batch.weight
    second_phase = (terms**2 * (1 - batch.inclusion)).sum(axis=1) * n / max(n - 1, 1)
    return controlled.sum(axis=1) + terms.sum(axis=1), np.maximum(squares, 0.0) + second_phase


Part = tuple[float, TwoPhaseBatch, Ratios, Array, Control]


def divided(found: SampledPosterior, parts: Sequence[Part]) -> SampledPosterior:
    """Divide the errors of the estimates into a part that all draws share and a part of each draw alone.

    Let Y_k be the estimate under draw k, and P_k its probability. The shared part is the standard error of
    the mean of Y_k / P_k over the draws, without those below the 10 % and above the 90 % quantile of P_k. The
    part of a draw alone is the standard error of the difference of Y_k / P_k from this mean.

    Parameters
    ----------
    found
        The estimates, which are also used as the probabilities P_k.
    parts
        Weight, batch, density ratios, outcomes and control variate of each batch.

    Returns
    -------
    SampledPosterior
        The same estimates, with the attributes ``shared`` and ``own``.
    """
    scale = found.probabilities[:, None]
    low, high = np.quantile(scale, INNER)
    inner = ((scale >= low) & (scale <= high))[:, 0]
    shared, own = 0.0, np.zeros(scale.size)
    for weight, batch, ratios, happened, control in parts:
        relative = Ratios(ratios.runs / scale, ratios.kept / scale)
        mean = Ratios(*(each[inner].mean(axis=0, keepdims=True) for each in (relative.runs, relative.kept)))
        rest = Ratios(relative.runs - mean.runs, relative.kept - mean.kept)
        shared += weight**2 * float(reweight(batch, mean, happened, control)[1][0])
        own += weight**2 * reweight(batch, rest, happened, control)[1]
    return replace(found, shared=math.sqrt(shared), own=np.sqrt(own))
