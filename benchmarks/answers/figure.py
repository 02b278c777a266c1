"""Draw the intervals of the crash map and of few runs next to each other, for every vehicle.

``python benchmarks/answers/figure.py`` reads benchmarks/results/answers_runs.csv, and writes
benchmarks/results/answers_intervals.{png,pdf,svg,csv}.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import pandas as pd
from accelerated_evaluation.publishing.figures.answer import draw_nested
from accelerated_evaluation.publishing.figures.dot_chart import FRAME, ROW, name_rows, spaced
from accelerated_evaluation.publishing.figures.style import (
    COLUMN_WIDTH,
    note_source,
    paper_style,
    save_figure,
)
from accelerated_evaluation.publishing.tables.display import vehicles_in_words
from matplotlib.figure import Figure

RESULTS = Path(__file__).resolve().parents[1] / "results"
ENDS = ("low95", "low80", "low50", "median", "high50", "high80", "high95")
SEEDS = 3  # of each vehicle, the first ones


def intervals(runs: pd.DataFrame) -> pd.DataFrame:
    """Return one row for the map of each vehicle, and one for each of its first seeds."""
    rows = []
    for vehicle, found in runs.dropna(subset="few_median").groupby("vehicle", sort=False):
        known = found.iloc[0]
        rows.append({"vehicle": vehicle, "name": "map, millions of runs"} | _ends(known, "map"))
        for row in found.head(SEEDS).to_dict("records"):
            name = f"{row['runs']:,.0f} runs" + ("" if row["converged"] else ", not converged")
            rows.append({"vehicle": vehicle, "name": name} | _ends(row, "few"))
    return pd.DataFrame(rows).assign(probability=float("nan"))


def _ends(row: pd.Series | dict, kind: str) -> dict[str, float]:
    return {name: row[f"{kind}_{name}"] for name in ENDS}


def draw(runs: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw the intervals, grouped by vehicle."""
    data = intervals(runs)
    with paper_style():
        y = spaced(data["vehicle"], 1.6)
        drawn, axes = plt.subplots(figsize=(1.6 * COLUMN_WIDTH, FRAME + ROW * y.max()))
        draw_nested(axes, y, data)
        name_rows(axes, y, vehicles_in_words(data["vehicle"]), data["name"])
        axes.set(xscale="log", xlabel="crash probability of a cut-in", ylim=(y.max() + 0.8, -1.6))
        handles, labels = axes.get_legend_handles_labels()
        drawn.legend(handles[:-1], labels[:-1], loc="outside upper center", ncols=4)  # without the mean
        note_source(drawn, f"the first {SEEDS} seeds of each vehicle; recorded lane changes of SPMD")
    return drawn, data


if __name__ == "__main__":
    figure, data = draw(pd.read_csv(RESULTS / "answers_runs.csv"))
    save_figure(figure, data, RESULTS, "answers_intervals")
