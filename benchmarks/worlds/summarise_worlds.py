"""Tabulate coverage, width and bias over all worlds that were run."""

import argparse

import numpy as np
import pandas as pd
from accelerated_evaluation.answer.ways.extrapolation import exact_interval
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.publishing.tables.display import reproducible
from procedures import COVERAGES


def summary(rows: pd.DataFrame) -> pd.Series:
    """Sum up the worlds of one kind under one procedure, with 95 % limits of each coverage."""
    truth, ratio = rows["truth"], rows["probability"] / rows["truth"]
    reported = {
        "worlds": len(rows),
        "truth": truth.iloc[0],
        "median_ratio": ratio.median(),
        "mean_ratio": (rows["mean"] / truth).mean(),
        "ratio_10": ratio.quantile(0.1),
        "ratio_90": ratio.quantile(0.9),
        "width80": (rows["high0.8"] / np.maximum(rows["low0.8"], 1e-300)).median(),
        "truth_above80": (rows["high0.8"] < truth).mean(),
        "truth_below80": (rows["low0.8"] > truth).mean(),
    }
    for level in COVERAGES:
        name = f"coverage{100 * level:.0f}"
        hits = int(truth.between(rows[f"low{level:g}"], rows[f"high{level:g}"]).sum())
        reported[name] = hits / len(rows)
        reported[f"{name}_low"], reported[f"{name}_high"] = exact_interval(hits, len(rows))
    return pd.Series(reported)


def tabulate(runs: pd.DataFrame) -> pd.DataFrame:
    """Return a row for each kind and procedure; ``beyond`` says whether the kind breaks an assumption."""
    groups = runs.groupby(["kind", "procedure", "beyond"], sort=False)
    return groups.apply(summary, include_groups=False).reset_index().astype({"worlds": int})


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("runs", nargs="+")
    parser.add_argument("--output", required=True)
    arguments = parser.parse_args()
    runs = pd.concat([pd.read_csv(path) for path in arguments.runs], ignore_index=True)
    write_csv(arguments.output, reproducible(tabulate(runs)))


if __name__ == "__main__":
    main()
