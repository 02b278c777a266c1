"""Figure 30, beyond the paper: cut-ins that are foreseeable and preventable, the terms of regulators."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from accelerated_evaluation.publishing.figures.style import COLUMN_WIDTH, note_source, paper_style
from accelerated_evaluation.publishing.published import figure

BAND = 2.5  # [m/s], how far the lead speed of a record may be from that of its panel
# [m/s], least distance at which crashes below a vehicle's line are drawn as a line of their own, and largest
# median step of this line
ISLAND = 0.5
TOP = 36.0  # [m/s], largest closing speed that is drawn
# The lines can be distinguished by dashes and widths in grey as well.
LOOKS = (
    ("#08306b", "-", 1.8),
    ("#08306b", (0, (5, 1.5)), 1.2),
    ("#b2182b", "-", 1.2),
    ("#b2182b", (0, (1, 1)), 1.2),
    ("#1b7837", (0, (6, 1.5, 1, 1.5)), 1.2),
    ("#762a83", (0, (3, 1, 1, 1, 1, 1)), 1.2),
    ("#e08214", "-", 1.2),
    ("#e08214", (0, (8, 2)), 1.2),
    ("#01665e", (0, (2, 1)), 1.8),
    ("#8c510a", (0, (4, 1, 1, 1)), 1.8),
)


@figure
def fig30_preventable(
    preventable: pd.DataFrame, encounters: pd.DataFrame, source: str
) -> tuple[Figure, pd.DataFrame]:
    """Draw for each vehicle the closing speed, by range, from which on it always crashes.

    The density of the records is drawn in the background, and dotted lines show the closing speeds that a
    law exceeds with given probabilities.

    Parameters
    ----------
    preventable
        ``preventable.csv`` of a study's folder ``happened``.
    encounters
        Encounter table, with one row for each recorded cut-in.
    source
        Description of the data.

    Returns
    -------
    figure, data
        The figure has a panel for each lead speed; the data are the table ``preventable``.
    """
    speeds = preventable["lead_speed"].unique()
    with paper_style():
        size = (2 * COLUMN_WIDTH, 1.05 * COLUMN_WIDTH)
        drawn, all_axes = plt.subplots(1, len(speeds), sharex=True, sharey=True, figsize=size, squeeze=False)
        for axes, speed in zip(all_axes[0], speeds, strict=True):
            near = encounters[np.abs(encounters["lead_speed"] - speed) <= BAND]
            _draw_records(axes, near)
            _draw_lines(axes, preventable[preventable["lead_speed"] == speed])
            axes.set_title(f"lead speed {speed:g} m/s, {len(near):,} records", fontsize=7)
            axes.set(xlim=(0, 75), ylim=(0, TOP), xlabel="range [m]")
        all_axes[0, 0].set_ylabel("closing speed [m/s]")
        drawn.legend(*all_axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
        note_source(drawn, source)
    return drawn, preventable


def _draw_records(axes: Axes, near: pd.DataFrame) -> None:
    """Draw the number of records per hexagonal cell in shades of grey, on a logarithmic scale."""
    if len(near):
        axes.hexbin(
            near["range"],
            near["closing_speed"],
            gridsize=(30, 24),
            extent=(0, 75, 0, TOP),
            bins="log",
            mincnt=1,
            cmap="Greys",
            vmin=0.3,
            vmax=3000,
            linewidths=0,
            rasterized=True,
        )


def _draw_lines(axes: Axes, rows: pd.DataFrame) -> None:
    vehicles = rows[rows["kind"] == "vehicle"].groupby("name", sort=False)
    for (name, line), (color, dashes, width) in zip(vehicles, LOOKS * 3, strict=False):
        look = {"color": color, "linestyle": dashes}
        axes.plot(line["range"], line["always"], label=str(name), linewidth=width, **look)
        # Crashes at lower closing speeds, below the line, are drawn if they form a smooth line too.
        island = line["first"].where(line["first"] < line["always"] - ISLAND)
        if island.notna().sum() > 1 and island.diff().abs().median() < ISLAND:
            axes.plot(line["range"], island, linewidth=0.6, **look)
    for name, line in rows[rows["kind"] == "law"].groupby("name", sort=False):
        axes.plot(line["range"], line["first"], color="black", linewidth=0.9, linestyle=(0, (1, 3)))
        here = line.iloc[len(line) // 2]
        axes.annotate(
            f"1 in {1 / float(name):,.0f}",
            (here["range"], here["first"]),
            (0, 2),
            textcoords="offset points",
            fontsize=5.5,
            ha="center",
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 0.5},
        )
