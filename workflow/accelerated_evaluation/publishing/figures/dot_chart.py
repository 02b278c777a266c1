"""Dot charts: each row shows a number and its interval, rows form groups, and a line marks the true value."""

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter
from numpy.typing import ArrayLike

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.publishing.figures.style import PIECES, Look
from accelerated_evaluation.publishing.tables.display import readable

INTERVAL = ("probability", "ci_low", "ci_high")
TRUTH: Look = {"color": "black", "linewidth": 0.8, "zorder": 1.8}  # above the grid, below the points
DOT: Look = {"color": PIECES[0], "marker": "o", "linestyle": "none", "markersize": 3.5}
ROW = 0.13  # [in], height of a row
PLAIN = 1e-3  # the ticks of a logarithmic axis are plain numbers if it begins above this
FRAME = 0.9  # [in], height of the figure above and below the rows


def spaced(groups: pd.Series, gap: float) -> Array:
    """Return the y coordinate of each row of a dot chart.

    The coordinates increase from 0, shape (n,); rows of one group have a distance of 1.
    """
    return np.arange(len(groups)) + gap * ((groups != groups.shift()).cumsum().to_numpy() - 1)


def draw_intervals(axes: Axes, rows: pd.DataFrame, y: ArrayLike, **look: Any) -> None:  # noqa: ANN401
    """Draw the column ``probability`` of rows as points, with lines from ``ci_low`` to ``ci_high``."""
    value, low, high = (rows[name].to_numpy(float) for name in INTERVAL)
    # An estimate, a mean of weights, may exceed 1, while the upper limit of its interval is at most 1.
    reach = np.maximum([value - low, high - value], 0)
    style: Look = {"linestyle": "none", "markersize": 3.5, "linewidth": 0.8, "zorder": 2} | look
    axes.errorbar(value, y, xerr=reach, elinewidth=style.pop("linewidth"), **style)


def draw_truth(axes: Axes, row: pd.Series, label: str) -> None:
    """Draw the true value as a vertical line across all rows, and its interval, if it has one, as a band."""
    if pd.notna(row.get("ci_low")):
        axes.axvspan(row["ci_low"], row["ci_high"], color="black", alpha=0.15, linewidth=0)
    axes.axvline(row["probability"], label=f"{label}: {in_math(row['probability'])}", **TRUTH)


def name_rows(axes: Axes, y: Array, groups: pd.Series, names: pd.Series) -> None:
    """Label each row with its name, and write the name of each group in bold above its first row."""
    starts = (groups != groups.shift()).to_numpy()
    axes.set_yticks([*y, *(y[starts] - 1)], [*names, *groups[starts]])
    for label in axes.get_yticklabels()[len(y) :]:
        label.set_fontweight("bold")
    for tick in axes.yaxis.get_major_ticks()[len(y) :]:
        tick.gridline.set_visible(False)
        tick.tick1line.set_visible(False)


def name_groups(axes: Axes, y: Array, groups: pd.Series) -> None:
    """Write the name of each group of rows as the label of the y axis in the middle of the group."""
    axes.set_yticks(pd.Series(y).groupby(groups.to_numpy(), sort=False).mean(), groups.unique())


def write_beside(axes: Axes, y: ArrayLike, texts: Iterable[str], heading: str) -> None:
    """Write one of the texts to the right of each row with coordinate y, and a heading above the texts."""
    for at, text in zip(y, texts, strict=True):
        axes.text(1.02, at, text, transform=axes.get_yaxis_transform(), va="center", fontsize=6)
    axes.text(1.02, 1.04, heading, transform=axes.transAxes, va="bottom", fontsize=6)


def in_ratios(values: pd.Series) -> list[str]:
    """Write ratios with a multiplication sign and two significant digits, such as "×2.5"."""
    # Rounded to three digits first, so that 0.9998 is ×1 and not ×1.00.
    return [f"×{readable(float(f'{value:.3g}'), 2)}" for value in values]


def scale_linearly(axes: Axes, label: str) -> None:
    """Label a linear x axis, with its power of ten in the label, which it could cover otherwise."""
    largest = max(map(abs, axes.get_xlim()))
    power = math.floor(math.log10(largest)) if largest else 0
    power = 0 if -1 <= power <= 3 else power
    axes.xaxis.set_major_formatter(lambda value, _: f"{value / 10.0**power:g}")
    axes.set_xlabel(f"{label} [$10^{{{power}}}$]" if power else label)


def scale_logarithmically(axes: Axes, label: str) -> None:
    """Scale x logarithmically, and label so many ticks that each number can be read off."""
    axes.set(xscale="log", xlabel=label)
    low, high = axes.get_xlim()
    decades = math.log10(high / low)
    axes.xaxis.set_major_locator(
        LogLocator(subs=(1, 2, 5) if decades < 1.5 else (1, 3) if decades < 3 else (1,))
    )
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:,g}" if low > PLAIN else in_powers(value))
    axes.xaxis.set_minor_formatter(NullFormatter())


def finish(figure: Figure, axes: Axes) -> None:
    """Complete a dot chart: first row on top, and legend above the axes."""
    axes.invert_yaxis()
    handles = axes.get_legend_handles_labels()
    if handles[0]:
        figure.legend(*handles, loc="outside upper center")


def in_math(value: float) -> str:
    """Write a probability with three significant digits, as a formula for Matplotlib."""
    mantissa, exponent = f"{value:.2e}".split("e")
    return rf"{mantissa} $\times$ 10$^{{{int(exponent)}}}$"


def in_powers(value: float) -> str:
    """Write the value of a tick with one digit and a power of ten, as a formula for Matplotlib."""
    mantissa, exponent = f"{value:.0e}".split("e")
    if exponent == "+00":
        return mantissa
    factor = "" if mantissa == "1" else rf"{mantissa} \times "
    return f"${factor}10^{{{int(exponent)}}}$"
