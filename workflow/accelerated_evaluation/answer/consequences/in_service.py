"""Kilometres in service: what counted crashes say about the predicted rate, and whether there are too many.

Let r_k be equally likely values of the predicted rate of crashes, of which a share that is known within
limits is counted: N crashes in T kilometres. The values are weighted by their Poisson likelihood. The test
compares the prediction with the alternative that all rates are higher by a factor 1 + g, where g has an
exponential distribution with mean 1. The ratio of the marginal likelihoods of the counts is an e-process: if
the prediction is right, it ever exceeds 1 / alpha with a probability of at most alpha (Ville's inequality;
Ramdas and others 2023, Statistical Science 38, 576-601). It may therefore be inspected any number of times.
"""

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
import scipy
from fewruns.weights import effective_number
from numpy.typing import NDArray
from scipy.special import gammaln, logsumexp, xlogy

from accelerated_evaluation.answer.candidates.fitted_records import FittedRecords
from accelerated_evaluation.answer.consequences.criterion import SHARES, Counted, Judged
from accelerated_evaluation.answer.consequences.rates import UNITS, Rate
from accelerated_evaluation.answer.consequences.total import rate_values
from accelerated_evaluation.answer.ways.posterior import Posterior, summarise_bounds
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError, StudyError

FALSE_ALARMS = 0.05  # largest probability that the test ever gives an alarm, if the prediction is right
CONTRADICTED = 1e-3  # smallest mid-p value of a count with which the prediction is compatible
FEWEST = 100  # smallest effective number of values whose quantiles are stated


@dataclass(frozen=True)
class InService:
    """Cumulative kilometres (or hours) and counted crashes of a fleet, at several times."""

    exposure: Array  # increasing, shape (n,)
    events: Array  # shape (n,)

    def e_values(self, rates: Array) -> Array:
        """Return the e-process at each time, for equally likely values of the predicted rate, shape (n,).

        At least one rate has to be positive.
        """
        expected = np.outer(self.exposure, rates)
        events = self.events[:, None]
        null = xlogy(events, rates) - expected  # log likelihood, up to a factor of each time
        evidence = null + log_mean_ratio(events, expected)
        return np.exp(logsumexp(evidence, axis=1) - logsumexp(null, axis=1))

    def weights(self, rates: Array) -> Array:
        """Return the posterior weights of equally likely rates after the last time, with the sum 1."""
        logs = xlogy(self.events[-1], rates) - self.exposure[-1] * rates
        return np.exp(logs - logsumexp(logs))

    def mid_p(self, least: Array, most: Array) -> float:
        """Return the two-sided mid-p value of the last count if the prediction is right.

        The rates are known within bounds. So few counts are judged by the lower ones, and so many by the
        upper ones.
        """
        count, (low, high) = self.events[-1], np.array([least, most]) * self.exposure[-1]
        below = (scipy.stats.poisson.cdf(count - 1, low) + scipy.stats.poisson.pmf(count, low) / 2).mean()
        above = (scipy.stats.poisson.sf(count, high) + scipy.stats.poisson.pmf(count, high) / 2).mean()
        return float(min(1.0, 2 * min(below, above)))


def log_mean_ratio(events: Array, expected: Array) -> Array:
    """Return log E[(1 + g)^N exp(-g m)] for N events, m expected ones, and g exponential with mean 1.

    With c = m + 1, the mean is exp(c) c^-(N + 1) Gamma(N + 1, c), an upper incomplete gamma function.
    """
    c = expected + 1
    tail = scipy.stats.gamma.logsf(c, events + 1)
    exact = c - (events + 1) * np.log(c) + gammaln(events + 1) + tail
    # Where the tail has no logarithm, c is so much larger than N that the first term of its series is enough.
    return np.where(np.isfinite(tail), exact, -np.log(np.maximum(c - events, 1.0)))


def length_of(counted: Counted, records: FittedRecords) -> float:
    """Return the kilometres or hours of the records, in the unit of counts in service."""
    if (length := records.exposure[counted.unit]) is None:
        raise InputError(
            "in_service",
            seen=f"crashes in {counted.unit}",
            expected=f"records whose {counted.unit} are known",
            change="State the exposure of the records, or leave in_service out.",
        )
    return length


def updated_rates(
    posterior: Posterior, counted: Counted, records: FittedRecords, generator: np.random.Generator
) -> pd.DataFrame:
    """Return `in_service_table` of the rate of an event by its probability in an encounter.

    The share of the crashes that is counted is uniform in its logarithm, as in criteria.
    """
    rate = Rate(records.size, length_of(counted, records))
    rates = rate_values(posterior, rate, generator)
    low, high = counted.reported
    levels = (np.arange(rates.shape[1]) + 0.5) / rates.shape[1]  # the rates have a random order
    counts = InService(np.array([counted.exposure]), np.array([float(counted.events)]))
    table = in_service_table(rates, low * (high / low) ** levels, counts)
    return table.assign(per=UNITS[counted.unit])


def judged_after(judged: Judged, counted: Counted, records: FittedRecords) -> Judged:
    """Return a criterion that is judged after the crashes in service; its note contains the verdict before.

    Its values are weighted by the Poisson likelihood of the counts at their probabilities of the event. The
    rate of encounters is that of the records.
    """
    (low, high), at = counted.reported, (np.arange(SHARES) + 0.5) / SHARES
    per_probability = counted.exposure * records.size / length_of(counted, records) * low * (high / low) ** at
    expected = np.multiply.outer(per_probability, judged.events.ravel())
    logs = logsumexp(xlogy(counted.events, expected) - expected, axis=0)
    place = resampled(judged.draws.ravel(), np.exp(logs - logsumexp(logs)))
    note = f"before the crashes in service, it was met with probability {judged.probability_met:.2g}"
    draws, events = (each.ravel()[place].reshape(each.shape) for each in (judged.draws, judged.events))
    least = None if judged.least is None else judged.least.ravel()[place].reshape(draws.shape)
    note = "; ".join(filter(None, [judged.note, note]))
    return replace(judged, draws=draws, events=events, least=least, note=note)


def resampled(values: Array, weights: Array) -> NDArray[np.intp]:
    """Return indices of as many equally likely values as there are values with weights, shape (n,)."""
    order, levels = np.argsort(values), (np.arange(values.size) + 0.5) / values.size
    return order[np.searchsorted(np.cumsum(weights[order]), levels).clip(max=values.size - 1)]


def in_service_table(rates: Array, reported: Array, counts: InService) -> pd.DataFrame:
    """Return the rate before and after the counts, one row each.

    Parameters
    ----------
    rates
        Bounds of equally likely values of the predicted rate of crashes, shape (2, K), or (K,) if they are
        equal. Both are updated, and the summary is that of `summarise_bounds`.
    reported
        Equally likely values of the share of the crashes that are counted, shape (K,).
    counts
        What was counted.

    Returns
    -------
    pandas.DataFrame
        ``when`` (before, after), median and intervals of the rate, the ``expected`` number of counted
        crashes, the ``counted`` one, and the ``effective`` number of values.

    Raises
    ------
    StudyError
        If the counts contradict the prediction, or leave fewer than `FEWEST` effective values.
    """
    bounds = np.broadcast_to(rates, (2, reported.size))
    chance = counts.mid_p(*bounds * reported)
    with np.errstate(invalid="ignore"):  # lower bounds that are all 0 do not explain any crash, and stay 0
        weights = [counts.weights(each * reported) for each in bounds]
    effective = float(effective_number(weights[1]))
    expected = float((bounds[0] * reported).mean() * counts.exposure[-1])
    if chance < CONTRADICTED or effective < FEWEST:
        raise StudyError(
            f"the counts contradict the prediction: {counts.events[-1]:g} crashes were counted and "
            f"{expected:.3g} were expected (mid-p value {chance:.1g}; {effective:.0f} of {reported.size:,} "
            "values of the rate remain effective). The prediction is not updated, because none of its values "
            "explains the counts. Check the law, lead motion, the role of the vehicle, and the share of the "
            "crashes that is reported"
        )
    rows = []
    after = [each[resampled(each, own)] for each, own in zip(bounds, weights, strict=True)]
    for when, values, size in (("before", bounds, reported.size), ("after", after, effective)):
        row = {"when": when} | summarise_bounds(*values)
        rows.append(row | {"expected": expected, "counted": counts.events[-1], "effective": size})
    return pd.DataFrame(rows)
