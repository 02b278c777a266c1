"""Figures 23 and 25, beyond the paper: the answer with its intervals, and the vehicles."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.publishing.figures.dot_chart import (
    FRAME,
    ROW,
    name_rows,
    scale_logarithmically,
    spaced,
)
from accelerated_evaluation.publishing.figures.style import COLUMN_WIDTH, Drawn, say_no_crash
from accelerated_evaluation.publishing.published import figure
from accelerated_evaluation.publishing.tables.display import vehicles_in_words
from accelerated_evaluation.scenarios.protocol import Scenario

PAPER = "#b2182b"  # colour of the interval of the paper
# The row of the same records as the answer has fewer draws, so its numbers are slightly different.
SAME_READING = {"as in the answer": "as in the answer, fewer draws"}
ALONE = "error of the simulations alone"


@figure
def fig23_answer(
    answer: pd.DataFrame,
    scenario: Scenario,
    paper_interval: tuple[float, float] | None = None,
    answer_thresholds: pd.DataFrame | None = None,
    data_quality: pd.DataFrame | None = None,
    sampled_estimate: pd.DataFrame | None = None,
) -> Drawn:
    """Draw the crash probability with its 50, 80 and 95 % intervals.

    Further rows show the probability with a single threshold of the laws' tails, and with other treatments of
    the records (``data_quality.csv``). Without these, the other events of the answer are drawn. If the answer
    comes from few runs, a row shows the 80 % interval of their error alone (``estimate.csv``).

    Return the figure and a table with a row for each row of the figure: the columns of the tables, group and
    name. Events whose probability is not known are left out.
    """
    known = answer.dropna(subset="median").assign(group="the answer")
    known["name"] = known["event"]
    if "encounters" in known:
        known["group"] = known["encounters"]
    if answer_thresholds is not None:
        known = known[known["event"] == "crash"].assign(name="all laws, all draws")
    parts = [known]
    if answer_thresholds is not None:
        names = answer_thresholds["level"].map("{:g}".format)
        parts.append(answer_thresholds.assign(group="one threshold of the tails", name=names))
    if data_quality is not None:
        names = data_quality["reading"].replace(SAME_READING)
        parts.append(data_quality.assign(group="other treatment of the records", name=names))
    if sampled_estimate is not None and len(known):
        ends = sampled_estimate[["probability", "ci_low", "ci_high"]].head(1)
        ends = ends.rename(columns={"ci_low": "low80", "ci_high": "high80"})
        parts.append(ends.assign(group=ALONE, name="crash, 80 %"))
    data = pd.concat(parts, ignore_index=True)
    y = spaced(data["group"], 1.6)
    size = (1.4 * COLUMN_WIDTH, FRAME + ROW * (y.max(initial=2) + 3))
    drawn, axes = plt.subplots(figsize=size)
    if data.empty:
        say_no_crash(axes)
    else:
        draw_nested(axes, y, data)
        name_rows(axes, y, data["group"], data["name"])
        axes.set_ylim(y.max() + 0.8, -1.6)
    if paper_interval is not None:
        axes.axvspan(*paper_interval, color=PAPER, alpha=0.4, linewidth=0, label="paper, 80 %")
    axes.set_xlabel(label := f"probability for {scenario.one}")
    if paper_interval is not None or (data["high80"] > 0).any():
        scale_logarithmically(axes, label)
    drawn.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return drawn, data.drop(columns=["reading"], errors="ignore")


def draw_nested(axes: Axes, y: Array, rows: pd.DataFrame) -> None:
    """Draw 50, 80 and 95 % intervals over each other, the median as a stroke and the mean as a diamond."""
    for level, width in ((95, 0.8), (80, 2.2), (50, 4.5)):
        axes.hlines(
            y, rows[f"low{level}"], rows[f"high{level}"], color="#4292c6", linewidth=width, label=f"{level} %"
        )
    axes.plot(rows["median"], y, "|", color="black", markersize=6, label="median")
    axes.plot(rows["probability"], y, "D", color="black", markersize=2.5, label="mean")


@figure
def fig25_vehicles(vehicles: pd.DataFrame, scenario: Scenario) -> Drawn:
    """Draw the crash probability of each vehicle, and its ratio to that of the careful human.

    The second panel is left out if the scenario has no reference vehicles.
    """
    shown = vehicles[vehicles["resolved"].astype(bool)].sort_values("median", kind="stable")
    y, widths = np.arange(len(shown)), (1.5, 1) if "ratio" in vehicles else (1.75,)
    size = (0.8 * sum(widths) * COLUMN_WIDTH, FRAME + 2 * ROW * max(len(shown), 3))
    drawn, ((left, *others),) = plt.subplots(
        1, len(widths), sharey=True, figsize=size, width_ratios=widths, squeeze=False
    )
    draw_nested(left, y, shown)
    left.set_title("(a) 50, 80 and 95 % intervals" if others else "", loc="left")
    scale_logarithmically(left, f"crash probability of {scenario.one}")
    left.set_yticks(y, vehicles_in_words(shown["vehicle"]))
    left.set_ylim(len(shown) - 0.5, -0.5)
    for right in others:
        right.hlines(y, shown["ratio_low80"], shown["ratio_high80"], color="#4292c6", linewidth=2.2)
        right.plot(shown["ratio"], y, "|", color="black", markersize=6)
        right.axvline(1, color="black", linewidth=0.6, linestyle=":")
        right.set_title("(b) 80 % interval", loc="left")
        scale_logarithmically(right, "ratio to the careful human")
    drawn.legend(*left.get_legend_handles_labels(), loc="outside upper center", ncols=5 if others else 3)
    return drawn, vehicles
