"""Dot charts: a row for each number, rows in groups, and a vertical line for the true value."""

from collections.abc import Iterable
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.publishing.figures.style import PIECES, note_source
from accelerated_evaluation.publishing.tables.formats import readable

INTERVAL = ("probability", "ci_low", "ci_high")
TRUTH = {"color": "black", "linewidth": 0.8, "zorder": 1}
DOT = {"color": PIECES[0], "marker": "o", "linestyle": "none", "markersize": 3.5}
ROW = 0.13  # [in], height of a row
FRAME = 0.9  # [in], height of what surrounds the rows


def spaced(groups: pd.Series, gap: float) -> Array:
    """Return the heights of the rows of a dot chart, from 0, with a gap between groups."""
    return np.arange(len(groups)) + gap * ((groups != groups.shift()).cumsum().to_numpy() - 1)


def draw_intervals(axes: Axes, rows: pd.DataFrame, y: ArrayLike, **look: Any) -> None:  # noqa: ANN401
    """Draw values with lines from ci_low to ci_high."""
    value, low, high = (rows[name].to_numpy(float) for name in INTERVAL)
    # A mean weight may exceed 1, where its interval ends.
    reach = np.maximum([value - low, high - value], 0)
    style = {"linestyle": "none", "markersize": 3.5, "linewidth": 0.8, "zorder": 2} | look
    axes.errorbar(value, y, xerr=reach, elinewidth=style.pop("linewidth"), **style)


def draw_truth(axes: Axes, row: pd.Series, label: str) -> None:
    """Draw a value as a line across all rows, with a band if it has an interval."""
    if pd.notna(row.get("ci_low")):
        axes.axvspan(row["ci_low"], row["ci_high"], color="black", alpha=0.3, linewidth=0)
    axes.axvline(row["probability"], label=f"{label}: {_in_math(row['probability'])}", **TRUTH)


def name_rows(axes: Axes, y: Array, groups: pd.Series, names: pd.Series) -> None:
    """Label the rows, and write the name of each group in bold above it."""
    starts = (groups != groups.shift()).to_numpy()
    axes.set_yticks([*y, *(y[starts] - 1)], [*names, *groups[starts]])
    for label in axes.get_yticklabels()[len(y) :]:
        label.set_fontweight("bold")
    for tick in axes.yaxis.get_major_ticks()[len(y) :]:
        tick.gridline.set_visible(False)
        tick.tick1line.set_visible(False)


def name_groups(axes: Axes, y: Array, groups: pd.Series) -> None:
    """Label each group of rows at its middle."""
    axes.set_yticks(pd.Series(y).groupby(groups.to_numpy(), sort=False).mean(), groups.unique())


def write_beside(axes: Axes, y: ArrayLike, texts: Iterable[str], heading: str) -> None:
    """Write a text to the right of each row, and a heading above these texts."""
    for at, text in zip(y, texts, strict=True):
        axes.text(1.02, at, text, transform=axes.get_yaxis_transform(), va="center", fontsize=6)
    axes.text(1.02, 1.04, heading, transform=axes.transAxes, va="bottom", fontsize=6)


def in_ratios(values: pd.Series) -> list[str]:
    """Write numbers as multiples."""
    return [f"×{readable(value)}" for value in values]


def finish(figure: Figure, axes: Axes, source: str) -> None:
    """Invert the axis so that the first row is on top, and place legend and source outside."""
    axes.invert_yaxis()
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center")
    note_source(figure, source)


def _in_math(value: float) -> str:
    """Write a probability with three digits, as formula."""
    mantissa, exponent = f"{value:.2e}".split("e")
    return rf"{mantissa} $\times$ 10$^{{{int(exponent)}}}$"
