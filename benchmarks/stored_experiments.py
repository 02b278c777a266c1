"""Checks of the authors' stored experiments: wrong weights, and parts that the proposal missed.

The mean of all weights estimates 1, and the weights of the simulations in a region (a control region)
estimate its probability under the law f. Both can be compared with records that follow f, without more
simulations. The stored weights are half of the right ones, so each experiment is checked as it was stored,
and with doubled weights. ``data/stored_experiments/README.md`` describes the files.

    python benchmarks/stored_experiments.py benchmarks/results/stored_experiments.csv
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
from accelerated_evaluation.answer.calibration import mid_p
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.methods import Stopping
from accelerated_evaluation.methods.intervals import Sums, gamma_interval
from accelerated_evaluation.scenarios import SCENARIOS
from accelerated_evaluation.scenarios.record_table import read_scenario_records
from numpy.typing import NDArray
from scipy.stats import norm

ROOT = Path(__file__).resolve().parents[1]
PUBLISHED = ROOT / "data/stored_experiments/published.csv"  # results of the complete experiments
NAMES = ("left_turn", "pedestrian")  # scenarios with stored experiments
IN_FIT = "in_fit"  # column of records that marks those to which the authors fitted their law
RIGHT = 2.0  # the right weight divided by the stored one
QUANTILES = (0.0, 0.02, 0.05, 0.1, 0.25, 0.5, 0.75, 0.9, 0.95, 0.98, 1.0)  # levels that bound control regions
LEVEL = 0.01  # significance level of the checks, with a Bonferroni correction for the number of regions
SMALLEST = 1e-300  # replaces a standard error of 0
MOST_RUNS = 1e6  # largest number of crude simulations that is considered
FEWEST_EFFECTIVE = 30.0  # with fewer effective events, the standard error itself is unreliable


@dataclass(frozen=True)
class Experiment:
    """The n simulations of an experiment by importance sampling."""

    x: Array  # encounters, shape (n, d)
    weight: Array  # importance weights f / f*, shape (n,)
    happened: NDArray[np.bool_]  # whether the event happened, shape (n,)

    def row(self) -> dict[str, float | int | bool]:
        """Return the estimate, with the checks that need only the weights."""
        stopping, events = Stopping(minimum_events=100), np.where(self.happened, self.weight, 0.0)
        sums, all_rows = Sums.of(events), Sums.of(self.weight)
        low, high = gamma_interval(sums, stopping.alpha)
        error, n = self.weight.std() / np.sqrt(len(self.weight)), len(self.weight)
        ends = gamma_interval(sums, 0.05)
        is_narrow = (high - low) / 2 <= stopping.beta * sums.probability
        mean_p = p_value(all_rows.probability - 1, error)
        effective = sums.total**2 / sums.squares if sums.events else 0.0
        return {
            "simulations": n,
            "events": sums.events,
            "probability": sums.probability,
            "error": float(events.std() / np.sqrt(n)),
            "low95": ends.low,
            "high95": ends.high,
            "converged": bool(is_narrow and sums.events >= stopping.minimum_events),
            "effective_events": effective,
            "mean_weight": all_rows.probability,
            "mean_weight_error": float(error),
            "warns_events": effective < FEWEST_EFFECTIVE,
            "warns_mean": mean_p < LEVEL,
        }

    def control_regions(self, reference: Array, names: Sequence[str]) -> pd.DataFrame:
        """Compare the probabilities of regions by the weights with their shares among m points that follow f.

        The ``reference``, shape (m, d), are draws or records. There is a row for each interval between
        quantiles of a variable: ``share`` of the points, probability by the weights ``weighted``, standard
        ``error`` of their difference, and its p-value ``p``.
        """
        rows, m = [], len(reference)
        for j, name in enumerate(names):
            edges = np.unique(np.quantile(reference[:, j], QUANTILES))
            edges[[0, -1]] = -np.inf, np.inf
            for low, high in pairwise(edges.tolist()):
                share = float(np.mean((reference[:, j] >= low) & (reference[:, j] < high)))
                part = np.where((self.x[:, j] >= low) & (self.x[:, j] < high), self.weight, 0.0)
                # Half a point is added, because the standard error is not 0 if there is no point.
                spread = (share + 0.5 / m) * (1 - share)
                error = float(np.sqrt(part.var() / len(part) + spread / m))
                p = p_value(float(part.mean()) - share, error)
                rows.append((name, low, high, share, float(part.mean()), error, p))
        return pd.DataFrame(rows, columns=["variable", "low", "high", "share", "weighted", "error", "p"])

    def checked(self, reference: Array, names: Sequence[str]) -> dict[str, float | int | bool | str]:
        """Return the estimate with all checks, and the control region with the smallest p-value."""
        regions = self.control_regions(reference, names)
        worst = regions.loc[regions["p"].idxmin()]
        return self.row() | {
            "region": f"{worst['variable']} from {worst['low']:.3g} to {worst['high']:.3g}",
            "share": worst["share"],
            "weighted": worst["weighted"],
            "warns_region": float(worst["p"]) * len(regions) < LEVEL,
        }


def p_value(difference: float, error: float) -> float:
    """Return the two-sided p-value of a normal difference with a given standard error."""
    return float(2 * norm.sf(abs(difference) / max(error, SMALLEST)))


def crude_runs_needed(estimated: float, true: float) -> float:
    """Return how many crude simulations show that an estimated probability is wrong; infinity if none do.

    The expected number of events under the ``true`` probability is then too unlikely under the estimated one.
    """
    runs = np.round(np.geomspace(100, MOST_RUNS, 500), -1)
    shows = mid_p(np.round(runs * true).astype(int), runs * estimated) < LEVEL
    return float(runs[shows.argmax()]) if shows.any() else float("inf")


def authors_records(name: str) -> Array:
    """Return the records of a scenario to which the authors fitted their law, shape (n, d)."""
    scenario = SCENARIOS[name]
    table = read_scenario_records(scenario)
    own = table[table[IN_FIT].astype(bool)] if IN_FIT in table else table
    return own[list(scenario.names)].to_numpy(float)


def read_experiments(name: str, factor: float = 1.0) -> dict[str, Experiment]:
    """Return the stored simulations of a scenario by experiment, with the weights times a factor."""
    scenario = SCENARIOS[name]
    rows = pd.read_csv(ROOT / scenario.verdicts).dropna(subset=["stored_weight"])
    return {
        experiment: Experiment(
            part[list(scenario.names)].to_numpy(float),
            factor * part["stored_weight"].to_numpy(float),
            part["crash"].to_numpy(bool),
        )
        for experiment, part in rows.groupby("source")
    }


def stored_experiments(name: str, records: Array) -> pd.DataFrame:
    """Tabulate the stored experiments of a scenario with the checks of their weights.

    ``probability``, ``error`` and ``effective_events`` are those of the complete experiment, and ``crude`` is
    the probability by crude Monte Carlo under the authors' law. ``errors_off`` is crude minus probability in
    standard errors, and ``crude_runs`` the number of crude simulations that would have shown the difference.
    """
    published, rows = pd.read_csv(PUBLISHED).query("scenario == @name").set_index("experiment"), []
    for weights, factor in (("as stored", 1.0), ("doubled", RIGHT)):
        for experiment, stored in read_experiments(name, factor).items():
            own = published.loc[experiment]
            crude, probability = own["crude_events"] / own["crude_simulations"], factor * own["probability"]
            whole = {
                "probability": probability,
                "error": factor * own["error"],
                "effective_events": own["effective_events"],
                "crude": crude,
                "errors_off": (crude - probability) / (factor * own["error"]),
                "crude_runs": crude_runs_needed(probability, crude),
            }
            known = {"scenario": name, "experiment": experiment, "weights": weights}
            rows.append(known | stored.checked(records, SCENARIOS[name].names) | whole)
    return pd.DataFrame(rows)


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("output", type=Path, help="where to write the table")
    arguments = parser.parse_args()
    tables = [stored_experiments(name, authors_records(name)) for name in NAMES]
    write_csv(arguments.output, pd.concat(tables, ignore_index=True))


if __name__ == "__main__":
    main()
