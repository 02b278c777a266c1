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

LEVELS = (0.5, 0.8, 0.95)  # levels of the credible intervals
# Smallest share of the variance of the logarithms of the estimates that is attributed to the probabilities.
LEAST_BETWEEN = 0.25


@dataclass(frozen=True)
class Posterior:
    """Draws of the probability of an event, with the law from which each was drawn.

    Attributes
    ----------
    probabilities
        The draws, shape (draws,).
    member
        Index of the law of each draw among the members of the family, shape (draws,).
    expected
        Expected value of each risk in an encounter, such as the risk of an injury, shape (draws, risks); None
        if no risks were given.
    """

    probabilities: Array
    member: NDArray[np.int_]
    expected: Array | None = None

    @property
    def probability(self) -> float:
        """Median of the draws of the probability."""
        return float(np.median(self.probabilities))

    def interval(self, level: float) -> tuple[float, float]:
        """Return the lower and upper end of the equal-tailed credible interval of the probability.

        Parameters
        ----------
        level
            Probability that the interval contains, between 0 and 1.
        """
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
    """Draw laws and their parameters from their posterior, and compute event probabilities under them.

    Parameters
    ----------
    lines
        Lines of a crash map, by event: a random selection of pairs of lead speed and range, with the
        intervals of closing speed in which the event happens. All events use the same draws. If the lines
        have weights, each draw of the law is combined with a draw of the uncertain parameters of the vehicle.
    family
        The family fitted to all records.
    members
        The laws that have weights.
    weights
        Draws of the weights, shape (draws, members), with rows that sum to 1.
    generator
        Source of all randomness.
    risks
        Risks in each interval of the lines, such as the risk of an injury, shape (risks, intervals), for some
        of the events.

    Returns
    -------
    dict
        The posterior of the probability of each event, by event.
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
    """Draw members of a family by their weights, and the parameters of each from their posterior.

    Parameters
    ----------
    family, members
        The family fitted to all records, and those of its laws that have weights.
    weights
        Draws of the weights, shape (draws, members), with rows that sum to 1.
    generator
        Source of all randomness.

    Yields
    ------
    tuple
        For each draw: the index of the member, the distribution of the range given the lead speed, and the
        distribution of the closing speed given the lead speed and the range.
    """
    ends = np.cumsum(weights, axis=1)
    chosen = np.minimum((generator.random((len(weights), 1)) > ends).sum(axis=1), len(members) - 1)
    for place in chosen.tolist():
        yield place, family.ranges.drawn(generator), family.drawn(members[place], generator)


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
        One row for each ``source``: ``data`` (mean variance of the draws within a law), ``choice of law``
        (variance between the means of the laws), ``sampling``, and ``together``. The columns are ``factor``,
        exp(standard deviation of the logarithm), and ``variance_share``.
    """
    variances = log_variances(posterior) | {"sampling": float(np.log1p(sampling_deviation**2))}
    return shares(variances)


def log_variances(posterior: Posterior) -> dict[str, float]:
    """Divide the variance of log(probability) into two parts, ``data`` and ``choice of law``.

    ``data`` is the variance among the draws of the same law, averaged over the laws. ``choice of law`` is the
    rest of the variance. Both parts are NaN if the probability is 0 in a draw.

    Parameters
    ----------
    posterior
        Draws of the probability, and the law to which each draw belongs.

    Returns
    -------
    dict
        The two variances, by source.
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
    """Tabulate the variances of a logarithm by source, with their shares of the total variance.

    If a variance is NaN, the event does not happen under some draw, so its logarithm has no variance. All
    factors are then 1, and all shares NaN.

    Parameters
    ----------
    variances
        Variances of independent contributions to the logarithm, by source.

    Returns
    -------
    pandas.DataFrame
        One row for each source and one for all ``together``: ``source``; ``factor``, exp(standard deviation);
        and ``variance_share``.
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
    replaced by the median; in the mean of e_k^2 an error above 1 counts as 1.

    Parameters
    ----------
    estimates
        Positive estimates of the probabilities, shape (K,).
    own
        Relative error of each estimate, without the error that all estimates share, shape (K,).

    Returns
    -------
    numpy.ndarray
        The shrunk estimates, shape (K,).
    """
    logs = np.log(estimates)
    middle, variance = np.median(logs), logs.var()
    if variance == 0:
        return estimates
    between = max(variance - np.minimum(own**2, 1.0).mean(), LEAST_BETWEEN * variance)
    return np.exp(middle + np.sqrt(between / (between + own**2)) * (logs - middle))
