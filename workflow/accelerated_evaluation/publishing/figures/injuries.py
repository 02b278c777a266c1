"""Figures 32 and 33, beyond the paper: injured drivers, and the published curves of the risk of injury."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from accelerated_evaluation.answer.injuries.curves import FRONTAL, KILOMETRES_PER_HOUR, LEVELS, REAR
from accelerated_evaluation.answer.injuries.sources import published_curves
from accelerated_evaluation.publishing.figures.dot_chart import DOT, FRAME, ROW, finish, name_rows, spaced
from accelerated_evaluation.publishing.figures.style import (
    COLUMN_WIDTH,
    note_source,
    paper_style,
    say_no_crash,
)
from accelerated_evaluation.publishing.published import figure
from accelerated_evaluation.publishing.tables.injuries import CUT_IN, best_known

TITLES = {"MAIS2+": "at least moderate (MAIS2+)", "MAIS3+": "at least serious (MAIS3+)", "fatal": "fatal"}
LINES = {FRONTAL: "-", REAR: "--"}
COLORS = ("#08306b", "#a63603", "#41ab5d", "#6a51a3", "#737373", "#dd3497")
DELTA_V = np.linspace(0, 80, 161)  # [km/h]


@figure
def fig32_injuries(
    injuries: pd.DataFrame, injuries_by_curve: pd.DataFrame, source: str
) -> tuple[Figure, pd.DataFrame]:
    """Draw the expected number of injured drivers for each vehicle and level of injury, with 80 % intervals.

    Small strokes show the medians if only one pair of risk curves is used instead of all.

    Parameters
    ----------
    injuries, injuries_by_curve
        Tables ``injuries.csv`` and ``injuries_by_curve.csv`` of a study.
    source
        Description of the data.

    Returns
    -------
    figure, data
        The figure, and the rows of both tables that it shows.
    """
    rows = best_known(injuries)
    rows = rows[rows["median"] > 0].assign(level=lambda of: pd.Categorical(of["level"], LEVELS, ordered=True))
    rows = rows.sort_values("level", kind="stable").astype({"level": str}).reset_index(drop=True)
    per = rows["per"].iloc[0] if len(rows) else CUT_IN
    curves = _in_rows(injuries_by_curve, injuries, rows)
    y = spaced(rows["level"], 1.6)
    with paper_style():
        drawn, axes = plt.subplots(figsize=(2 * COLUMN_WIDTH, FRAME + ROW * (max(len(rows), 3) + 9)))
        if rows.empty:
            say_no_crash(axes)
        else:
            place = dict(zip(zip(rows["vehicle"], rows["level"], strict=True), y, strict=True))
            at = [place[key] for key in zip(curves["vehicle"], curves["level"], strict=True)]
            style = {"marker": "|", "linestyle": "none", "color": "#737373", "markersize": 5}
            axes.plot(curves["median"], at, label="median with one pair of curves", **style)
            reach = [rows["median"] - rows["low80"], rows["high80"] - rows["median"]]
            label = "median and 80 % interval"
            axes.errorbar(rows["median"], y, xerr=reach, elinewidth=0.8, label=label, **DOT)
            axes.set(xscale="log")
            name_rows(axes, y, rows["level"].map(TITLES), rows["vehicle"])
        axes.set(xlabel=f"injured drivers per {per}")
        finish(drawn, axes, source)
    return drawn, pd.concat([rows, curves.assign(per=per)], ignore_index=True)


def _in_rows(by_curve: pd.DataFrame, injuries: pd.DataFrame, rows: pd.DataFrame) -> pd.DataFrame:
    """Return the medians of single pairs of curves, converted from "per cut-in" to the unit of the rows."""
    keys = ["vehicle", "level"]
    per_cut_in = injuries[injuries["per"] == CUT_IN].set_index(keys)["mean"]
    factor = (rows.set_index(keys)["mean"] / per_cut_in).dropna().rename("factor").reset_index()
    found = by_curve.merge(factor, on=keys)
    return found.assign(median=found["median"] * found["factor"])[[*keys, FRONTAL, REAR, "median"]]


@figure
def fig33_risk_curves() -> tuple[Figure, pd.DataFrame]:
    """Draw all published curves of the risk of injury against the change of speed in the crash, delta-v.

    Returns
    -------
    figure, data
        The figure has a panel for each level of injury. The columns of the data are level, impact (front or
        rear), source, delta_v_km_h and probability.
    """
    curves = {(level, impact): published_curves(level, impact) for level in LEVELS for impact in LINES}
    sources = sorted({name for found in curves.values() for name in found})
    colors = dict(zip(sources, COLORS, strict=False))
    rows = []
    with paper_style():
        drawn, all_axes = plt.subplots(1, len(LEVELS), sharey=True, figsize=(2 * COLUMN_WIDTH, 2.4))
        for level, axes in zip(LEVELS, all_axes, strict=True):
            for impact, style in LINES.items():
                for name, curve in curves[level, impact].items():
                    risk = curve(DELTA_V * KILOMETRES_PER_HOUR)
                    axes.plot(DELTA_V, risk, linestyle=style, color=colors[name])
                    rows += [(level, impact, name, *at) for at in zip(DELTA_V, risk, strict=True)]
            axes.set(title=TITLES[level], xlabel=r"$\Delta v$ [km/h]", yscale="log", ylim=(1e-6, 1))
        all_axes[0].set(ylabel="probability of the injury")
        handles = [Line2D([], [], color=colors[name], label=name) for name in sources]
        handles += [Line2D([], [], color="black", linestyle=of, label=end) for end, of in LINES.items()]
        drawn.legend(handles=handles, loc="outside upper center", ncols=len(handles))
        note_source(drawn, "published curves")
    return drawn, pd.DataFrame(rows, columns=["level", "impact", "source", "delta_v_km_h", "probability"])
