"""Draw the counted crashes of every host and cell against the predicted ones."""

import argparse

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from accelerated_evaluation.publishing.figures.style import (
    COLUMN_WIDTH,
    note_source,
    paper_style,
    save_figure,
)
from accelerated_evaluation.publishing.tables.display import NAMES
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.stats import gamma
from traffic import run_command

PREDICTIONS = {
    "snapshot": "constant speed",
    "ngsim": "motion as in NGSIM",
    "recorded": "recorded motion",
}
COLORS = {
    "cc_human": "#08306b",
    "poor": "#d94801",
    "human": "#41ab5d",
    "acc_only": "#737373",
    "acc_aeb": "#000000",
}
MARKERS = {"cc_human": "s", "poor": "^", "human": "o", "acc_only": "D", "acc_aeb": "v"}
LEAST = 0.3  # predictions of less are drawn at the left of this, each host at a place of its own
PLACES = dict(zip(COLORS, np.geomspace(0.03, 0.2, len(COLORS)), strict=True))
LEVEL = 0.95
WORDS = {**NAMES, "poor": "poor car"}


def draw(table: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw a panel for each prediction, with Poisson limits of the counts.

    A prediction that could not be made has no points. If no host has crashed, all panels are empty.
    """
    data = table[table["counted"] > 0].reset_index(drop=True)
    data["low95"] = gamma.ppf((1 - LEVEL) / 2, data["counted"])
    data["high95"] = gamma.ppf((1 + LEVEL) / 2, data["counted"] + 1)
    with paper_style():
        drawn, panels = plt.subplots(
            1, len(PREDICTIONS), figsize=(2 * COLUMN_WIDTH, 3.7), sharex=True, sharey=True
        )
        largest = 3 * np.nanmax([1.0, *data["high95"], *data[list(PREDICTIONS)].to_numpy().ravel()])
        for axes, (name, title) in zip(panels, PREDICTIONS.items(), strict=True):
            _draw_panel(axes, data, name, largest)
            axes.set(title=title, xlabel="predicted crashes")
        panels[0].set_ylabel("counted crashes")
        handles, labels = panels[-1].get_legend_handles_labels()
        drawn.legend(handles, labels, loc="outside upper center", ncols=3)
        if data.empty:
            panels[1].text(0.5, 0.5, "no crash counted", transform=panels[1].transAxes, ha="center")
        note_source(
            drawn, "cut-ins on simulated motorways (Eclipse SUMO), by host, sign of closing speed and range"
        )
    return drawn, data


def _draw_panel(axes: Axes, data: pd.DataFrame, name: str, largest: float) -> None:
    """Draw the cells of one prediction, with the line of agreement and a band of a factor of 2."""
    line = np.array([min(PLACES.values()) / 1.5, largest])
    axes.axvspan(line[0], LEAST, color="#f6f0e0", linewidth=0, label=f"predicted: less than {LEAST:g}")
    axes.fill_between(line, line / 2, line * 2, color="#e8e8e8", linewidth=0, label="a factor of 2")
    axes.plot(line, line, color="#808080", linewidth=0.6)
    for (host, gap), cells in data.groupby(["host", "gap"], sort=False):
        counted = cells["counted"]
        errors = [counted - cells["low95"], cells["high95"] - counted]
        axes.errorbar(
            cells[name].mask(cells[name] < LEAST, PLACES[host]),
            counted,
            yerr=errors,
            fmt=MARKERS[host],
            color=COLORS[host],
            markerfacecolor=COLORS[host] if gap == "closing" else "white",
            markersize=4,
            elinewidth=0.5,
            label=f"{WORDS.get(host, host)}, {gap}",
        )
    axes.set(xscale="log", yscale="log", xlim=line, ylim=line, aspect="equal")


def main() -> None:
    """Draw the figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("table", help="CSV file of the counts in all worlds")
    parser.add_argument("folder", help="where motorway_cells.png and so on are written")
    arguments = parser.parse_args()
    figure, data = draw(pd.read_csv(arguments.table))
    save_figure(figure, data, arguments.folder, "motorway_cells")


if __name__ == "__main__":
    run_command(main)
