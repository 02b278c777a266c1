"""Figures 28 and 29, beyond the paper: the most probable crashes and the most critical records over time."""

from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from accelerated_evaluation.publishing.figures.style import (
    COLUMN_WIDTH,
    note_source,
    paper_style,
    say_no_crash,
)
from accelerated_evaluation.publishing.published import figure

COLUMNS, ROWS = 4, 3
LETTERS = "abcdefghijkl"
HOST, LEAD, EMERGENCY = "#08306b", "#777777", "#d9d9d9"
AFTER = 0.5  # [s], time for which a trace is drawn after its smallest range


@figure
def fig28_ways_to_crash(
    happened: pd.DataFrame, traces: pd.DataFrame, source: str
) -> tuple[Figure, pd.DataFrame]:
    """Draw speeds and range over time for the most probable kinds of crashes, with the probability of each.

    Parameters
    ----------
    happened, traces
        ``encounters.csv`` and ``traces.csv`` of a study's folder ``happened``: the encounters, and the states
        of both cars over time.
    source
        Description of the data.

    Returns
    -------
    figure, data
        The figure has a pair of panels for each crash. The data have a row for each encounter and time.
    """
    shown = happened[happened["kind"] == "crash"]
    share = shown["probability"] / shown["probability"].sum()
    titles = [
        f"{letter}  {part:.0%} of crashes: {probability:.1e}"
        for letter, part, probability in zip(LETTERS, share, shown["probability"], strict=False)
    ]
    return _draw(shown, traces, titles, source)


@figure
def fig29_nearest_records(
    happened: pd.DataFrame, traces: pd.DataFrame, source: str
) -> tuple[Figure, pd.DataFrame]:
    """Draw speeds and range over time for the recorded cut-ins that are most critical for the vehicle.

    These records come nearest to a crash when the vehicle is simulated in them.

    Parameters
    ----------
    happened, traces
        ``encounters.csv`` and ``traces.csv`` of a study's folder ``happened``: the encounters, and the states
        of both cars over time.
    source
        Description of the data.

    Returns
    -------
    figure, data
        The figure has a pair of panels for each record. The data have a row for each record and time.
    """
    shown = happened[happened["kind"] == "record"]
    titles = [
        f"{letter}  " + ("crash" if row["crash"] else f"smallest TTC {row['min_ttc']:.2f} s")
        for letter, row in zip(LETTERS, shown.to_dict("records"), strict=False)
    ]
    return _draw(shown, traces, titles, source)


def _draw(
    shown: pd.DataFrame, traces: pd.DataFrame, titles: list[str], source: str
) -> tuple[Figure, pd.DataFrame]:
    """Draw a pair of panels for each encounter, speeds above and range below."""
    rows = shown.to_dict("records")
    parts = [_part(traces, row) for row in rows]
    data = shown.merge(pd.concat(parts), on=["kind", "number"]) if parts else shown
    with paper_style():
        if data.empty:
            drawn, axes = plt.subplots()
            _say_unknown(axes) if rows else say_no_crash(axes)
            note_source(drawn, source)
            return drawn, data
        size = (2 * COLUMN_WIDTH, 2.3 * COLUMN_WIDTH)
        drawn, all_axes = plt.subplots(2 * ROWS, COLUMNS, sharex=True, figsize=size)
        uppers, lowers = all_axes[::2].ravel(), all_axes[1::2].ravel()
        _share_axes(uppers, lowers, data)
        for upper, lower, *panel in zip(uppers, lowers, parts, rows, titles, strict=False):
            _draw_one(upper, lower, *panel)
        for axes in [*uppers[len(rows) :], *lowers[len(rows) :]]:
            axes.set_visible(False)
        drawn.legend(*uppers[0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
        note_source(drawn, source)
    return drawn, data


def _share_axes(uppers: Sequence[Axes], lowers: Sequence[Axes], data: pd.DataFrame) -> None:
    """Give all panels the same scales, and label those on the edges."""
    end, top = data["time_s"].max(), 1.05 * data[["host_speed_m_per_s", "range_m"]].max()
    for row, label, largest in ((uppers, "speed [m/s]", top.iloc[0]), (lowers, "range [m]", top.iloc[1])):
        for place, axes in enumerate(row):
            axes.set(xlim=(0, end), ylim=(0, largest))
            axes.tick_params(labelleft=place % COLUMNS == 0, labelbottom=row is lowers)
            if place % COLUMNS == 0:
                axes.set_ylabel(label)
    for axes in lowers[-COLUMNS:]:
        axes.set_xlabel("time [s]")


def _part(traces: pd.DataFrame, row: dict) -> pd.DataFrame:
    """Return the trace of one encounter until shortly after its smallest range."""
    own = traces[(traces["kind"] == row["kind"]) & (traces["number"] == row["number"])]
    if own.empty:
        return own
    end = own["time_s"].iloc[int(np.argmin(own["range_m"]))] + AFTER
    return own[own["time_s"] <= end + 1e-9]


def _draw_one(upper: Axes, lower: Axes, trace: pd.DataFrame, row: dict, title: str) -> None:
    time = trace["time_s"]
    upper.plot(time, trace["host_speed_m_per_s"], color=HOST, label="host")
    upper.plot(time, trace["lead_speed_m_per_s"], color=LEAD, linestyle="--", label="other car")
    lower.plot(time, trace["range_m"].clip(lower=0), color=HOST)
    for axes in (upper, lower):
        axes.fill_between(
            time,
            0,
            1,
            where=trace["emergency"] == 1,
            transform=axes.get_xaxis_transform(),
            color=EMERGENCY,
            linewidth=0,
            label="emergency braking" if axes is upper else None,
        )
    if row["crash"]:
        end = trace["time_s"].iloc[-1]
        lower.plot(end, 0, "X", color="black", markersize=6, clip_on=False, zorder=5)
        upper.plot([], [], "X", color="black", markersize=6, linestyle="none", label="crash")
    words = f"$v_L$ {row['lead_speed']:.1f} m/s, $R$ {row['range']:.1f} m, $C$ {row['closing_speed']:.1f} m/s"
    end = f"impact {row['impact_speed']:.1f} m/s" if row["crash"] else f"range left {row['min_range']:.1f} m"
    upper.set_title(f"{title}\n{words}\n{end}", fontsize=5.5, loc="left")


def _say_unknown(axes: Axes) -> None:
    text = "the states of this vehicle are not known, only the outcomes"
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", va="center", color="#555555")
