"""Rates of events per kilometre and per hour, which follow from the probability of an event."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
import scipy
from scipy.optimize import brentq

from accelerated_evaluation.answer.ways.posterior import LEVELS, Posterior
from accelerated_evaluation.base.arrays import Array

UNITS = {"kilometres": "kilometre", "hours": "hour"}
JEFFREYS = 0.5  # added to the count, from Jeffreys' prior
CUT_IN = "cut-in"
EVERY = Posterior(np.ones(1), np.zeros(1, int))  # probability of a cut-in in a cut-in
TINY = 1e-9  # tail probability outside the interval in which a quantile is searched


@dataclass(frozen=True)
class Rate:
    """Posterior distribution of the rate of an event, Gamma(count + 1/2, exposure)."""

    count: int
    exposure: float  # distance [km] or time [h] in which the events were observed

    @property
    def law(self) -> "scipy.stats.gamma":
        """The posterior distribution of the rate [1/km or 1/h], as a frozen SciPy distribution."""
        return scipy.stats.gamma(self.count + JEFFREYS, scale=1 / self.exposure)

    def mean(self, probabilities: Array) -> float:
        """Return the posterior mean of the rate of a sub-event, whose probability has the given draws."""
        return float(self.law.mean() * probabilities.mean())

    def quantile(self, level: float, probabilities: Array) -> float:
        """Return a posterior quantile of the rate of a sub-event, such as the crashes among the cut-ins.

        Let p_i be the draws of the probability of the sub-event, and G the posterior distribution function of
        the rate of the event. The quantile is the root x of mean_i G(x / p_i) = level. A draw p_i = 0 stands
        for a rate of 0.
        """
        law, positive = self.law, probabilities[probabilities > 0]
        zero = 1 - positive.size / probabilities.size
        if level <= zero:
            return 0.0
        ends = law.ppf([TINY, 1 - TINY]) * [positive.min(), positive.max()]

        def excess(log_rate: float) -> float:
            below = law.cdf(np.exp(log_rate) / positive).sum() / probabilities.size
            return float(zero + below - level)

        return float(np.exp(brentq(excess, *np.log(ends), xtol=1e-12)))

    def summary(self, posterior: Posterior) -> dict[str, float]:
        """Return mean, median and interval ends ``low50`` to ``high95`` of the rate of an event.

        ``posterior`` is its probability in an encounter, such as that of a crash in a cut-in. Unknown draws
        count as 0 for the lower ends.
        """
        known, row = posterior.probabilities, dict.fromkeys(("mean", "median"), np.nan)
        if not np.isnan(posterior.probability):
            row = {"mean": self.mean(known), "median": self.quantile(0.5, known)}
        for level in LEVELS:
            row[f"low{100 * level:.0f}"] = self.quantile((1 - level) / 2, posterior.least)
            row[f"high{100 * level:.0f}"] = self.quantile((1 + level) / 2, known)
        return row


def exposure_table(
    posteriors: Mapping[str, Posterior], cut_ins: int, exposure: Mapping[str, float | None]
) -> pd.DataFrame:
    """Tabulate the rates of cut-ins and of events [1/km and 1/h], if the exposure is known.

    The columns are ``event``, ``per``, ``mean``, ``median`` and interval ends; the event ``cut-in`` is the
    rate of the cut-ins themselves.
    """
    rows = []
    for key, unit in UNITS.items():
        if (size := exposure.get(key)) is None:
            continue
        rate = Rate(cut_ins, size)
        rows += [
            {"event": event, "per": unit} | rate.summary(own)
            for event, own in {CUT_IN: EVERY, **posteriors}.items()
        ]
    return pd.DataFrame(rows, columns=["event", "per", *Rate(1, 1.0).summary(EVERY)])
