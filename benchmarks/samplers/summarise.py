"""Sum up the raw results: a row for each problem and method."""

import argparse
import json
import math
from pathlib import Path

import numpy as np
import pandas as pd
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.methods.importance_sampling import crude_simulations
from accelerated_evaluation.publishing.tables.display import reproducible
from methods import LEARNING, Target, methods_of
from problems import problems

COLUMNS = [
    *("problem", "method", "seeds", "calls_mean", "calls_p95", "cov", "bias", "failed"),
    *("coverage80", "coverage95", "claimed", "cov_se", "bias_se", "coverage80_se", "calls_mean_se"),
    *("error", "effective_calls", "reference", "reference_se"),
]
EXACT = 1e-3  # relative error below which a method is exact but for the accuracy of roots


def summary(runs: pd.DataFrame, reference: float) -> dict[str, float]:
    """Sum up the runs of one method on one problem.

    Parameters
    ----------
    runs
        A row a seed: ``probability``, ``ci_low``, ``ci_high``, ``ci95_low``, ``ci95_high``, ``calls``,
        ``converged``; NaN where the method broke down.

    Returns
    -------
    dict
        ``cov`` is the standard deviation over the seeds of estimate / reference, ``bias`` their mean less 1,
        and ``error`` the root of their mean squared difference from 1, all three of the seeds that gave a
        number. ``failed`` is the share of all seeds that gave none or zero, or one off by more than a factor
        of 2, and ``claimed`` which share of these said that they had converged; ``coverage80`` and
        ``coverage95`` the shares of all whose own interval holds the reference. ``effective_calls`` is what a
        method of this error needs for the target: calls (error / target)^2, or its calls if it is exact.
    """
    ratio = runs["probability"] / reference
    known = ratio.dropna()
    n, seeds = len(known), len(runs)
    cov = known.std() if n > 1 else math.nan
    error = math.sqrt(np.square(known - 1).mean()) if n else math.nan
    covered, covered_95 = (
        ((runs[f"{name}_low"] <= reference) & (reference <= runs[f"{name}_high"])).mean()
        for name in ("ci", "ci95")
    )
    calls, failed = runs["calls"].mean(), ~ratio.between(0.5, 2)
    return {
        "seeds": seeds,
        "calls_mean": calls,
        "calls_p95": runs["calls"].quantile(0.95),
        "cov": cov,
        "bias": known.mean() - 1,
        "failed": failed.mean(),
        "coverage80": covered,
        "coverage95": covered_95,
        "claimed": runs.loc[failed, "converged"].mean(),
        "cov_se": _error_of_deviation(known),
        "bias_se": cov / math.sqrt(n) if n else math.nan,
        "coverage80_se": math.sqrt(covered * (1 - covered) / seeds),
        "calls_mean_se": runs["calls"].std() / math.sqrt(seeds),
        "error": error,
        "effective_calls": calls * (error / Target().cov) ** 2 if error > EXACT else calls,
    }


def _error_of_deviation(values: pd.Series) -> float:
    """Return the standard error of a standard deviation, by the fourth moment: no law is assumed."""
    if len(values) < 2 or values.std() == 0:
        return math.nan
    square, fourth = ((values - values.mean()) ** power for power in (2, 4))
    return math.sqrt(max(fourth.mean() - square.mean() ** 2, 0.0) / len(values)) / (2 * values.std())


def crude_by_theory(reference: float) -> dict[str, float]:
    """Tell what crude Monte Carlo would need; it was not run."""
    target = Target()
    calls = crude_simulations(reference, target.alpha, target.beta)
    return {"seeds": 0, "calls_mean": calls, "cov": target.cov, "error": target.cov, "effective_calls": calls}


def table(runs: pd.DataFrame, references: dict[str, dict[str, float]]) -> pd.DataFrame:
    """Sum up all runs, in the order in which they come; crude Monte Carlo by theory where it was not run."""
    rows = []
    for name, of_problem in runs.groupby("problem", sort=False):
        probability, error = references[name]["probability"], references[name]["standard_error"]
        known = {"reference": probability, "reference_se": error}
        for method, of_method in of_problem.groupby("method", sort=False):
            rows.append({"problem": name, "method": method} | summary(of_method, probability) | known)
            if method in LEARNING:  # predictions alone do not improve with the calls
                rows[-1]["effective_calls"] = math.nan
        if "crude" not in set(of_problem["method"]):
            rows.append({"problem": name, "method": "crude"} | crude_by_theory(probability) | known)
    return pd.DataFrame(rows)[COLUMNS]


def with_kept(table: pd.DataFrame, kept: pd.DataFrame) -> pd.DataFrame:
    """Add the rows of an earlier table without new runs; crude Monte Carlo by theory replaces none."""
    keys = ["problem", "method"]
    both = pd.concat([table[table["seeds"] > 0], kept, table], ignore_index=True).drop_duplicates(keys)
    order = [
        (name, method)
        for name, problem in problems().items()
        for method in dict.fromkeys([*methods_of(problem), *LEARNING, "crude"])
    ]
    return both.set_index(keys).loc[lambda rows: [key for key in order if key in rows.index]].reset_index()


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", nargs="+", required=True)
    parser.add_argument("--references", nargs="+", required=True, help="files reference/PROBLEM.json")
    parser.add_argument("--keep", help="table whose rows are kept where there are no new runs")
    parser.add_argument("--output", required=True)
    arguments = parser.parse_args()
    runs = pd.concat([pd.read_csv(path) for path in arguments.runs], ignore_index=True)
    references = {Path(path).stem: json.loads(Path(path).read_text()) for path in arguments.references}
    made = table(runs, references)
    whole = with_kept(made, pd.read_csv(arguments.keep)) if arguments.keep else made
    write_csv(arguments.output, reproducible(whole))


if __name__ == "__main__":
    main()
