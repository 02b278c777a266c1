"""Figures 26 and 27, beyond the paper: the number of records by lead speed and range, and their drift."""

from collections.abc import Mapping

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from accelerated_evaluation.publishing.figures.style import COLUMN_WIDTH, PIECES, note_source, paper_style
from accelerated_evaluation.publishing.published import figure
from accelerated_evaluation.records.checks.sizes import CELL
from accelerated_evaluation.records.segments import MINIMUM_ROWS

BLOCKS = 30  # largest number of blocks of consecutive rows
DRAWN = {
    "lead_speed": ("m_per_s", "lead speed [m/s]"),
    "range": ("m", "range [m]"),
    "inverse_ttc": ("per_s", "$TTC^{-1}$ [1/s]"),
}


@figure
def fig26_sample_size(encounters: pd.DataFrame, source: str) -> tuple[Figure, pd.DataFrame]:
    """Draw the number of records by lead speed and range, and mark cells with too few records for a fit.

    Parameters
    ----------
    encounters
        Encounter table, with one row for each recorded cut-in.
    source
        Description of the data.

    Returns
    -------
    figure, data
        The figure has cells of 5 m/s by 10 m with their counts. The data contain lower and upper edges and
        count of all cells.
    """
    names = ("lead_speed", "range")
    edges = [_edges(encounters[name], step) for name, step in zip(names, CELL, strict=True)]
    count = np.histogram2d(encounters["lead_speed"], encounters["range"], edges)[0].astype(int)
    with paper_style():
        drawn, axes = plt.subplots(figsize=(COLUMN_WIDTH, 3.0))
        shown = np.ma.masked_equal(count.T, 0)
        norm = LogNorm(vmin=1, vmax=1000 * max(count.max(), 2))  # light shades, on which numbers are readable
        axes.pcolormesh(*edges, shown, norm=norm, cmap="Greys", edgecolor="#909090", linewidth=0.3)
        _write_counts(axes, count, edges)
        axes.set(xlabel="lead speed $v_L$ [m/s]", ylabel="range $R$ [m]")
        axes.grid(visible=False)
        note_source(drawn, source)
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
    """Return consecutive multiples of a step that enclose all values; at least two."""
    first, last = np.floor(values.min() / step), np.ceil(values.max() / step)
    return np.arange(first, max(last, first + 1) + 1) * step


def _write_counts(axes: Axes, count: np.ndarray, edges: list[np.ndarray]) -> None:
    """Write the count into each cell, with a frame if it is smaller than a fit needs."""
    size = 5.5 if max(count.shape) <= 10 else 4
    for (i, j), number in np.ndenumerate(count):
        middle = [(along[k] + along[k + 1]) / 2 for along, k in zip(edges, (i, j), strict=True)]
        few = number < MINIMUM_ROWS
        axes.text(
            *middle,
            f"{number:,}",
            ha="center",
            va="center",
            fontsize=size,
            fontweight="bold" if few else "normal",
            bbox={"boxstyle": "square,pad=0.2", "fill": False, "linewidth": 0.6} if few else None,
        )


@figure
def fig27_row_order(encounters: pd.DataFrame, source: str) -> tuple[Figure, pd.DataFrame]:
    """Draw median and 95 % quantile of lead speed, range and TTC^-1 in blocks of consecutive rows.

    Parameters
    ----------
    encounters
        Encounter table, whose rows are in the order of the records.
    source
        Description of the data.

    Returns
    -------
    figure, data
        The figure has a panel for each quantity. The data contain, for each block, its first and last row,
        and median and 95 % quantile of each quantity.
    """
    blocks = np.array_split(np.arange(len(encounters)), min(BLOCKS, max(len(encounters) // 20, 1)))
    rows = [_digest(encounters.iloc[block], block) for block in blocks]
    data = pd.DataFrame(rows)
    middle = (data["first_row"] + data["last_row"]) / 2
    with paper_style():
        drawn, axes = plt.subplots(3, 1, figsize=(COLUMN_WIDTH, 4.4), sharex=True)
        for axis, (name, (unit, label)) in zip(axes, DRAWN.items(), strict=True):
            whole = encounters[name].quantile([0.5, 0.95])
            for quantile, color, marker, word in (
                (0.5, PIECES[0], "o", "median"),
                (0.95, PIECES[1], "s", "95 %"),
            ):
                column = data[f"{name}_q{100 * quantile:.0f}_{unit}"]
                axis.plot(middle, column, marker=marker, markersize=2.5, color=color, label=word)
                axis.axhline(whole[quantile], color=color, linewidth=0.7, linestyle="--")
            axis.set_ylabel(label)
            axis.set_ylim(bottom=0)
        axes[0].legend(loc="lower right", ncols=2)
        axes[-1].set_xlabel("row of the encounter table")
        axes[-1].xaxis.set_major_locator(MaxNLocator(4))
        axes[-1].xaxis.set_major_formatter("{x:,.0f}")
        note_source(drawn, source)
    return drawn, data


def _digest(rows: pd.DataFrame, place: np.ndarray) -> Mapping[str, float]:
    digest = {"first_row": place[0] + 1, "last_row": place[-1] + 1}
    for name, (unit, _) in DRAWN.items():
        for quantile in (0.5, 0.95):
            digest[f"{name}_q{100 * quantile:.0f}_{unit}"] = rows[name].quantile(quantile)
    return digest
