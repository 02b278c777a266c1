"""The tables of the simulated motorway for ``python benchmarks/readme.py``."""

import pandas as pd
from blocks import markdown

PREDICTIONS = ("snapshot", "ngsim", "recorded")


def counts_table(counts: pd.DataFrame) -> str:
    """Return counted and predicted crashes by host and sign of the closing speed."""
    headings = ("host", "gap", "cut-ins", "counted", *PREDICTIONS)
    headings += ("cells with 10 crashes or more", *(f"{name} within a factor of 2" for name in PREDICTIONS))
    table = []
    for (host, gap), cells in counts.groupby(["host", "gap"], sort=False):
        sums = cells[["cut_ins", "counted", *PREDICTIONS]].sum()
        ratios = cells[[f"{name}_to_counted" for name in PREDICTIONS]].dropna()
        near = ((ratios >= 0.5) & (ratios <= 2)).sum()
        numbers = (f"{value:,.0f}" for value in (*sums, len(ratios)))
        table.append((host, gap, *numbers, *(f"{count}" if len(ratios) else "–" for count in near)))
    return markdown(headings, table)


def calibration_table(calibration: pd.DataFrame) -> str:
    """Return the statistics of the traffic next to those of NGSIM."""
    headings = ("statistic", "NGSIM", "limits", "reason", "motorway", "smallest and largest hour", "within")
    table = [
        (
            row.statistic,
            row.ngsim,
            f"{row.low:g} to {row.high:g}",
            row.limits,
            f"{row.motorway:.3g}",
            f"{row.smallest_part:.3g} to {row.largest_part:.3g}",
            "yes" if row.within else "no",
        )
        for row in calibration.itertuples()
    ]
    return markdown(headings, table)


def extraction_table(extraction: pd.DataFrame) -> str:
    """Return how many cut-ins of the recordings the command extract finds."""
    headings = ("rule", "cut-ins of the worlds", "found", "recall", "false", "largest difference")
    table = []
    for rule, rows in extraction.groupby("rule", sort=False):
        known, found, both = (rows[name].sum() for name in ("known", "found", "both"))
        pairs = ((known - both, known), (both, found))
        shares = tuple(f"{1 - part / whole:.1%}" if whole else "–" for part, whole in pairs)
        difference = f"{rows['difference'].max():.1e}" if both else "–"
        table.append((rule, f"{known:,}", f"{found:,}", *shares, difference))
    return markdown(headings, table)


def chain_table(chain: pd.DataFrame) -> str:
    """Return in how many worlds the intervals of the whole chain cover the count, by host and prediction.

    Worlds whose records were too few for a prediction are left out.
    """
    chain = chain.dropna(subset="median")
    headings = ("host", "lead motion", "worlds", "counted", "predicted, sum of the medians")
    headings += ("80 % covers", "95 % covers", "count above the 95 % interval", "count below it")
    table = []
    for (host, prediction), rows in chain.groupby(["host", "prediction"], sort=False):
        counted = rows["counted"]
        covers = (counted.between(rows[f"low{level}"], rows[f"high{level}"]).sum() for level in (80, 95))
        misses = ((counted > rows["high95"]).sum(), (counted < rows["low95"]).sum())
        numbers = (len(rows), counted.sum(), rows["median"].sum(), *covers, *misses)
        table.append((host, prediction, *(f"{number:,.0f}" for number in numbers)))
    return markdown(headings, table)


MOTORWAY_TABLES = {
    "motorway": counts_table,
    "motorway_calibration": calibration_table,
    "motorway_chain": chain_table,
    "motorway_extraction": extraction_table,
}
