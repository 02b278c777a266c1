"""Kilometres in service: what counted crashes say about the predicted rate, and whether there are too many.

Let r_k be equally likely values of the predicted rate of crashes, of which a share that is known within
limits is counted: N crashes in T kilometres. The values are weighted by their Poisson likelihood. The test
compares the prediction with the alternative that all rates are higher by a factor 1 + g, where g has an
exponential distribution with mean 1. The ratio of the marginal likelihoods of the counts is an e-process: if
the prediction is right, it ever exceeds 1 / alpha with a probability of at most alpha (Ville's inequality;
Ramdas and others 2023, Statistical Science 38, 576-601). It may therefore be inspected any number of times.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from fewruns.weights import effective_number
from scipy.special import gammaln, logsumexp, xlogy
from scipy.stats import gamma, poisson

from accelerated_evaluation.answer.posterior import Posterior, summarise
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import StudyError

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

    def mid_p(self, rates: Array) -> float:
        """Return the two-sided mid-p value of the last count if the prediction is right."""
        means, count = rates * self.exposure[-1], self.events[-1]
        at = poisson.pmf(count, means).mean() / 2
        below, above = poisson.cdf(count - 1, means).mean(), poisson.sf(count, means).mean()
        return float(min(1.0, 2 * min(below + at, above + at)))


def log_mean_ratio(events: Array, expected: Array) -> Array:
    """Return log E[(1 + g)^N exp(-g m)] for N events, m expected ones, and g exponential with mean 1.

    With c = m + 1, the mean is exp(c) c^-(N + 1) Gamma(N + 1, c), an upper incomplete gamma function.
    """
    c = expected + 1
    tail = gamma.logsf(c, events + 1)
    exact = c - (events + 1) * np.log(c) + gammaln(events + 1) + tail
    # Where the tail has no logarithm, c is so much larger than N that the first term of its series is enough.
    return np.where(np.isfinite(tail), exact, -np.log(np.maximum(c - events, 1.0)))


def in_service_table(rates: Array, reported: Array, counts: InService) -> pd.DataFrame:
    """Return the rate before and after the counts, one row each.

    Parameters
    ----------
    rates
        Equally likely values of the predicted rate of crashes, shape (K,).
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
    counted = rates * reported
    weights, chance = counts.weights(counted), counts.mid_p(counted)
    effective = float(effective_number(weights))
    expected = float(counted.mean() * counts.exposure[-1])
    if chance < CONTRADICTED or effective < FEWEST:
        raise StudyError(
            f"the counts contradict the prediction: {counts.events[-1]:g} crashes were counted and "
            f"{expected:.3g} were expected (mid-p value {chance:.1g}; {effective:.0f} of {len(rates):,} "
            "values of the rate remain effective). The prediction is not updated, because none of its values "
            "explains the counts; check the law, lead motion, the role of the vehicle, and --reported"
        )
    order = np.argsort(rates)
    levels = (np.arange(len(rates)) + 0.5) / len(rates)
    place = np.searchsorted(np.cumsum(weights[order]), levels).clip(max=len(rates) - 1)
    rows = []
    for when, values, size in (("before", rates, len(rates)), ("after", rates[order][place], effective)):
        row = summarise(Posterior(values, np.zeros(len(values), dtype=int)))
        rows.append(
            {"when": when} | row | {"expected": expected, "counted": counts.events[-1], "effective": size}
        )
    return pd.DataFrame(rows)
