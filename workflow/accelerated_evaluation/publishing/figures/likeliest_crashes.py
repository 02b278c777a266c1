"""Figure 28, beyond the paper: probable crashes over time."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from accelerated_evaluation.base.percent import in_percent
from accelerated_evaluation.publishing.figures.dot_chart import in_math
from accelerated_evaluation.publishing.figures.style import (
    COLUMN_WIDTH,
    Drawn,
    note_source,
    say_no_crash,
    say_unknown,
)
from accelerated_evaluation.publishing.published import figure

CRASHES = 4  # largest number of crashes that are drawn
LETTERS = "abcd"
HOST, LEAD, EMERGENCY = "#08306b", "#777777", "#d9d9d9"
AFTER = 0.5  # [s], time for which a trace is drawn after its smallest range


@figure
def fig28_ways_to_crash(happened: pd.DataFrame, traces: pd.DataFrame, source: str) -> Drawn:
    """Draw speeds and range over time for the most probable kinds of crashes, with the probability of each.

    The figure has a pair of panels for each of the `CRASHES` kinds with the largest probability. The data
    have a row for each encounter and time.
    """
    crashes = happened[happened["kind"] == "crash"]
    shown = crashes.sort_values("probability", ascending=False, kind="stable").head(CRASHES)
    share = shown["probability"] / crashes["probability"].sum()
    titles = [
        f"({letter}) {in_percent(part)} of the crashes:\n{in_math(probability)} per cut-in"
        for letter, part, probability in zip(LETTERS, share, shown["probability"], strict=False)
    ]
    drawn, data = _draw(shown, traces, titles)
    note_source(drawn, f"simulated under a law fitted to {source}")
    return drawn, data


def _draw(shown: pd.DataFrame, traces: pd.DataFrame, titles: list[str]) -> Drawn:
    """Draw a pair of panels for each encounter, speeds above and range below."""
    rows = shown.to_dict("records")
    parts = [_part(traces, row) for row in rows]
    data = shown.merge(pd.concat(parts), on=["kind", "number"]) if parts else shown
    if data.empty:
        drawn, axes = plt.subplots()
        say_unknown(axes) if rows else say_no_crash(axes)
        return drawn, data
    drawn, (uppers, lowers) = plt.subplots(2, CRASHES, sharex=True, figsize=(2 * COLUMN_WIDTH, 3.5))
    _share_axes(uppers, lowers, data)
    for upper, lower, *panel in zip(uppers, lowers, parts, rows, titles, strict=False):
        _draw_one(upper, lower, *panel)
    for axes in [*uppers[len(rows) :], *lowers[len(rows) :]]:
        axes.set_visible(False)
    drawn.legend(*uppers[0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
    return drawn, data


def _share_axes(uppers: np.ndarray, lowers: np.ndarray, data: pd.DataFrame) -> None:
    """Give all panels, a row above and a row below, the same scales, and label those on the edges."""
    end, top = data["time_s"].max(), 1.05 * data[["host_speed_m_per_s", "range_m"]].max()
    for panels, label, largest in ((uppers, "speed [m/s]", top.iloc[0]), (lowers, "range [m]", top.iloc[1])):
        for axes in panels:
            axes.set(xlim=(0, end), ylim=(0, largest))
            axes.tick_params(labelleft=axes is panels[0], labelbottom=panels is lowers)
        panels[0].set_ylabel(label)
    for axes in lowers:
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
    upper.plot(time, trace["host_speed_m_per_s"], color=HOST, label="car under test")
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
    lower.plot(time.iloc[-1], 0, "X", color="black", markersize=6, clip_on=False, zorder=5)
    upper.plot([], [], "X", color="black", markersize=6, linestyle="none", label="crash")
    words = (
        f"other car {row['lead_speed']:.1f} m/s, range {row['range']:.1f} m,\n"
        f"closing speed {row['closing_speed']:.1f} m/s"
    )
    impact = f"impact {row['impact_speed']:.1f} m/s"
    upper.set_title(f"{title}\n{words}\n{impact}", fontsize=6.5, loc="left")
