"""Figures 26 and 27, beyond the paper: the number of records by lead speed and range, and their drift."""

from collections.abc import Mapping

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.ticker import MaxNLocator

from accelerated_evaluation.publishing.figures.style import COLUMN_WIDTH, PIECES, Drawn
from accelerated_evaluation.publishing.published import figure
from accelerated_evaluation.records.checks.size import CELL
from accelerated_evaluation.records.segments import MINIMUM_ROWS

LARGEST_NARROW = 8  # largest number of cells along an axis of a figure for one column
BLOCKS = 30  # largest number of blocks of consecutive rows
DRAWN = {
    "lead_speed": ("m_per_s", "lead speed"),
    "range": ("m", "range"),
    "inverse_ttc": ("per_s", "inverse time to collision"),
}


@figure
def fig26_sample_size(encounters: pd.DataFrame) -> Drawn:
    """Draw the number of records by lead speed and range, and mark cells with too few records for a fit.

    The figure has cells of 5 m/s by 10 m, or less at the upper ends, with their counts. The data contain
    lower and upper edges and count of all cells.
    """
    names = ("lead_speed", "range")
    edges = [_edges(encounters[name], step) for name, step in zip(names, CELL, strict=True)]
    count = np.histogram2d(encounters["lead_speed"], encounters["range"], edges)[0].astype(int)
    many = max(count.shape) > LARGEST_NARROW
    drawn, axes = plt.subplots(figsize=((1 + many) * COLUMN_WIDTH, 3.0 if count.shape[1] <= 12 else 5.0))
    density = count.T / np.outer(*map(np.diff, edges[::-1]))  # a cell at the edge may be smaller
    shown = np.ma.masked_equal(density, 0)
    largest = density.max() or 1.0
    # The shades are light, so that the numbers on them are readable.
    norm = LogNorm(vmin=largest / 1e4, vmax=100 * largest)
    axes.pcolormesh(*edges, shown, norm=norm, cmap="Blues", edgecolor="#909090", linewidth=0.3)
    _write_counts(axes, count, edges)
    axes.set(xlabel="lead speed $v_L$ [m/s]", ylabel="range $R$ [m]")
    axes.grid(visible=False)
    row, column = np.indices(count.shape).reshape(2, -1)
    data = {
        "lead_speed_low_m_per_s": edges[0][row],
        "lead_speed_high_m_per_s": edges[0][row + 1],
        "range_low_m": edges[1][column],
        "range_high_m": edges[1][column + 1],
        "records": count.ravel(),
    }
    return drawn, pd.DataFrame(data)


def _edges(values: pd.Series, step: float) -> np.ndarray:
    """Return multiples of a step that enclose all values; the last is lowered to the end of the values."""
    first, last = np.floor(values.min() / step), np.ceil(values.max() / step)
    edges = np.arange(first, max(last, first + 1) + 1) * step
    edges[-1] = max(np.ceil(values.max()), edges[-2] + 1)
    return edges


def _write_counts(axes: Axes, count: np.ndarray, edges: list[np.ndarray]) -> None:
    """Write the count into each cell, with a frame if it is smaller than a fit needs."""
    for (i, j), number in np.ndenumerate(count):
        middle = [(along[k] + along[k + 1]) / 2 for along, k in zip(edges, (i, j), strict=True)]
        few = number < MINIMUM_ROWS
        axes.text(
            *middle,
            f"{number:,}",
            ha="center",
            va="center",
            fontsize=6,
            fontweight="bold" if few else "normal",
            bbox={"boxstyle": "square,pad=0.2", "fill": False, "linewidth": 0.6} if few else None,
        )


@figure
def fig27_row_order(encounters: pd.DataFrame) -> Drawn:
    """Draw median and 95 % quantile of lead speed, range and TTC^-1 in blocks of consecutive rows.

    The figure has a panel for each quantity, in which each value is divided by that of all rows. The data
    contain, for each block, its first and last row, and median and 95 % quantile of each quantity.
    """
    blocks = np.array_split(np.arange(len(encounters)), min(BLOCKS, max(len(encounters) // 20, 1)))
    rows = [_digest(encounters.iloc[block], block) for block in blocks]
    data = pd.DataFrame(rows)
    middle = (data["first_row"] + data["last_row"]) / 2
    drawn, panels = plt.subplots(3, 1, figsize=(COLUMN_WIDTH, 4.4), sharex=True, sharey=True)
    for letter, axes, (name, (unit, label)) in zip("abc", panels, DRAWN.items(), strict=True):
        whole = encounters[name].quantile([0.5, 0.95])
        for quantile, color, line, marker, word in (
            (0.5, PIECES[0], "-", "o", "median"),
            (0.95, PIECES[1], "--", "s", "95 % quantile"),
        ):
            ratio = data[f"{name}_q{100 * quantile:.0f}_{unit}"] / whole[quantile]
            look = {"linestyle": line, "marker": marker, "markersize": 2.5, "color": color}
            axes.plot(middle, ratio, label=f"{word}, block / all rows", **look)
        axes.axhline(1, color="black", linewidth=0.6, linestyle=":")
        axes.set_title(f"({letter}) {label}", loc="left")
        axes.set_ylabel("ratio")
    drawn.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=1)
    panels[-1].set_xlabel("row of the encounter table")
    panels[-1].xaxis.set_major_locator(MaxNLocator(4))
    panels[-1].xaxis.set_major_formatter("{x:,.0f}")
    return drawn, data


def _digest(rows: pd.DataFrame, place: np.ndarray) -> Mapping[str, float]:
    digest = {"first_row": place[0] + 1, "last_row": place[-1] + 1}
    for name, (unit, _) in DRAWN.items():
        for quantile in (0.5, 0.95):
            digest[f"{name}_q{100 * quantile:.0f}_{unit}"] = rows[name].quantile(quantile)
    return digest
