"""From the probability of a cut-in to rates per kilometre and hour, with what is not known of both factors.

The cut-ins that were recorded in a known distance or time are taken for Poisson. With Jeffreys' prior their
rate has a gamma posterior, which is independent of the probability that a cut-in ends in a crash: that
depends on what the cut-ins are like, and not on how many come. The crash rate is the product of the two.
Its distribution function is an average of gamma distribution functions over the draws of the probability,
so no further sampling is needed.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.optimize import brentq
from scipy.stats import gamma

from accelerated_evaluation.answer.posterior import LEVELS, Posterior
from accelerated_evaluation.base.arrays import Array

UNITS = {"kilometres": "kilometre", "hours": "hour"}
JEFFREYS = 0.5  # added to the count
CUT_IN = "cut-in"
TINY = 1e-9  # probability that lies beyond the bracket of a quantile


@dataclass(frozen=True)
class Rate:
    """Posterior of the rate of an event that is counted, Gamma(count + 1/2, exposure).

    Attributes
    ----------
    count
        Number of events.
    exposure
        Distance [km] or time [h] in which they were counted.
    """

    count: int
    exposure: float

    @property
    def law(self) -> gamma:
        """The posterior."""
        return gamma(self.count + JEFFREYS, scale=1 / self.exposure)

    def mean(self, probabilities: Array) -> float:
        """Return the mean rate of what happens in a share of the events; its draws have shape (n,)."""
        return float(self.law.mean() * probabilities.mean())

    def quantile(self, level: float, probabilities: Array) -> float:
        """Return a quantile of the rate of what happens in a share of the events.

        With p_i the draws of the share and G the distribution function of the posterior, it is the root x of
        mean G(x / p_i) = level; a draw of zero counts as a rate of zero.

        Parameters
        ----------
        level
            Between 0 and 1.
        probabilities
            Draws of the share, shape (n,).
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

    def summary(self, probabilities: Array) -> dict[str, float]:
        """Return the columns ``mean``, ``median``, and the ends ``low50`` to ``high95`` of intervals."""
        row = {"mean": self.mean(probabilities), "median": self.quantile(0.5, probabilities)}
        for level in LEVELS:
            for end, at in (("low", (1 - level) / 2), ("high", (1 + level) / 2)):
                row[f"{end}{100 * level:.0f}"] = self.quantile(at, probabilities)
        return row


def exposure_table(
    posteriors: Mapping[str, Posterior], cut_ins: int, exposure: Mapping[str, float | None]
) -> pd.DataFrame:
    """Tabulate the rates of cut-ins and of events, per kilometre and per hour, as far as these are known.

    Parameters
    ----------
    posteriors
        Draws of the probability of an event of a cut-in, by event.
    cut_ins
        Number of distinct closing cut-ins within the limits.
    exposure
        ``kilometres`` and ``hours`` in which they were recorded; None where it is not known.

    Returns
    -------
    pandas.DataFrame
        Columns ``event``, ``per`` (kilometre or hour), and those of `Rate.summary` [1/km or 1/h]; the event
        ``cut-in`` is the rate of the cut-ins themselves. No row where nothing is known.
    """
    rows = []
    for key, unit in UNITS.items():
        if (size := exposure.get(key)) is None:
            continue
        rate = Rate(cut_ins, size)
        draws = {CUT_IN: np.ones(1)} | {event: own.probabilities for event, own in posteriors.items()}
        rows += [{"event": event, "per": unit} | rate.summary(values) for event, values in draws.items()]
    return pd.DataFrame(rows, columns=["event", "per", *Rate(1, 1.0).summary(np.ones(1))])
