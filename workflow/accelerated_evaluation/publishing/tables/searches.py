"""Summaries of the Cross-Entropy searches, and the coverage of the intervals."""

import pandas as pd

from accelerated_evaluation.methods.coverage import LEVELS
from accelerated_evaluation.publishing.published import result_table, table

COVERAGE_COLUMNS = (
    *("method", "stopping", "replicates", "bias", "cov_true", "cov_reported"),
    *(f"coverage{level}" for level in LEVELS),
)


def search_totals(trace: pd.DataFrame) -> pd.Series:
    """Return the simulations of each search, summed over the segments, by method and seed."""
    searches = trace.groupby(["method", "segment", "seed"])["simulations_total"].max()
    return searches.groupby(["method", "seed"]).sum()


def searched_parameters(trace: pd.DataFrame, method: str) -> int:
    """Return the number of free parameters that the searches of a method change, summed over the segments.

    The weights of the pieces of a variable sum to one, so one of them is not counted.
    """
    columns = trace.filter(regex=r"^inverse_(range|ttc)_(rate|weight|theta|from)").columns
    total = 0
    for _, rows in trace[trace["method"] == method].groupby("segment"):
        moved = columns[rows[columns].max() > rows[columns].min()]
        bound = {name.split("_weight_")[0] for name in moved if "_weight_" in name}
        total += len(moved) - len(bound)
    return total


def updates_digest(repeated_searches: pd.DataFrame) -> pd.DataFrame:
    """Return ``repeated_searches.csv`` as means over the seeds."""
    groups = repeated_searches.groupby(["method", "crash_updates"], sort=False)
    return groups.agg(
        simulations=("simulations", "mean"),
        needed=("needed", "mean"),
        change_inverse_range=("change_inverse_range", "mean"),
        change_inverse_ttc=("change_inverse_ttc", "mean"),
    ).reset_index()


# The searches with more seeds and more updates; readers are shown the `updates_digest`.
repeated_searches_table = result_table("repeated_searches", digits=3, digest=updates_digest)


def least_coverage(coverage: pd.DataFrame) -> pd.DataFrame:
    """Return the coverage by method and stopping rule, the one with the lowest coverage of 80 % first."""
    shown = ["method", "stopping", "bias", "coverage80", "coverage80_se", "coverage95"]
    return coverage.sort_values("coverage80", kind="stable")[shown]


@table("coverage", digits=3, digest=least_coverage)
def coverage_table(coverage: pd.DataFrame) -> pd.DataFrame:
    """Return the table of the coverage of intervals, with the columns that contain the coverage first."""
    others = [name for name in coverage.columns if name not in COVERAGE_COLUMNS]
    return coverage[[*COVERAGE_COLUMNS, *others]]
