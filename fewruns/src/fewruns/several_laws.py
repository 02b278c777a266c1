"""The probability of an event under each of K laws, from runs that were sampled under one law.

The terms of a batch (`two_phase`) are multiplied by f_k / f_sampled. The weights of the batches are not
changed, because they were determined before the batches were drawn.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fewruns.arrays import Array, Flags, Indices
from fewruns.crossfit import Control, cross_fitted
from fewruns.emphasis import Emphasis, representative
from fewruns.errors import InputError
from fewruns.progress import LawDraws, Progress
from fewruns.sampler import Sampler
from fewruns.two_phase import TwoPhaseBatch
from fewruns.weights import effective_number

INNER = (0.1, 0.9)  # quantile levels between which laws are used for the shared error
LARGEST_LOG = 700.0  # logarithm of the largest density ratio
# The probability under a law is unknown, with an error of 1, if more than these shares of its estimate rest
# on the largest terms, or on the outermost points: the event then reaches beyond all points under this law.
# The outermost points are the given share of those that are kept.
LARGEST_SHARE, OUTERMOST, OUTERMOST_SHARE = 0.5, 0.05, 0.25
FEWEST = 5  # smallest effective number of draws of the law with the event
TINY = np.finfo(float).tiny  # so that nothing is divided by 0, or by a number that has underflown


@dataclass(frozen=True)
class LawEstimates:
    """Estimates of the probability of an event under each of K laws.

    Attributes
    ----------
    probabilities, errors
        The estimates and their relative standard errors, shape (K,). The probability under a law with an
        error of 1 is unknown, because the event is elsewhere under it, where there are no or few runs.
    batches
        Number of batches, one more than the degrees of freedom of the errors.
    shared, own
        The parts of the errors that all estimates have in common, and of each alone, shape (K,); NaN and None
        if they are not known.

    Examples
    --------
    >>> import numpy as np
    >>> from fewruns import LawEstimates
    >>> found = LawEstimates(np.array([1e-6, 3e-6]), np.array([0.1, 0.2]), batches=12)
    >>> (found.probabilities * found.errors).round(9).tolist()  # standard errors
    [1e-07, 6e-07]
    """

    probabilities: Array
    errors: Array
    batches: int
    shared: float = math.nan
    own: Array | None = None


@dataclass(frozen=True)
class Ratios:
    """Density ratios f_k / f_sampled of K laws at the points of a batch."""

    runs: Array  # at the n runs of the batch, shape (K, n)
    kept: Array  # at the m points of the pool that the batch keeps to integrate its control variate, (K, m)


class SeveralLaws:
    """K laws, under each of which the probability of the event is estimated from the same runs.

    Use them if the law of the inputs is uncertain, and is represented by K draws. The runs are sampled under
    one law, for example the mean of the draws, and are reweighted for every draw.

    Parameters
    ----------
    log_ratios
        Function that returns log(f_k / f_sampled) at n points for all K laws, shape (K, n).
    to_points
        Function that maps normal scores, shape (n, d), to points, by the law that is sampled; by default the
        points are the normal scores.
    only
        Function that returns the `SeveralLaws` with given indices, if this is faster than ``log_ratios``.

    Examples
    --------
    The mean of a normal input is uncertain. The runs are sampled under the mean 0.

    >>> import numpy as np
    >>> import fewruns
    >>> from scipy.stats import norm
    >>> means = np.array([-0.3, 0.0, 0.3])
    >>> laws = fewruns.SeveralLaws(lambda z: np.outer(means, z[:, 0]) - means[:, None] ** 2 / 2)
    >>> problem = fewruns.SystemProblem(lambda z: (z[:, 0] > 4, 4 - z[:, 0]), 2)
    >>> sampler = fewruns.Sampler(2, np.random.default_rng(1))
    >>> goal = fewruns.Stopping(maximum_simulations=1000)
    >>> for _ in fewruns.run_batches(sampler, problem, goal):
    ...     pass
    >>> found = laws.refined(sampler)
    >>> bool(np.all(abs(np.log(found.probabilities / norm.sf(4 - means))) < 4 * found.errors))
    True
    >>> bool(found.own[1] < found.shared)  # the three estimates are wrong by nearly the same factor
    True
    """

    def __init__(
        self,
        log_ratios: Callable[[Any], Array],
        to_points: Callable[[Array], Any] = lambda z: z,
        only: Callable[[Indices], "SeveralLaws"] | None = None,
    ) -> None:
        self._log_ratios, self._to_points, self._only = log_ratios, to_points, only
        self._known: dict[int, Ratios] = {}
        self._estimates: dict[int, Reweighted] = {}

    def ratios(self, z: Array) -> Array:
        """Return the density ratios f_k / f_sampled at normal scores z, shape (n, d), as an array (K, n).

        InputError is raised if they have another shape, or if a ratio is infinite or not a number.
        """
        logarithms = np.asarray(self._log_ratios(self._to_points(z)))
        if logarithms.ndim != 2 or logarithms.shape[1] != len(z) or not (logarithms < LARGEST_LOG).all():
            seen = f"an array {logarithms.shape}, with the maximum {logarithms.max(initial=0.0):g}"
            expected = f"log(f_k / f_sampled) of all laws at {len(z)} points, shape (K, {len(z)}), all finite"
            raise InputError("log_ratios", seen=seen, expected=expected, change="Correct the function.")
        return np.exp(logarithms)

    def only(self, chosen: Indices) -> "SeveralLaws":
        """Return the laws with the given indices, shape (k,)."""
        if self._only is not None:
            return self._only(chosen)
        return SeveralLaws(lambda x: self._log_ratios(x)[chosen], self._to_points)

    def estimate(
        self, sampler: Sampler, happened: Array | None = None, controls: Sequence[Control] | None = None
    ) -> LawEstimates | None:
        """Return the estimates of the probability of an event under each law; None if there are none yet.

        The density ratios of a batch are kept, so that the laws must not be used with another sampler.

        Parameters
        ----------
        sampler
            The sampler with its runs.
        happened
            Whether the event happened in each run, shape (runs,); by default the event that was sampled. If
            the sampler counts its events (`Sampler.is_counted`), in each draw of the law.
        controls
            Predicted probabilities of the event at the batches of `Progress.stored`, by default those with
            which they were drawn. If they are given, the errors are divided into a common part and a part of
            each law.
        """
        progress = sampler.progress
        if sampler.is_counted:
            return self._of_draws(progress.law_draws, happened)
        stored, known = progress.stored, progress.happened if happened is None else happened
        if len(stored) < 2 or not known.any():
            return None
        first = len(progress.batches) - len(stored)
        estimated, batches = zip(*stored, strict=True)
        importance = np.array([estimate.importance for estimate in estimated])
        importance /= importance.sum()
        last = np.cumsum([len(batch.z) for batch in batches])
        flags: list[Array] = np.split(known[len(known) - last[-1] :], last[:-1])
        parts: list[Part] = []
        # What `reweight` returns for the sampled event is computed once for each batch.
        found = self._estimates if happened is None and controls is None else {}
        for place, (weight, batch) in enumerate(zip(importance, batches, strict=True)):
            number, control = first + place, Control.own(batch) if controls is None else controls[place]
            parts.append((weight, batch, self._ratios_of(number, batch), flags[place], control))
            if number not in found:
                found[number] = reweight(*parts[-1][1:])
        results = [found[first + place] for place in range(len(parts))]
        estimates, variances, kept, outer, run, size = map(np.array, zip(*results, strict=True))
        mean = importance @ estimates
        if not mean.mean() > 0:
            return None
        variations = np.array([each.prediction.variation / max(each.runs, 1) for each in estimated])
        predicted = float(np.sqrt(importance**2 @ variations))
        largest = importance @ kept + (importance[:, None] * run).max(axis=0)
        share, outer = np.array([largest, importance @ outer]) / np.maximum(importance @ size, TINY)
        known = (mean > TINY) & (share < LARGEST_SHARE) & (outer < OUTERMOST_SHARE)
        errors = relative_errors(mean, np.sqrt(importance**2 @ variances), share, known, predicted)
        laws = LawEstimates(np.maximum(mean, 0.0), errors, int(np.count_nonzero(importance)))
        return laws if controls is None else divided(laws, parts, predicted)

    def refined(self, sampler: Sampler) -> LawEstimates | None:
        """Return more precise estimates of the sampled event, with divided errors.

        A surrogate that was fitted without a batch predicts its control variate, which takes some seconds.
        """
        stored = len(sampler.progress.stored)
        if stored < 2 or sampler.is_counted:
            return self.estimate(sampler)
        return self.estimate(sampler, controls=cross_fitted(sampler, stored))

    def emphasis(self, found: LawEstimates) -> Emphasis:
        """Return the value for `Sampler.emphasis` with which the estimates become equally precise."""
        chosen, relative = representative(found.probabilities)
        return Emphasis(self.only(chosen).ratios, relative)

    def effective_events(self, progress: Progress) -> Array:
        """Return the effective number of events (sum w)^2 / sum w^2 under each law (Kish 1965)."""
        runs, weights = self.weights(progress)
        return effective_number(weights * progress.happened[runs])

    def weights(self, progress: Progress) -> tuple[Indices, Array]:
        """Return the runs of the stored batches of the estimate, shape (n,), and their weights, shape (K, n).

        The sum of the weights of the events is the estimate without control variates.
        """
        stored = progress.stored
        total, weights = sum(estimate.importance for estimate, _ in stored), []
        for number, (estimate, batch) in enumerate(stored, len(progress.batches) - len(stored)):
            shares = estimate.importance / total * batch.weight / batch.inclusion
            weights.append(self._ratios_of(number, batch).runs * shares)
        joined = np.hstack(weights)
        return np.arange(joined.shape[1]) + len(progress.happened) - joined.shape[1], joined

    def _of_draws(self, draws: LawDraws, happened: Array | None) -> LawEstimates | None:
        """Return the weighted shares of an event among the draws of the law; None without an event."""
        events = (draws.happened if happened is None else happened) > 0
        weights = self.ratios(draws.z[events]) / len(draws)
        estimates = weights.sum(axis=1)
        if not estimates.any():
            return None
        variances = np.maximum((weights**2).sum(axis=1) - estimates**2 / len(draws), 0.0)
        share = weights.max(axis=1) / np.maximum(estimates, TINY)
        errors = relative_errors(estimates, np.sqrt(variances), share, effective_number(weights) >= FEWEST)
        return LawEstimates(estimates, errors, max(int(np.count_nonzero(events)), 2))

    def _ratios_of(self, number: int, batch: TwoPhaseBatch) -> Ratios:
        if number not in self._known:
            ratios = self.ratios(np.vstack([batch.z, batch.kept]))
            self._known[number] = Ratios(ratios[:, : len(batch.z)], ratios[:, len(batch.z) :])
        return self._known[number]


Reweighted = tuple[Array, Array, Array, Array, Array, Array]  # what `reweight` returns


def reweight(batch: TwoPhaseBatch, ratios: Ratios, happened: Array, control: Control) -> Reweighted:
    """Return the estimates of one batch under K laws and their observed variances, shapes (K,).

    The other four arrays say on how few points an estimate rests: the largest term at a kept point, the sum
    of the terms at the outermost kept points, the largest term at a run, and the sum of all terms, in
    absolute values.
    """
    n, points = len(happened), max(len(batch.kept), 1)
    terms = ratios.runs * (batch.weight * (happened - control.runs) / batch.inclusion)
    controlled = ratios.kept * (batch.controlled / points * control.kept)
    squares = controlled * ratios.kept @ batch.kept_weight + terms * ratios.runs @ batch.weight
    second_phase = (terms**2 * (1 - batch.inclusion)).sum(axis=1) * n / max(n - 1, 1)
    sizes, integral = np.abs(terms), controlled.sum(axis=1)
    distance = (batch.kept**2).sum(axis=1)
    farthest = distance > np.quantile(distance, 1 - OUTERMOST) if len(distance) else slice(0)
    return (
        integral + terms.sum(axis=1),
        np.maximum(squares, 0.0) + second_phase,
        controlled.max(axis=1, initial=0.0),
        controlled[:, farthest].sum(axis=1),
        sizes.max(axis=1, initial=0.0),
        integral + sizes.sum(axis=1),
    )


def relative_errors(
    estimates: Array, deviations: Array, share: Array, known: Flags, predicted: float = 0.0
) -> Array:
    """Return the relative errors of K estimates, shape (K,), from their standard deviations.

    They are at least the ``predicted`` error, and at least the ratio of the ``share`` of an estimate that
    rests on its largest terms to the rest, because a few terms do not show how much they vary. The error of
    an estimate that is not ``known`` is 1.
    """
    errors = np.divide(deviations, estimates, out=np.ones_like(estimates), where=known)
    errors = np.maximum(errors, np.divide(share, 1 - share, out=np.ones_like(share), where=known))
    return np.clip(errors, predicted, max(predicted, 1.0))


Part = tuple[float, TwoPhaseBatch, Ratios, Array, Control]  # a batch with its weight and outcomes


def divided(found: LawEstimates, parts: Sequence[Part], predicted: float) -> LawEstimates:
    """Divide the errors of the estimates into a part that all laws share and a part of each law alone.

    Let Y_k be the estimate under law k, and P_k its probability, for which Y_k is used. The shared part is
    the standard error of the mean of Y_k / P_k over the laws, without the extreme ones (`INNER`). The part of
    a law alone is the standard error of the difference of Y_k / P_k from this mean.

    The standard error from the runs is too small where a few runs have missed a part of the event. The shared
    part is therefore at least the ``predicted`` error, as that of the estimate of the sampler
    (`combining.Combined.error`).
    """
    known = found.errors < 1
    scale = np.where(known, found.probabilities, found.probabilities.mean())[:, None]
    known |= not known.any()
    low, high = np.quantile(scale[known], INNER)
    inner = known & ((scale >= low) & (scale <= high))[:, 0]
    inner |= known & (not inner.any())  # both of two laws are extreme
    shared, own = 0.0, np.zeros(scale.size)
    for weight, batch, ratios, happened, control in parts:
        relative = Ratios(ratios.runs / scale, ratios.kept / scale)
        mean = Ratios(*(each[inner].mean(axis=0, keepdims=True) for each in (relative.runs, relative.kept)))
        rest = Ratios(relative.runs - mean.runs, relative.kept - mean.kept)
        shared += weight**2 * float(reweight(batch, mean, happened, control)[1][0])
        own += weight**2 * reweight(batch, rest, happened, control)[1]
    own = np.where(found.errors < 1, np.sqrt(own), 1.0)
    return replace(found, shared=max(math.sqrt(shared), predicted), own=own)
