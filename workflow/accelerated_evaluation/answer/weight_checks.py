"""Checks of an experiment by importance sampling, for wrong weights and for parts that the proposal missed.

An experiment reports a probability with a standard error. The error is estimated from the points that were
drawn, so it contains no information about a region in which no point was drawn. Two checks need no further
simulation. First, the weights f / f* have the mean 1. Their mean therefore shows whether the densities are
correct, and whether f* covers f. Second, the mean of the weights in a control region is the probability of
the region under f, which is known from draws of f or from the records. A third check needs simulations: the
number of events in a few crude simulations is compared with the number that the experiment predicts, in total
and in each region.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.stats import norm

from accelerated_evaluation.answer.calibration import mid_p
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.methods.estimate import Stopping
from accelerated_evaluation.methods.intervals import Sums, gamma_interval

QUANTILES = (0.0, 0.02, 0.05, 0.1, 0.25, 0.5, 0.75, 0.9, 0.95, 0.98, 1.0)  # levels that bound control regions
LEVEL = 0.01  # significance level of the checks, with a Bonferroni correction for the number of regions
SMALLEST = 1e-300  # replaces a standard error of 0
MOST_RUNS = 1e6  # largest number of crude simulations that is considered
FEWEST_EFFECTIVE = 30.0  # with fewer effective events, the standard error itself is unreliable


@dataclass(frozen=True)
class Experiment:
    """The n simulations of an experiment by importance sampling.

    Attributes
    ----------
    x
        Encounters, shape (n, d).
    weight
        Importance weights f / f*, shape (n,).
    happened
        Whether the event happened, shape (n,).
    """

    x: Array
    weight: Array
    happened: NDArray[np.bool_]

    def row(self, stopping: Stopping | None = None) -> dict[str, float | int | bool]:
        """Return the estimate, with the checks that need only the weights.

        Parameters
        ----------
        stopping
            The stopping rule; by default the paper's.

        Returns
        -------
        dict
            ``simulations``, ``events``; ``probability`` and its standard ``error``; ``low95`` and ``high95``,
            the 95 % gamma interval; ``converged``, whether the stopping rule is satisfied; ``effective`` and
            ``effective_events``, effective sample sizes (Kish 1965) of all simulations and of the events;
            ``largest_share``, the largest weight of an event divided by the sum of the weights of all events;
            ``mean_weight``, its standard error ``mean_weight_error``, and ``mean_weight_p``, the p-value of
            the hypothesis that the mean is 1.
        """
        stopping = Stopping(minimum_events=100) if stopping is None else stopping
        n, events = len(self.weight), np.where(self.happened, self.weight, 0.0)
        sums, all_rows = Sums.of(events), Sums.of(self.weight)
        low, high = gamma_interval(sums, stopping.alpha)
        is_narrow = (high - low) / 2 <= stopping.beta * sums.probability
        error = self.weight.std() / np.sqrt(n)
        ends = gamma_interval(sums, 0.05)
        return {
            "simulations": n,
            "events": sums.events,
            "probability": sums.probability,
            "error": float(events.std() / np.sqrt(n)),
            "low95": ends.low,
            "high95": ends.high,
            "converged": bool(is_narrow and sums.events >= stopping.minimum_events),
            "effective": all_rows.total**2 / all_rows.squares,
            "effective_events": sums.total**2 / sums.squares if sums.events else 0.0,
            "largest_share": sums.largest / sums.total if sums.events else np.nan,
            "mean_weight": all_rows.probability,
            "mean_weight_error": float(error),
            "mean_weight_p": p_value(all_rows.probability - 1, error),
        }

    def control_regions(self, reference: Array, names: Sequence[str]) -> pd.DataFrame:
        """Compare the probabilities of regions by the weights with their shares among points that follow f.

        Parameters
        ----------
        reference
            Points that follow f: draws, which need no simulation, or the records to which f was fitted, shape
            (m, d).
        names
            Names of the variables.

        Returns
        -------
        pandas.DataFrame
            One row for each interval between quantiles of a variable: ``variable``; the ends ``low`` and
            ``high``; ``share``, the share of the reference points in the interval; ``weighted``, the
            probability of the interval by the weights; the standard ``error`` of their difference; and ``p``,
            the p-value of the difference.
        """
        return self._regions(self.weight, reference, np.ones(len(reference), bool), names)

    def event_regions(
        self, reference: Array, happened: NDArray[np.bool_], names: Sequence[str]
    ) -> pd.DataFrame:
        """Compare the probabilities of the event in regions with the events of crude simulations.

        Parameters
        ----------
        reference, happened
            Encounters drawn from f, shape (m, d), and whether the event happened in each, shape (m,).
        names
            Names of the variables.

        Returns
        -------
        pandas.DataFrame
            One row for each interval between quantiles of a variable: ``variable``; the ends ``low`` and
            ``high``; ``share`` and ``weighted``, the probability that an encounter is in the interval and
            ends in the event, by the crude simulations and by the weights; the standard ``error`` of their
            difference; and its p-value ``p``.
        """
        return self._regions(np.where(self.happened, self.weight, 0.0), reference, happened, names)

    def crude_check(self, runs: int, events: int) -> float:
        """Return the mid-p value of a number of events in crude simulations, given the experiment.

        The number of events is Poisson with the mean ``runs`` times the probability that the experiment
        estimates.

        Parameters
        ----------
        runs, events
            Number of crude simulations, and number of events in them.
        """
        return float(mid_p(events, runs * float(np.mean(np.where(self.happened, self.weight, 0.0)))))

    def _regions(
        self, weight: Array, reference: Array, counted: NDArray[np.bool_], names: Sequence[str]
    ) -> pd.DataFrame:
        """Compare weights with counts, in the intervals between quantiles of each variable."""
        rows, m = [], len(reference)
        for j, name in enumerate(names):
            edges = np.unique(np.quantile(reference[:, j], QUANTILES))
            edges[[0, -1]] = -np.inf, np.inf
            for low, high in pairwise(edges.tolist()):
                inside = (reference[:, j] >= low) & (reference[:, j] < high)
                share = float(np.mean(inside & counted))
                part = np.where((self.x[:, j] >= low) & (self.x[:, j] < high), weight, 0.0)
                # Half an event is added, because the standard error is not 0 if there is no event.
                spread = (share + 0.5 / m) * (1 - share)
                error = float(np.sqrt(part.var() / len(part) + spread / m))
                p = p_value(float(part.mean()) - share, error)
                rows.append((name, low, high, share, float(part.mean()), error, p))
        return pd.DataFrame(rows, columns=["variable", "low", "high", "share", "weighted", "error", "p"])


def p_value(difference: float, error: float) -> float:
    """Return the two-sided p-value of a normal difference with a given standard error."""
    return float(2 * norm.sf(abs(difference) / max(error, SMALLEST)))


def crude_runs_needed(estimated: float, true: float) -> float:
    """Return how many crude simulations would show that an estimated probability is wrong.

    It is the smallest number of a grid of numbers for which the expected number of events, rounded, has a
    mid-p value below `LEVEL` under the estimate. It is infinite if even `MOST_RUNS` would not be enough.

    Parameters
    ----------
    estimated, true
        The estimated and the true probability of the event.
    """
    runs = np.round(np.geomspace(100, MOST_RUNS, 500), -1)
    shows = mid_p(np.round(runs * true).astype(int), runs * estimated) < LEVEL
    return float(runs[shows.argmax()]) if shows.any() else float("inf")


def weight_table(
    experiments: Mapping[str, Experiment], reference: Array, names: Sequence[str]
) -> pd.DataFrame:
    """Tabulate experiments with their checks.

    Parameters
    ----------
    experiments
        The experiments by name.
    reference
        Points that follow f, shape (m, d): draws of f, or the records to which f was fitted.
    names
        Names of the variables.

    Returns
    -------
    pandas.DataFrame
        One row for each ``experiment``, with the columns of `Experiment.row`: the estimate with its error and
        interval, and effective sample sizes. Further columns describe the control region with the smallest
        p-value: its name ``region``, ``share`` and ``weighted`` as in `Experiment.control_regions`, and
        ``region_p``, the p-value times the number of regions (Bonferroni). ``warns_events``, ``warns_mean``
        and ``warns_region`` are true if there are too few effective events, if the mean weight differs from
        1, or if the probability of the control region is wrong.
    """
    rows = []
    for name, experiment in experiments.items():
        own, regions = experiment.row(), experiment.control_regions(reference, names)
        worst = regions.loc[regions["p"].idxmin()]
        p = min(1.0, float(worst["p"]) * len(regions))
        rows.append(
            {"experiment": name}
            | own
            | {
                "region": f"{worst['variable']} from {worst['low']:.3g} to {worst['high']:.3g}",
                "share": worst["share"],
                "weighted": worst["weighted"],
                "region_p": p,
                "warns_events": own["effective_events"] < FEWEST_EFFECTIVE,
                "warns_mean": own["mean_weight_p"] < LEVEL,
                "warns_region": p < LEVEL,
            }
        )
    return pd.DataFrame(rows)
