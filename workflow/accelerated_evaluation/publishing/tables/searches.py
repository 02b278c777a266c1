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


def search_digest(trace: pd.DataFrame) -> pd.DataFrame:
    """Summarise the Cross-Entropy searches by method and segment.

    The columns are means over the seeds: iterations with an update; simulations, with their extremes; the
    threshold, the crashes and the effective sample size of their weights in the last iteration; and the
    distance by which the truncation points moved [1/m], [1/s].
    """
    first, last = (
        trace.groupby(["method", "segment", "seed"], sort=False).nth(row).reset_index(drop=True)
        for row in (0, -1)
    )
    knots = [f"inverse_{variable}_from_2" for variable in ("range", "ttc")]
    shift = last[knots] - first[knots]
    searches = last.assign(
        updates=last["iteration"] - 1,
        crash_share=last["crashes"] / last["sample"],
        shift_range=shift[knots[0]],
        shift_ttc=shift[knots[1]],
    )
    digest = searches.groupby(["method", "segment"], sort=False).agg(
        seeds=("seed", "size"),
        iterations=("updates", "mean"),
        simulations=("simulations_total", "mean"),
        simulations_min=("simulations_total", "min"),
        simulations_max=("simulations_total", "max"),
        crash_share=("crash_share", "mean"),
        effective_sample_size=("effective_sample_size", "mean"),
        knot_shift_inverse_range_per_m=("shift_range", "mean"),
        knot_shift_inverse_ttc_per_s=("shift_ttc", "mean"),
    )
    return digest.reset_index()


def updates_digest(repeated_searches: pd.DataFrame) -> pd.DataFrame:
    """Return ``repeated_searches.csv`` as means over the seeds, with the extremes of ``needed``."""
    groups = repeated_searches.groupby(["method", "crash_updates"], sort=False)
    return groups.agg(
        seeds=("seed", "size"),
        simulations=("simulations", "mean"),
        needed=("needed", "mean"),
        needed_min=("needed", "min"),
        needed_max=("needed", "max"),
        change_inverse_range=("change_inverse_range", "mean"),
        change_inverse_ttc=("change_inverse_ttc", "mean"),
    ).reset_index()


# The searches with more seeds and more updates; readers are shown the `updates_digest`.
repeated_searches_table = result_table("repeated_searches", digits=3, digest=updates_digest)


@table("coverage", digits=3)
def coverage_table(coverage: pd.DataFrame) -> pd.DataFrame:
    """Return the table of the coverage of intervals, with the columns that contain the coverage first."""
    others = [name for name in coverage.columns if name not in COVERAGE_COLUMNS]
    return coverage[[*COVERAGE_COLUMNS, *others]]
