"""Tabulate coverage, width and bias over all worlds that were run."""

import argparse

import numpy as np
import pandas as pd
from accelerated_evaluation.answer.extrapolation import exact_interval
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.publishing.tables.display import reproducible

COVERAGES = (0.5, 0.8, 0.95)


def coverages(rows: pd.DataFrame) -> dict[str, float]:
    """Return by level the share of the worlds whose interval covers the truth, with 95 % limits.

    A world without an answer is not covered.
    """
    reported: dict[str, float] = {}
    for level in COVERAGES:
        name = f"coverage{100 * level:.0f}"
        hits = int(rows["truth"].between(rows[f"low{level:g}"], rows[f"high{level:g}"]).sum())
        reported[name] = hits / len(rows)
        reported[f"{name}_low"], reported[f"{name}_high"] = exact_interval(hits, len(rows))
    return reported


def judge(rows: pd.DataFrame) -> dict[str, float]:
    """Sum up the worlds of one kind under one procedure."""
    truth = rows["truth"]
    reported: dict[str, float] = {
        "worlds": len(rows),
        "truth": float(truth.iloc[0]),
        "median_ratio": float(np.median(rows["probability"] / truth)),
        "mean_ratio": float(np.mean(rows["mean"] / truth)),
        "width80": float(np.median(rows["high0.8"] / np.maximum(rows["low0.8"], 1e-300))),
        "truth_above80": float(np.mean(rows["high0.8"] < truth)),
        "truth_below80": float(np.mean(rows["low0.8"] > truth)),
    }
    return reported | coverages(rows)


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("runs", nargs="+")
    parser.add_argument("--output", required=True)
    arguments = parser.parse_args()
    runs = pd.concat([pd.read_csv(path) for path in arguments.runs], ignore_index=True)
    groups = runs.groupby(["kind", "procedure"], sort=False)
    table = pd.DataFrame([{"kind": kind, "procedure": name} | judge(rows) for (kind, name), rows in groups])
    write_csv(arguments.output, reproducible(table))


if __name__ == "__main__":
    main()
