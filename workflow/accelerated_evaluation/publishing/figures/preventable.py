"""Figure 30, beyond the paper: the cut-ins in which vehicles and drivers crash."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from accelerated_evaluation.publishing.figures.style import COLUMN_WIDTH, Drawn, Look
from accelerated_evaluation.publishing.published import figure
from accelerated_evaluation.publishing.tables.display import NAMES

BAND = 2.5  # [m/s], how far the lead speed of a record may be from that of its panel
# [m/s], least distance at which crashes below a vehicle's line are drawn as a line of their own, and largest
# median step of this line
ISLAND = 0.5
TOP = 36.0  # [m/s], largest closing speed that is drawn
# Colour, dashes and marker of each vehicle. Markers and dashes distinguish the lines in grey as well.
LOOKS = (
    ("#08306b", "-", "o"),
    ("#4292c6", (0, (5, 1.5)), "s"),
    ("#b2182b", "-", "^"),
    ("#e08214", (0, (1, 1)), "D"),
    ("#1b7837", (0, (6, 1.5, 1, 1.5)), "v"),
    ("#762a83", (0, (3, 1, 1, 1, 1, 1)), "P"),
    ("#8c510a", (0, (8, 2)), "X"),
)
# Line widths of the closing speeds that the law exceeds, from the most frequent to the rarest.
EXCEEDED = (0.7, 1.6)
END: Look = {"marker": "|", "markersize": 9, "markeredgewidth": 1.5}  # where a line ends
EDGE: Look = {"linewidth": 0.6, "linestyle": "-", "color": "black"}
MARKS_ON_A_LINE = 6  # number of markers on a line; those of different vehicles are at different ranges


@figure
def fig30_preventable(preventable: pd.DataFrame, encounters: pd.DataFrame) -> Drawn:
    """Draw for each vehicle the closing speed, by range, from which on it always crashes.

    The density of the records is drawn in the background, and dotted lines show the closing speeds that a
    law exceeds with given probabilities.

    The figure has a panel for each of at most three lead speeds; the data are the table ``preventable``.
    """
    speeds = preventable["lead_speed"].unique()
    size = (2 * COLUMN_WIDTH, 1.4 * COLUMN_WIDTH)
    drawn, all_axes = plt.subplots(1, len(speeds), sharex=True, sharey=True, figsize=size, squeeze=False)
    for letter, axes, speed in zip("abc", all_axes[0], speeds, strict=False):
        near = encounters[np.abs(encounters["lead_speed"] - speed) <= BAND]
        _draw_records(axes, near)
        _draw_lines(axes, preventable[preventable["lead_speed"] == speed])
        axes.set_title(f"({letter}) lead speed {speed:g} m/s,\n{len(near):,} records", loc="left")
        axes.set(xlim=(0, 75), ylim=(0, TOP), xlabel="range [m]")
    all_axes[0, 0].set_ylabel("closing speed [m/s]")
    entries: Look = {}
    for axes in all_axes[0]:
        entries |= dict(zip(*axes.get_legend_handles_labels()[::-1], strict=True))
    drawn.legend(entries.values(), entries.keys(), loc="outside upper center", ncols=3)
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
    never = []
    for place, (name, line) in enumerate(vehicles):
        turn, at = divmod(place, len(LOOKS))  # further vehicles combine the looks in another way
        color, dashes, marker = (LOOKS[(at + shift * turn) % len(LOOKS)][shift] for shift in range(3))
        style: Look = {"color": color, "linestyle": dashes}
        step = max(len(line) // MARKS_ON_A_LINE, 1)
        points: Look = {"marker": marker, "markersize": 5, "markevery": (place * step // len(LOOKS), step)}
        points |= {"markerfacecolor": "white" if place % 2 else color, "markeredgewidth": 0.8}
        label = NAMES.get(str(name), str(name))
        axes.plot(line["range"], line["always"], label=label, linewidth=1.1, **style, **points)
        crashing = line[line["always"].notna()]
        if crashing.empty:
            never += [label] if line["first"].isna().all() else []
        elif crashing["range"].iloc[-1] < line["range"].iloc[-1]:
            axes.plot(*crashing[["range", "always"]].iloc[-1], color=color, **END)
            axes.plot([], [], color="black", linestyle="none", label="no crash at larger ranges", **END)
        # Crashes at lower closing speeds, below the line, are drawn if they form a smooth line too.
        island = line["first"].where(line["first"] < line["always"] - ISLAND)
        if island.notna().sum() > 1 and island.diff().abs().median() < ISLAND:
            axes.plot(line["range"], island, **EDGE | {"color": color})
            axes.plot([], [], label="lower edge of separate crashes", **EDGE)
    if never:
        text = "never crashes:\n" + "\n".join(never)
        axes.text(0.98, 0.98, text, transform=axes.transAxes, ha="right", va="top", fontsize=7)
    laws = rows[rows["kind"] == "law"].groupby("name", sort=False)
    for (name, line), width in zip(laws, EXCEEDED, strict=False):
        label = f"1 in {1 / float(name):,.0f} cut-ins"
        axes.plot(line["range"], line["first"], ":", color="black", linewidth=width, label=label)
