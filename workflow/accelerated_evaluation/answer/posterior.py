"""The crash probability with all that is not known of it: which law, and what the records leave open."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.laws.smooth.family import LawFamily, Member

LEVELS = (0.5, 0.8, 0.95)


@dataclass(frozen=True)
class Posterior:
    """Draws of the probability of an event, and the law that each was drawn from.

    Attributes
    ----------
    probabilities
        Shape (draws,).
    member
        Place of the law among the members, shape (draws,).
    """

    probabilities: Array
    member: NDArray[np.int_]

    @property
    def probability(self) -> float:
        """The answer: the median of the draws."""
        return float(np.median(self.probabilities))

    def interval(self, level: float) -> tuple[float, float]:
        """Return the interval between the quantiles that leave equal parts outside."""
        low, high = np.quantile(self.probabilities, [(1 - level) / 2, (1 + level) / 2])
        return float(low), float(high)


def draw_posterior(
    lines: Mapping[str, CrashLines],
    family: LawFamily,
    members: tuple[Member, ...],
    weights: Array,
    generator: np.random.Generator,
) -> dict[str, Posterior]:
    """Draw a law by its weights, then the parameters of tail, body and ranges; weigh the maps.

    Parameters
    ----------
    lines
        By event: the map of a vehicle, thinned. All events share the draws.
    family
        Fit to all records.
    members
        Laws that are weighed.
    weights
        Shape (draws, members), rows adding up to 1.
    generator
        Draws everything.
    """
    ends = np.cumsum(weights, axis=1)
    chosen = np.minimum((generator.random((len(weights), 1)) > ends).sum(axis=1), len(members) - 1)
    probabilities = {event: np.empty(len(weights)) for event in lines}
    for draw, place in enumerate(chosen):
        ranges = family.ranges.drawn(generator)
        law = family.law(members[place]).drawn(generator)
        for event, of_event in lines.items():
            probabilities[event][draw] = of_event.probability(ranges, law)
    return {event: Posterior(values, chosen) for event, values in probabilities.items()}


def budget(posterior: Posterior, sampling_deviation: float) -> pd.DataFrame:
    """Split the variance of the logarithm of a probability by source.

    Parameters
    ----------
    posterior
        Draws of the probability.
    sampling_deviation
        Relative standard deviation of the estimator that would find the probability by simulation.

    Returns
    -------
    pandas.DataFrame
        Columns ``source``, ``factor`` (one standard deviation, as a factor) and ``variance_share``.
        ``data`` is the mean variance of the draws of one law, ``choice of law`` the variance between the
        means of the laws.
    """
    with np.errstate(divide="ignore"):
        logs = pd.Series(np.log(posterior.probabilities))
    if not np.isfinite(logs).all():  # the event never happens, so nothing is uncertain
        names = ["data", "choice of law", "sampling", "together"]
        return pd.DataFrame({"source": names, "factor": 1.0, "variance_share": np.nan})
    groups = logs.groupby(posterior.member)
    means, counts = groups.transform("mean"), groups.transform("size")
    within = float((logs - means).pow(2).mean() * counts.mean() / max(counts.mean() - 1, 1))
    variances = {
        "data": within,
        "choice of law": max(float(logs.var()) - within, 0.0),
        "sampling": float(np.log1p(sampling_deviation**2)),
    }
    total = sum(variances.values())
    rows = [(name, float(np.exp(np.sqrt(value))), value / total) for name, value in variances.items()]
    rows.append(("together", float(np.exp(np.sqrt(total))), 1.0))
    return pd.DataFrame(rows, columns=["source", "factor", "variance_share"])
