"""Checks of an experiment by importance sampling, for wrong weights and for parts that the proposal missed.

An experiment reports a probability with a standard error. The error comes from the rows that were drawn, so
it says nothing about a region from which no row came. Two checks need no further simulation. The weights
f / f* have the mean 1, so their mean shows whether the densities are right, and whether f* covers f. The
weights of a control region have its probability under f as their mean, which is known from draws of f, or
from the records. A third check needs simulations: the events of a few crude runs are compared with what the
experiment expects, in all and in each region.
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

QUANTILES = (0.0, 0.02, 0.05, 0.1, 0.25, 0.5, 0.75, 0.9, 0.95, 0.98, 1.0)  # that bound control regions
LEVEL = 0.01  # of a test that warns, divided by the number of regions
SMALLEST = 1e-300
MOST_RUNS = 1e6  # crude runs
FEWEST_EFFECTIVE = 30.0  # events of equal weight; with fewer, the standard error itself is unreliable


@dataclass(frozen=True)
class Experiment:
    """Rows of an experiment by importance sampling.

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
        """Return the estimate with the checks that need nothing but the weights.

        Returns
        -------
        dict
            ``simulations``, ``events``; ``probability`` and its standard ``error``; ``low95`` and ``high95``,
            the gamma interval; ``converged``, whether the paper's stopping rule is satisfied; ``effective``
            and ``effective_events``, effective sample sizes (Kish 1965) of all rows and of the events;
            ``largest_share``, the share of the largest weight in the sum of those of the events;
            ``mean_weight``, its standard error ``mean_weight_error``, and ``mean_weight_p``, the p-value of
            the mean 1.
        """
        stopping = Stopping() if stopping is None else stopping
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
        """Compare the probability of regions by the weights with their share among points that follow f.

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
            A row for each interval between quantiles of a variable: ``variable``, ``low``, ``high``,
            ``share`` among the reference, ``weighted``, the probability by the weights, the standard
            ``error`` of their difference, and its ``p``-value.
        """
        return self._regions(self.weight, reference, np.ones(len(reference), bool), names)

    def event_regions(
        self, reference: Array, happened: NDArray[np.bool_], names: Sequence[str]
    ) -> pd.DataFrame:
        """Compare where the probability of the event lies with the events of crude runs.

        Parameters
        ----------
        reference, happened
            Encounters drawn from f, shape (m, d), and whether the event happened in their runs, shape (m,).
        names
            Names of the variables.

        Returns
        -------
        pandas.DataFrame
            As `control_regions`, with the probability of the event within the region in place of that of the
            region.
        """
        return self._regions(np.where(self.happened, self.weight, 0.0), reference, happened, names)

    def crude_check(self, runs: int, events: int) -> float:
        """Return the mid-p of the number of events in crude runs, which the experiment should predict."""
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
                # Half an event is added, because the error of no event at all is not 0.
                spread = (share + 0.5 / m) * (1 - share)
                error = float(np.sqrt(part.var() / len(part) + spread / m))
                p = p_value(float(part.mean()) - share, error)
                rows.append((name, low, high, share, float(part.mean()), error, p))
        return pd.DataFrame(rows, columns=["variable", "low", "high", "share", "weighted", "error", "p"])


def p_value(difference: float, error: float) -> float:
    """Return the two-sided p-value of a difference with a given standard error; 1 if there is none."""
    return float(2 * norm.sf(abs(difference) / max(error, SMALLEST)))


def crude_runs_needed(estimated: float, true: float) -> float:
    """Return how many crude runs show that an estimate is wrong, if they have the expected number of events.

    The mid-p of this number is then below `LEVEL`; the number of runs is rounded up to two digits, and is
    infinite if even `MOST_RUNS` would not show it.
    """
    runs = np.round(np.geomspace(100, MOST_RUNS, 500), -1)
    shows = mid_p(np.round(runs * true).astype(int), runs * estimated) < LEVEL
    return float(runs[shows.argmax()]) if shows.any() else float("inf")


def weight_table(
    experiments: Mapping[str, Experiment], reference: Array, names: Sequence[str]
) -> pd.DataFrame:
    """Tabulate experiments with their checks; see `Experiment.row`.

    The further columns are those of the control region with the smallest p-value: ``region``, its ``share``
    among the reference, ``weighted`` and ``region_p``, multiplied by the number of regions (Bonferroni). The
    columns ``warns_events``, ``warns_mean`` and ``warns_region`` say which check warns: too few effective
    events, a mean weight that is not 1, and a control region whose probability is wrong.
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
