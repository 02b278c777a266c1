"""Posterior of the crash probability, with the uncertainty in the choice of the law and in its parameters."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.laws.smooth.conditional import SpeedLaw
from accelerated_evaluation.laws.smooth.family import LawFamily, Member
from accelerated_evaluation.laws.smooth.smooth_hazard import SmoothHazard

LEVELS = (0.5, 0.8, 0.95)
LEAST_BETWEEN = 0.25  # share of the variance of the estimates that their own errors cannot explain


@dataclass(frozen=True)
class Posterior:
    """Draws of the probability of an event, with the law from which each was drawn.

    Attributes
    ----------
    probabilities
        The draws, shape (draws,).
    member
        Index of the law among the members, shape (draws,).
    expected
        Expected value of each risk in an encounter, shape (draws, risks); None if no risks were given.
    """

    probabilities: Array
    member: NDArray[np.int_]
    expected: Array | None = None

    @property
    def probability(self) -> float:
        """The median of the draws."""
        return float(np.median(self.probabilities))

    def interval(self, level: float) -> tuple[float, float]:
        """Return the equal-tailed credible interval of a given level."""
        low, high = np.quantile(self.probabilities, [(1 - level) / 2, (1 + level) / 2])
        return float(low), float(high)


def draw_posterior(
    lines: Mapping[str, CrashLines],
    family: LawFamily,
    members: tuple[Member, ...],
    weights: Array,
    generator: np.random.Generator,
    risks: Mapping[str, Array] = MappingProxyType({}),
) -> dict[str, Posterior]:
    """Draw laws with their weights and parameters from their posteriors, and compute event probabilities.

    Parameters
    ----------
    lines
        Thinned crash map of a vehicle, by event. All events use the same draws. If the lines have weights,
        each draw of the law is combined with a draw of the uncertain parameters of the vehicle.
    family
        The family fitted to all records.
    members
        The laws that have weights.
    weights
        Draws of the weights, shape (draws, members), with rows that sum to 1.
    generator
        Source of all randomness.
    risks
        Risks in each interval of some events, shape (risks, intervals), such as the risk of an injury.
    """
    probabilities = {event: np.empty(len(weights)) for event in lines}
    expected = {event: np.empty((len(weights), len(of_event))) for event, of_event in risks.items()}
    chosen = np.empty(len(weights), dtype=int)
    for draw, (place, ranges, law) in enumerate(drawn_laws(family, members, weights, generator)):
        chosen[draw] = place
        for event, of_event in lines.items():
            masses = of_event.of_draw(draw).masses(ranges, law)
            probabilities[event][draw] = masses.sum()
            if event in risks:
                expected[event][draw] = risks[event] @ masses
    return {event: Posterior(values, chosen, expected.get(event)) for event, values in probabilities.items()}


def drawn_laws(
    family: LawFamily, members: tuple[Member, ...], weights: Array, generator: np.random.Generator
) -> Iterator[tuple[int, SmoothHazard, SpeedLaw]]:
    """Draw laws with their weights, and their parameters from their posteriors.

    The parameters are those of `draw_posterior`. Yields the index of the member, the distribution of the
    range and that of the closing speed.
    """
    ends = np.cumsum(weights, axis=1)
    chosen = np.minimum((generator.random((len(weights), 1)) > ends).sum(axis=1), len(members) - 1)
    for place in chosen.tolist():
        yield place, family.ranges.drawn(generator), family.law(members[place]).drawn(generator)


def budget(posterior: Posterior, sampling_deviation: float) -> pd.DataFrame:
    """Divide the variance of the logarithm of a probability among its sources.

    Parameters
    ----------
    posterior
        Draws of the probability.
    sampling_deviation
        Relative standard deviation of an estimator of the probability.

    Returns
    -------
    pandas.DataFrame
        Columns ``source``, ``factor`` (one standard deviation, as a factor) and ``variance_share``. ``data``
        is the mean variance of the draws within a law, ``choice of law`` the variance between the means of
        the laws.
    """
    variances = log_variances(posterior) | {"sampling": float(np.log1p(sampling_deviation**2))}
    return shares(variances)


def log_variances(posterior: Posterior) -> dict[str, float]:
    """Return the variance of the logarithm of a probability from the data and from the choice of the law.

    Both are NaN if a draw of the probability is zero.
    """
    with np.errstate(divide="ignore"):
        logs = pd.Series(np.log(posterior.probabilities))
    if not np.isfinite(logs).all():
        return {"data": np.nan, "choice of law": np.nan}
    groups = logs.groupby(posterior.member)
    means, counts = groups.transform("mean"), groups.transform("size")
    within = float((logs - means).pow(2).mean() * counts.mean() / max(counts.mean() - 1, 1))
    return {"data": within, "choice of law": max(float(logs.var()) - within, 0.0)}


def shares(variances: Mapping[str, float]) -> pd.DataFrame:
    """Tabulate independent variances of a logarithm by source, as `budget` does.

    If one of them is NaN, the event never happens and nothing is uncertain. All factors are then 1, and no
    share is known.
    """
    total = sum(variances.values())
    if np.isnan(total):
        names = [*variances, "together"]
        return pd.DataFrame({"source": names, "factor": 1.0, "variance_share": np.nan})
    rows = [(name, float(np.exp(np.sqrt(value))), value / total) for name, value in variances.items()]
    rows.append(("together", float(np.exp(np.sqrt(total))), 1.0))
    return pd.DataFrame(rows, columns=["source", "factor", "variance_share"])


def without_scatter(estimates: Array, own: Array) -> Array:
    """Draw estimates towards their median, so that their scatter is that of the probabilities.

    The own errors e_k explain the mean of e_k^2 of the variance of the logarithms of the estimates. The rest,
    A, is the variance of the probabilities. The distance of each logarithm from the median is multiplied by
    sqrt(A / (A + e_k^2)). This is a constrained empirical Bayes estimate (Louis 1984) for draws that are
    normal around the median. A draw whose error is far larger than its estimate is not known, and gets almost
    the median. In the mean of e_k^2 such errors count as 1, the error of an estimate of zero.

    Parameters
    ----------
    estimates
        Positive, shape (K,).
    own
        Relative error of each that it does not share with the others, shape (K,).
    """
    logs = np.log(estimates)
    middle, variance = np.median(logs), logs.var()
    if variance == 0:
        return estimates
    between = max(variance - np.minimum(own**2, 1.0).mean(), LEAST_BETWEEN * variance)
    return np.exp(middle + np.sqrt(between / (between + own**2)) * (logs - middle))
