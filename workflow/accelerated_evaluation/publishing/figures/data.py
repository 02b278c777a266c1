"""The idea of accelerated evaluation (figure 1), and the recorded lane changes."""

from collections.abc import Mapping, Sequence

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm

from accelerated_evaluation.laws import Factors
from accelerated_evaluation.laws.distributions import Distribution
from accelerated_evaluation.laws.paper.models import IndependentLaw
from accelerated_evaluation.publishing.figures.curves import (
    INVERSE_TTC,
    RECORDS,
    Curve,
    density_table,
    draw_curve,
    draw_histogram,
    histogram,
)
from accelerated_evaluation.publishing.figures.style import COLUMN_WIDTH, Drawn
from accelerated_evaluation.publishing.published import figure

DENSITIES = {
    "f": ("fitted $f$", {"color": "#08306b", "linestyle": "-", "marker": "o"}),
    "f*": ("accelerated $f^*$", {"color": "#b2182b", "linestyle": "--", "marker": "s"}),
}
TITLES = {"single": "(a) single parametric distribution", "piecewise": "(b) piecewise mixture; marker: knot"}
POINTS = 300
MAPS = {
    "range": ("m", "range", "$R$ [m]"),
    "inverse_ttc": ("per_s", "inverse time to collision", "$TTC^{-1}$ [1/s]"),
}
BINS = 50


@figure
def fig01_concept(
    encounters: pd.DataFrame,
    single: IndependentLaw,
    piecewise: IndependentLaw,
    proposals: Mapping[str, Mapping[str, Factors]],
    segment: str,
) -> Drawn:
    """Draw the acceleration by a single parametric and by a piecewise mixture distribution (paper, figure 1).

    The figure has a panel for each method, with the histogram of the records, f and f*. The data contain
    everything that is drawn, with columns method, curve, inverse_ttc_per_s, bin_width_per_s, count, density_s
    and is_knot.
    """
    x = encounters.loc[encounters["segment"] == segment, "inverse_ttc"].to_numpy()
    records = histogram(x, np.linspace(0.0, 1.05 * x.max(), BINS + 1), INVERSE_TTC)
    laws = {"single": single, "piecewise": piecewise}
    tables = []
    drawn, axes = plt.subplots(2, 1, figsize=(COLUMN_WIDTH, 4.0), sharex=True, sharey=True)
    for axis, (method, title) in zip(axes, TITLES.items(), strict=True):
        both = laws[method].inverse_ttc[segment], proposals[method][segment].second
        draw_histogram(axis, records, INVERSE_TTC, f"{RECORDS}, n = {x.size:,}")
        tables.append(_draw_densities(axis, both, 1.05 * x.max(), records).assign(method=method))
        axis.set_title(title, loc="left")
        axis.set_ylabel("density [s]")
    axes[-1].set_xlabel(f"$TTC^{{-1}}$ [1/s], $v_L$ {segment.replace('-', '–')} m/s")
    drawn.legend(*axes[1].get_legend_handles_labels(), loc="outside upper left", ncols=1)
    table = pd.concat(tables, ignore_index=True).astype({"count": "Int64", "is_knot": "boolean"})
    return drawn, table[["method", *table.columns.drop("method")]]


def _draw_densities(
    axis: Axes, laws: tuple[Distribution, Distribution], end: float, records: pd.DataFrame
) -> pd.DataFrame:
    """Draw the densities f and f* up to ``end`` [1/s].

    Return the rows of the data of the figure: those of the records, of f and of f*.
    """
    parts = [records]
    for (name, (label, style)), law in zip(DENSITIES.items(), laws, strict=True):
        curve = Curve(law, style)
        parts.append(density_table(name, curve, np.linspace(0.0, end, POINTS), INVERSE_TTC))
        draw_curve(axis, parts[-1], (INVERSE_TTC.column, INVERSE_TTC.density), label, curve)
    return pd.concat(parts)


@figure
def fig02_data(encounters: pd.DataFrame, lead_speed_edges: Sequence[float]) -> Drawn:
    """Draw the number of lane changes by lead speed and range, and by lead speed and TTC^-1 (figure 2).

    The figure has two maps of counts. The data contain the counts of all bins with at least one event: panel,
    lower and upper edges of lead_speed [m/s] and of range [m] or inverse_ttc [1/s], and count. The data
    contain no single records.
    """
    speeds = np.linspace(lead_speed_edges[0], lead_speed_edges[-1], BINS + 1)
    tables = []
    drawn, axes = plt.subplots(2, 1, figsize=(COLUMN_WIDTH, 4.2), sharex=True)
    for axis, letter, (name, (unit, title, label)) in zip(axes, "ab", MAPS.items(), strict=True):
        edges = np.linspace(0.0, np.ceil(10 * encounters[name].max()) / 10, BINS + 1)
        count = np.histogram2d(encounters["lead_speed"], encounters[name], (speeds, edges))[0].astype(int)
        tables.append(_count_table(name, unit, count, speeds, edges))
        _draw_map(axis, count, speeds, edges)
        for edge in lead_speed_edges[1:-1]:
            axis.axvline(edge, color="black", linewidth=0.8, linestyle="--")
        axis.set_title(f"({letter}) {title}, n = {count.sum():,}", loc="left")
        axis.set_ylabel(label)
    axes[-1].set_xlabel("lead speed $v_L$ [m/s]")
    return drawn, pd.concat(tables, ignore_index=True)


def _draw_map(axis: Axes, count: np.ndarray, speeds: np.ndarray, edges: np.ndarray) -> None:
    """Shade the bins with events, as pixels also in the vector formats; shapes as in `_count_table`."""
    filled = np.ma.masked_equal(count.T, 0)
    shade = axis.pcolormesh(speeds, edges, filled, norm=LogNorm(vmin=1), cmap="cividis_r", rasterized=True)
    axis.figure.colorbar(shade, ax=axis, label="lane changes per bin")
    axis.grid(visible=False)


def _count_table(
    name: str, unit: str, count: np.ndarray, speeds: np.ndarray, edges: np.ndarray
) -> pd.DataFrame:
    """Return a row for each bin with events; ``count`` has shape (len(speeds) - 1, len(edges) - 1)."""
    row, column = np.nonzero(count)
    return pd.DataFrame(
        {
            "panel": name,
            "lead_speed_low_m_per_s": speeds[row],
            "lead_speed_high_m_per_s": speeds[row + 1],
            f"{name}_low_{unit}": edges[column],
            f"{name}_high_{unit}": edges[column + 1],
            "count": count[row, column],
        }
    )
