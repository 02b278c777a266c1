"""The probability of an event under every draw of the law, from runs that were sampled under one law.

The sampler of few simulations estimates the probability of an event under the law that it samples. A batch
gives an estimate under another law f_k when its runs and its control variate are multiplied by
f_k / f_sampled; see `methods.surrogate.two_phase` for the estimate of a batch. The importance of a batch
stays as it was, because it was decided before the batch was drawn.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from accelerated_evaluation.answer.crossfit import Control
from accelerated_evaluation.answer.posterior import Posterior, without_scatter
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws import CutIns
from accelerated_evaluation.methods.surrogate.combining import BatchEstimate, that_count
from accelerated_evaluation.methods.surrogate.progress import Progress
from accelerated_evaluation.methods.surrogate.two_phase import TwoPhaseBatch

LEVEL = 0.8  # of the interval whose width the sampling may add to
NOISE = 25  # values of the sampling error that stand for its distribution, for each draw
LEAST = 0.1  # of 1 + t c, where the sampling error is so large that its form is unknown
INNER = (0.1, 0.9)  # levels of the draws from which the shared error is found
SMALLEST = 1e-3  # of the mean: a draw whose estimate is below, or negative, is not known


@dataclass(frozen=True)
class Ratios:
    """f_k / f_sampled of each draw k at the points of a batch: its runs, (K, n), and kept points, (K, m)."""

    runs: Array
    kept: Array


@dataclass(frozen=True)
class SampledPosterior:
    """The probability of an event under each draw of the law, and how well the runs have determined it.

    Attributes
    ----------
    probabilities
        Estimates, shape (K,).
    errors
        Their relative standard errors, shape (K,).
    member
        The law that each draw is of, as a number, shape (K,).
    batches
        Number of batches, one more than the degrees of freedom of the errors.
    shared
        The part of the relative error that all draws share; NaN if it is not known.
    own
        The part of the relative error of each draw that it has for itself, shape (K,); None if unknown.
    """

    probabilities: Array
    errors: Array
    member: NDArray[np.int_]
    batches: int
    shared: float = math.nan
    own: Array | None = None

    @property
    def alone(self) -> Posterior:
        """The posterior without the sampling error: as if every estimate were exact.

        The estimates scatter more than the probabilities do, because each has an error of its own. If this
        part of the error is known, the estimates are drawn towards their median; see `without_scatter`.
        """
        known = self.probabilities if self.own is None else without_scatter(self.probabilities, self.own)
        return Posterior(known, self.member)

    @property
    def whole(self) -> Posterior:
        """The posterior with the sampling error.

        Each draw is replaced by `NOISE` equally likely values of the probability, given its estimate Y and
        its relative error c: Y / (1 + t c) with t from Student's law, see `combining.interval`. If the parts
        of the error are known, c is the part that all draws share, and Y is as in `alone`.
        """
        levels = (np.arange(NOISE) + 0.5) / NOISE
        t = stdtrit(self.batches - 1, levels)
        errors = self.errors if self.own is None else np.full(self.errors.size, self.shared)
        values = self.alone.probabilities[:, None] / np.maximum(1 + errors[:, None] * t, LEAST)
        return Posterior(values.ravel(), np.repeat(self.member, NOISE))

    @property
    def deviation(self) -> float:
        """Relative error that all draws share; the root mean square of all errors if it is unknown."""
        return float(np.sqrt(np.mean(self.errors**2))) if self.own is None else self.shared

    @property
    def share_of_sampling(self) -> float:
        """Relative increase of the width of the 80 % interval, on the log scale, by the sampling error.

        It is infinite if the sampling error is so large that its form is unknown. The estimates of the draws
        then scatter so much that the interval without the sampling error is also too wide to compare with.
        """
        if 1 + self.deviation * stdtrit(self.batches - 1, 0.5 / NOISE) < LEAST:
            return math.inf
        (low, high), (low_alone, high_alone) = (part.interval(LEVEL) for part in (self.whole, self.alone))
        with np.errstate(divide="ignore", invalid="ignore"):
            return float(np.log(high / low) / np.log(high_alone / low_alone) - 1)


class Reweighting:
    """Keeps the ratios of densities of the batches, which are computed once for each batch.

    Parameters
    ----------
    ratios
        Returns log(f_k / f_sampled) at cut-ins, shape (K, n).
    cut_ins
        Maps normal scores, shape (n, d), to cut-ins, by the law that was sampled.
    member
        The law that each draw is of, as a number, shape (K,).
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
        """Return the probability of an event under each draw; None where no batch counts.

        With ``controls`` the errors are divided into the part that all draws share and the others.

        Parameters
        ----------
        progress
            Of the sampler.
        happened
            Whether the event happened in each run, shape (runs,); by default the event that was sampled.
        controls
            Control variates of the batches that count; by default those with which they were drawn.
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
        """Return the effective number of events under each draw (Kish 1965), shape (K,).

        It is the number of events of equal weight that would determine the probability as well.
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
        """Return the batches that count and are kept."""
        return that_count(progress.estimates)[-len(progress.batches) :] if progress.batches else []

    def _posterior(
        self, estimates: Array, variances: Array, importance: Array, counted: Sequence[BatchEstimate]
    ) -> SampledPosterior:
        """Return estimates with their relative errors: at least what was predicted, and at most 1 if that is.

        An error of 1 or more says that the runs know nothing of a draw, whose law puts the event elsewhere.
        """
        variations = np.array([batch.prediction.variation / batch.runs for batch in counted])
        predicted = np.sqrt(importance**2 @ variations)
        known = np.maximum(estimates, SMALLEST * estimates.mean())
        errors = np.clip(np.sqrt(variances) / known, predicted, max(predicted, 1.0))
        return SampledPosterior(known, errors, self.member, len(counted))

    def _sampled(self, number: int, batch: TwoPhaseBatch, happened: Array) -> tuple[Array, Array]:
        """Return the estimate of a batch for the sampled event, and its variance; found once."""
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
        A batch of the second phase.
    ratios
        The density ratios f_k / f_sampled of the K draws at the points of the batch.
    happened
        Whether the event happened in each of the n simulations, shape (n,).
    control
        The predicted probabilities of the event, which serve as control variate.

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
    """Divide the errors of a posterior into the part that all draws share and a part of each draw alone.

    The shared error is that of the mean of Y_k / P_k over the draws, without the tenth with the smallest and
    the tenth with the largest probabilities. The error of a draw alone is that of the difference from this
    mean.

    Parameters
    ----------
    found
        The posterior, whose probabilities stand for the P_k.
    parts
        Weight, batch, ratios, outcomes and control variate of each batch.
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
