"""The lane changes and what acceleration does to them: figures 1 and 2 of the paper."""

from collections.abc import Mapping, Sequence

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from accelerated_evaluation.distributions import Distribution
from accelerated_evaluation.laws.lane_change_model import LaneChangeModel
from accelerated_evaluation.problem import Proposal
from accelerated_evaluation.publishing.model_figures import (
    INVERSE_TTC,
    RECORDS,
    Curve,
    density_table,
    draw_curve,
    draw_histogram,
    histogram,
)
from accelerated_evaluation.publishing.style import COLUMN_WIDTH, note_source, paper_style

DENSITIES = {
    "f": ("fitted $f$", {"color": "#08306b", "linestyle": "-", "marker": "o"}),
    "f*": ("accelerated $f^*$", {"color": "#b2182b", "linestyle": "--", "marker": "s"}),
}
TITLES = {"single": "(a) single parametric distribution", "piecewise": "(b) piecewise mixture, knot marked"}
MAPS = {"range": ("m", "range $R$ [m]"), "inverse_ttc": ("per_s", "$TTC^{-1}$ [1/s]")}
BINS = 50
POINTS = 300


def fig01_concept(
    encounters: pd.DataFrame,
    models: Mapping[str, LaneChangeModel],
    proposals: Mapping[str, Proposal],
    segment: str,
    source: str,
) -> tuple[Figure, pd.DataFrame]:
    """Acceleration by a single parametric and by a piecewise mixture distribution (paper, figure 1).

    Parameters
    ----------
    encounters, segment
        Encounter table, and the segment of v_L whose TTC^-1 is shown.
    models, proposals
        f, and f* of that segment, both by method: single and piecewise.
    source
        What the encounters are, to be printed.

    Returns
    -------
    figure, data
        A panel a method, with the histogram of the records, f and f*; and all that is drawn: method, curve,
        inverse_ttc_per_s, bin_width_per_s, count, density_s, is_knot.
    """
    x = encounters.loc[encounters["segment"] == segment, "inverse_ttc"].to_numpy()
    records = histogram(x, np.linspace(0.0, 1.05 * x.max(), BINS + 1), INVERSE_TTC)
    tables = []
    with paper_style():
        figure, axes = plt.subplots(2, 1, figsize=(COLUMN_WIDTH, 4.0), sharex=True, sharey=True)
        for axis, (method, title) in zip(axes, TITLES.items(), strict=True):
            laws = models[method].inverse_ttc[segment], proposals[method].inverse_ttc
            draw_histogram(axis, records, INVERSE_TTC, f"{RECORDS}, n = {x.size:,}")
            tables.append(_draw_densities(axis, laws, 1.05 * x.max(), records).assign(method=method))
            axis.set_title(title, loc="left")
            axis.set_ylabel("density [s]")
        axes[-1].set_xlabel(f"$TTC^{{-1}}$ [1/s], $v_L$ {segment.replace('-', '–')} m/s")
        figure.legend(*axes[1].get_legend_handles_labels(), loc="outside upper left", ncols=2)
        note_source(figure, source)
    table = pd.concat(tables, ignore_index=True).astype({"count": "Int64", "is_knot": "boolean"})
    return figure, table[["method", *table.columns.drop("method")]]


def _draw_densities(
    axis: Axes, laws: tuple[Distribution, Distribution], end: float, records: pd.DataFrame
) -> pd.DataFrame:
    """Draw f and f* up to ``end`` and return their rows below those of the records."""
    parts = [records]
    for (name, (label, style)), law in zip(DENSITIES.items(), laws, strict=True):
        curve = Curve(law, style)
        parts.append(density_table(name, curve, np.linspace(0.0, end, POINTS), INVERSE_TTC))
        draw_curve(axis, parts[-1], (INVERSE_TTC.column, INVERSE_TTC.density), label, curve)
    return pd.concat(parts)


def fig02_data(
    encounters: pd.DataFrame, lead_speed_edges: Sequence[float], source: str
) -> tuple[Figure, pd.DataFrame]:
    """Range and inverse time to collision of the lane changes by lead speed, as counts (paper, figure 2).

    Parameters
    ----------
    encounters
        Encounter table.
    lead_speed_edges
        Edges of the segments [m/s].
    source
        What the encounters are, to be printed.

    Returns
    -------
    figure, data
        Two maps of counts, and the counts of all bins that hold an event: panel, lower and upper edges in
        lead_speed [m/s], range [m] or inverse_ttc [1/s], count. No record can be read off it.
    """
    speeds = np.linspace(lead_speed_edges[0], lead_speed_edges[-1], BINS + 1)
    tables = []
    with paper_style():
        figure, axes = plt.subplots(2, 1, figsize=(COLUMN_WIDTH, 4.2), sharex=True)
        for axis, letter, (name, (unit, label)) in zip(axes, "ab", MAPS.items(), strict=True):
            edges = np.linspace(0.0, np.ceil(10 * encounters[name].max()) / 10, BINS + 1)
            count = np.histogram2d(encounters["lead_speed"], encounters[name], (speeds, edges))[0].astype(int)
            tables.append(_count_table(name, unit, count, speeds, edges))
            _draw_map(axis, count, speeds, edges)
            for edge in lead_speed_edges[1:-1]:
                axis.axvline(edge, color="black", linewidth=0.8, linestyle="--")
            axis.set_title(f"({letter}) {count.sum():,} lane changes", loc="left")
            axis.set_ylabel(label)
        axes[-1].set_xlabel("lead speed $v_L$ [m/s]")
        note_source(figure, source)
    return figure, pd.concat(tables, ignore_index=True)


def _draw_map(axis: Axes, count: np.ndarray, speeds: np.ndarray, edges: np.ndarray) -> None:
    """Shade the bins that hold events, as pixels inside the vector formats; shapes as of `_count_table`."""
    filled = np.ma.masked_equal(count.T, 0)
    shade = axis.pcolormesh(speeds, edges, filled, norm=LogNorm(vmin=1), cmap="cividis_r", rasterized=True)
    axis.figure.colorbar(shade, ax=axis, label="lane changes per bin")
    axis.grid(visible=False)


def _count_table(
    name: str, unit: str, count: np.ndarray, speeds: np.ndarray, edges: np.ndarray
) -> pd.DataFrame:
    """List the bins that hold events; count has shape (speeds - 1, edges - 1)."""
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
