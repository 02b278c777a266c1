"""Posterior of the crash probability, and rates per kilometre and per hour that follow from it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Self, cast

import numpy as np
import pandas as pd
import scipy
from fewruns import LawEstimates
from fewruns.weights import effective_number
from numpy.typing import NDArray
from scipy.special import stdtrit

from accelerated_evaluation.base.arguments import a_number
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.checking import checked
from accelerated_evaluation.base.errors import InputError

CONTRADICTED = "contradicted_by_counts"  # column of tables that marks vehicles
LEVELS = (0.5, 0.8, 0.95)  # levels of the credible intervals
SUMMARY = (
    "probability",
    "median",
    *(f"{end}{100 * level:.0f}" for level in LEVELS for end in ("low", "high")),
)
DATA, CHOICE, SAMPLING = "data", "choice of law", "sampling"  # sources of uncertainty
LEVEL = 0.8  # level of the interval whose width is compared with and without the sampling error
ENDS = (1 - LEVEL) / 2, (1 + LEVEL) / 2
NOISE = 25  # number of equally likely values that represent the distribution of the sampling error of a draw
LEAST = 0.1  # lower bound of 1 + t c, for sampling errors so large that their distribution is unknown
# Smallest share of the variance of the logarithms of the estimates that is attributed to the probabilities.
LEAST_BETWEEN = 0.25
GAP, AT_MEDIAN = 2.0, 0.01  # a median is unknown if quantiles at levels so near to it differ by such a factor
FEWEST = 5  # smallest effective number of events on which a number may rest


@checked()
@dataclass(frozen=True)
class Posterior:
    """The probability of an event under each of K draws of the law.

    Examples
    --------
    >>> import numpy as np
    >>> import accelerated_evaluation as ae
    >>> posterior = ae.Posterior(np.array([1e-6, 2e-6, 3e-6]), np.zeros(3, int))
    >>> round(posterior.probability, 9)
    2e-06
    """

    probabilities: Array  # shape (K,)
    member: NDArray[np.intp]  # number of the candidate from which each law was drawn, shape (K,)

    def __post_init__(self) -> None:
        values, shape = self.probabilities, self.member.shape
        if values.shape != shape or values.ndim != 1 or (values < 0).any() or np.isinf(values).any():
            raise InputError(
                "Posterior",
                seen=f"probabilities of shape {values.shape}, member of {shape}, negative or infinite values",
                expected="one probability and one number of a candidate for each draw, shape (K,)",
                change="Pass two arrays of equal length.",
            )

    is_sampled = False  # whether the probabilities have sampling errors
    unknown = np.False_  # in which draws the probability is unknown, shape (K,); see `PartlyKnown`
    # Bound on what unseen lapses and failed runs may add, shape (K,) or a number.
    unseen_lapses = cast("Array | float", 0.0)

    @property
    def probability(self) -> float:
        """Median of the draws of the probability; NaN if half of them are unknown."""
        return float(np.median(self.probabilities)) if np.mean(self.unknown) < 0.5 else math.nan

    @checked(level=a_number(0, 1))
    def interval(self, level: float) -> tuple[float, float]:
        """Return the ends of the equal-tailed credible interval of the probability at a level from 0 to 1.

        Draws in which the probability is unknown count as 0 for the lower end. An interval that begins at 0
        is a statement about its upper end only.
        """
        low = np.quantile(self.least, (1 - level) / 2)
        return float(low), float(np.quantile(self.probabilities, (1 + level) / 2))

    @property
    def least(self) -> Array:
        """The probabilities, with 0 in the draws in which they are unknown, shape (K,)."""
        return np.where(self.unknown, 0.0, self.probabilities)

    @property
    def sources(self) -> tuple[str, ...]:
        """Sources of uncertainty that the intervals contain.

        They are `DATA` if a candidate has several draws, and `CHOICE` if there are several candidates.
        """
        draws = np.unique(self.member, return_counts=True)[1]  # of each candidate
        contained = {DATA: draws.max() > 1, CHOICE: draws.size > 1}
        return tuple(source for source, is_contained in contained.items() if is_contained)

    @property
    def alone(self) -> "Posterior":
        """The posterior without sampling errors; probabilities that are computed exactly have none."""
        return self

    @property
    def with_sampling(self) -> Array:
        """Equally likely values of the probability for each draw, with sampling errors, shape (K, values)."""
        return self.probabilities[:, None]

    @property
    def most(self) -> Array:
        """The values ``with_sampling``, to which unseen lapses and failed runs add as much as they can."""
        return self.with_sampling + np.reshape(self.unseen_lapses, (-1, 1))

    @property
    def whole(self) -> "Posterior":
        """The posterior with sampling errors: the equally likely values of all draws."""
        values = self.with_sampling
        unknown = np.broadcast_to(np.reshape(self.unknown, (-1, 1)), values.shape)
        return PartlyKnown(values.ravel(), np.repeat(self.member, values.shape[1]), unknown.ravel())

    @property
    def deviation(self) -> float:
        """Relative standard deviation of the sampling error that all draws share."""
        return 0.0

    @property
    def noise(self) -> Array:
        """Equally likely values of estimate / probability for each draw, shape (K, values)."""
        return np.ones((self.probabilities.size, 1))


@dataclass(frozen=True)
class PartlyKnown(Posterior):
    """A posterior with draws in which the probability is unknown, except for its magnitude."""

    unknown: NDArray[np.bool_]  # shape (K,)


@dataclass(frozen=True)
class SampledPosterior(Posterior):
    """Estimates of the probability of an event under each draw of the law, from the same runs.

    The error of an estimate has a part that all draws share, because they use the same runs, and a part of
    its own. If the parts are not known, the whole error counts as shared, which is nearly so. A draw with an
    error of 1 or more is ``unknown``: hardly any run says something about it.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> draws = ae.choose_draws("independent_variables", ae.read_records("left_turn"))
    >>> found = ae.evaluate(ae.Problem("left_turn", "acc_aeb"), draws, ae.Simulations(20_000), generator=1)
    >>> isinstance(found.posterior, ae.SampledPosterior), found.posterior.errors.shape
    (True, (1,))
    """

    is_sampled = True
    errors: Array  # relative standard error of each estimate, shape (K,)
    batches: int  # number of independent batches of runs
    shared: float = math.nan
    own: Array | None = None  # shape (K,)
    unseen_lapses: Array | float = 0.0  # bound on what unseen lapses and failed runs may add, (K,) or alike
    within: Posterior | None = None  # that of an event which contains this one and is never less probable

    @classmethod
    def of(cls, found: LawEstimates, member: NDArray[np.intp], unseen_lapses: Array | float = 0.0) -> Self:
        """Return the posterior from the estimates of a sampler under all draws."""
        errors = found.errors, found.batches, found.shared, found.own
        return cls(found.probabilities, member, *errors, unseen_lapses)

    @property
    def unknown(self) -> NDArray[np.bool_]:
        """In which draws the probability is unknown, shape (K,)."""
        return self.errors >= 1

    @property
    def sources(self) -> tuple[str, ...]:
        """Sources of uncertainty that the intervals contain; the last one is the sampling."""
        return (*super().sources, SAMPLING)

    @property
    def alone(self) -> Posterior:
        """The posterior without sampling errors.

        If each draw has an error of its own, the estimates are shrunk towards each other by as much as these
        errors spread them.
        """
        probabilities, known = self.probabilities.copy(), ~self.unknown
        if self.own is not None and known.any():
            probabilities[known] = shrunk_estimates(probabilities[known], self.own[known])
        if self.within is not None:
            probabilities = np.minimum(probabilities, self.within.alone.probabilities)
        return PartlyKnown(probabilities, self.member, self.unknown)

    @property
    def with_sampling(self) -> Array:
        """Equally likely values of the probability for each draw, with sampling errors, shape (K, NOISE).

        If the relative error c of an estimate p is t-distributed, the probability is p / (1 + t c).
        """
        errors = self.errors if self.own is None else np.where(self.unknown, self.errors, self.shared)
        values = self.alone.probabilities[:, None] / self._noise(errors)
        return values if self.within is None else np.minimum(values, self.within.with_sampling)

    @property
    def noise(self) -> Array:
        """Equally likely values of estimate / probability for each draw, shape (K, NOISE)."""
        return self._noise(self.errors)

    def _noise(self, errors: Array) -> Array:
        t = stdtrit(self.batches - 1, (np.arange(NOISE) + 0.5) / NOISE)
        return np.maximum(1 + errors[:, None] * t, LEAST)

    @property
    def deviation(self) -> float:
        """Relative standard deviation of the sampling error that all draws share."""
        errors = self.errors[~self.unknown] if self.own is None else self.shared
        return float(np.sqrt(np.mean(errors**2))) if np.size(errors) else 1.0

    @property
    def share_of_sampling(self) -> float:
        """Share by which sampling errors widen the interval of the logarithm of the probability.

        Draws in which the probability is unknown are left out.
        """
        if 1 + self.deviation * stdtrit(self.batches - 1, 0.5 / NOISE) < LEAST:
            return math.inf
        known = [part.probabilities[~part.unknown] for part in (self.whole, self.alone)]
        (low, high), (low_alone, high_alone) = (np.quantile(each, ENDS) for each in known)
        with np.errstate(divide="ignore", invalid="ignore"):
            return float(np.log(high / low) / np.log(high_alone / low_alone) - 1)


def summarise(posterior: Posterior) -> dict[str, float]:
    """Return mean, median and the ends of the 50, 80 and 95 % intervals of a posterior, by `SUMMARY`."""
    ends = (end for level in LEVELS for end in posterior.interval(level))
    values = (float(posterior.probabilities.mean()), posterior.probability, *ends)
    return dict(zip(SUMMARY, values, strict=True))


def summarise_bounds(least: Array, most: Array) -> dict[str, float]:
    """Return the summary of n values between bounds, shape (n,) each, which differ for unknown values.

    Mean, median and lower ends are those of ``least``, and the upper ends those of ``most``. Mean and median
    are NaN if half of the values may be 0, or nearly half and half of them differ by a factor above `GAP`.
    """
    low, high = (summarise(Posterior(each, np.zeros(each.size, dtype=int))) for each in (least, most))
    row = low | {name: end for name, end in high.items() if name.startswith("high")}
    below, above = np.quantile(least, [0.5 - AT_MEDIAN, 0.5 + AT_MEDIAN])
    if np.mean((least == 0) & (most > 0)) >= 0.5:
        row |= {"probability": math.nan, "median": math.nan}
    elif above > GAP * below:
        row["median"] = math.nan
    return row


def answer_row(posterior: Posterior | None, limits: Mapping[str, float] | None = None) -> dict[str, float]:
    """Return the summary of a posterior, with lapses and failed runs in the upper ends; NaN for None.

    If there is no posterior, ``limits`` are the upper ends of the intervals by name, which begin at 0.
    """
    if posterior is None:
        zeros = {name.replace("high", "low"): 0.0 for name in limits or ()}
        return dict.fromkeys(SUMMARY, np.nan) | zeros | dict(limits or {})
    row = summarise(posterior.whole)
    row["probability"] = math.nan if math.isnan(row["median"]) else float(posterior.probabilities.mean())
    raised = summarise(replace(posterior.whole, probabilities=posterior.most.ravel().clip(max=1.0)))
    return row | {name: end for name, end in raised.items() if name.startswith("high")}


def count_limits(count: int, simulations: int) -> dict[str, float]:
    """Return exact upper ends of the intervals of a probability, from an event's count (Clopper, Pearson)."""
    return {
        f"high{100 * level:.0f}": float(scipy.stats.beta.ppf((1 + level) / 2, count + 1, simulations - count))
        for level in LEVELS
    }


def counted_posterior(weights: Array, size: int, member: NDArray[np.intp]) -> SampledPosterior | None:
    """Return the posterior of an event from its weighted occurrences, (K, m), among ``size`` simulations.

    It is None if there are fewer than `FEWEST` effective occurrences for the mean of the draws.
    """
    if effective_number(weights.mean(axis=0)) < FEWEST:
        return None
    estimates, effective = weights.sum(axis=1), effective_number(weights)
    variances = np.maximum((weights**2).sum(axis=1) - estimates**2 / size, 0)
    errors = np.divide(np.sqrt(variances), estimates, out=np.ones_like(estimates), where=effective >= FEWEST)
    return SampledPosterior(estimates, member, np.minimum(errors, 1), size)


def budget(
    posterior: Posterior, sampling_deviation: float, fixed: Mapping[str, Posterior] | None = None
) -> pd.DataFrame:
    """Divide the variance of the logarithm of a probability among its sources.

    These are ``data`` (mean variance of the draws within a law), ``choice of law`` (variance between the
    means of the laws), ``sampling`` (the relative deviation of an estimator), and ``together``. The part of
    ``data`` that vanishes if some parameters are ``fixed`` at posterior means has a row of its own.
    """
    variances = log_variances(posterior)
    parts = {}
    for name, own in (fixed or {}).items():
        parts[name] = max(variances[DATA] - log_variances(own)[DATA], 0.0)
    variances[DATA] -= sum(parts.values())
    choice = variances.pop(CHOICE)
    return shares(variances | parts | {CHOICE: choice, SAMPLING: float(np.log1p(sampling_deviation**2))})


def log_variances(posterior: Posterior) -> dict[str, float]:
    """Divide the variance of log(probability) into two parts, ``data`` and ``choice of law``.

    ``data`` is the variance among the draws of the same law, averaged over the laws. ``choice of law`` is the
    rest of the variance. Both parts are NaN if the probability is 0 in a draw. Draws in which it is unknown
    are left out.
    """
    known = ~np.broadcast_to(posterior.unknown, posterior.probabilities.shape)
    with np.errstate(divide="ignore"):
        logs = pd.Series(np.log(posterior.probabilities[known]))
    if logs.empty or not np.isfinite(logs).all():
        return {"data": np.nan, "choice of law": np.nan}
    groups = logs.groupby(posterior.member[known])
    means, counts = groups.transform("mean"), groups.transform("size")
    within = float((logs - means).pow(2).mean() * counts.mean() / max(counts.mean() - 1, 1))
    return {"data": within, "choice of law": max(float(logs.var()) - within, 0.0)}


def shares(variances: Mapping[str, float]) -> pd.DataFrame:
    """Tabulate the variances of a logarithm by source, with their shares of the total variance.

    If a variance is NaN, the event does not happen under some draw, so its logarithm has no variance. All
    factors are then 1, and all shares NaN. The row ``together`` is for all sources, and ``factor`` is
    exp(standard deviation).
    """
    total = sum(variances.values())
    if np.isnan(total):
        names = [*variances, "together"]
        return pd.DataFrame({"source": names, "factor": 1.0, "variance_share": np.nan})
    rows = [(name, float(np.exp(np.sqrt(value))), value / total) for name, value in variances.items()]
    rows.append(("together", float(np.exp(np.sqrt(total))), 1.0))
    return pd.DataFrame(rows, columns=["source", "factor", "variance_share"])


def shrunk_estimates(estimates: Array, own: Array) -> Array:
    """Shrink estimates towards their median, so that they have the variance of the true probabilities.

    The estimates vary more than the probabilities, because each has a sampling error e_k of its own. Let V be
    the variance of the logarithms of the estimates. The variance of the logarithms of the probabilities is
    then A = V - mean of e_k^2, but at least `LEAST_BETWEEN` V. The distance of each logarithm from the median
    is multiplied by sqrt(A / (A + e_k^2)). This is a constrained empirical Bayes estimate (Louis 1984) for
    probabilities whose logarithms are normal around the median. An estimate with a very large error is almost
    replaced by the median; in the mean of e_k^2 an error above 1 counts as 1. The relative errors ``own``
    leave out the error that all estimates share.
    """
    logs = np.log(estimates)
    middle, variance = np.median(logs), logs.var()
    if variance == 0:
        return estimates
    between = max(variance - np.minimum(own**2, 1.0).mean(), LEAST_BETWEEN * variance)
    return np.exp(middle + np.sqrt(between / (between + own**2)) * (logs - middle))
