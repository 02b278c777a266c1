"""Figures 32 and 33, beyond the paper: injured drivers, and the published curves of the risk of injury."""

from itertools import product

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from accelerated_evaluation.answer.injuries.curves import FRONTAL, KILOMETRES_PER_HOUR, LEVELS, REAR
from accelerated_evaluation.answer.injuries.sources import published_curves
from accelerated_evaluation.answer.injuries.tables import PER_ENCOUNTER
from accelerated_evaluation.publishing.figures.dot_chart import DOT, FRAME, ROW, finish, name_rows, spaced
from accelerated_evaluation.publishing.figures.style import (
    COLUMN_WIDTH,
    note_source,
    paper_style,
    say_no_crash,
)
from accelerated_evaluation.publishing.published import figure
from accelerated_evaluation.publishing.tables.display import vehicles_in_words
from accelerated_evaluation.publishing.tables.exact import best_known

TITLES = {"MAIS2+": "at least moderate (MAIS2+)", "MAIS3+": "at least serious (MAIS3+)", "fatal": "fatal"}
IMPACTS = {FRONTAL: "struck in front", REAR: "struck from behind"}
LOWEST = {"MAIS2+": 1e-3, "MAIS3+": 1e-4, "fatal": 1e-5}  # smallest risk that figure 33 shows
# Styles of the sources, which differ by dashes and markers in grey as well.
LOOKS = tuple(
    {"color": color, "linestyle": line, "marker": marker, "markersize": 3.5, "linewidth": 1.0}
    for color, line, marker in zip(
        ("#08306b", "#a63603", "#41ab5d", "#6a51a3", "#737373", "#dd3497"),
        ("-", "--", "-.", ":", (0, (6, 1, 1, 1, 1, 1)), (0, (8, 2))),
        "os^Dvx",
        strict=True,
    )
)
DELTA_V = np.linspace(0, 80, 161)  # [km/h]


@figure
def fig32_injuries(
    injuries: pd.DataFrame, injuries_by_curve: pd.DataFrame, source: str
) -> tuple[Figure, pd.DataFrame]:
    """Draw the expected number of injured drivers for each vehicle and level of injury, with 80 % intervals.

    Small strokes show the medians if only one pair of risk curves is used instead of all.

    Return the figure and the rows of both tables that it shows.
    """
    rows = best_known(injuries)
    rows = rows[rows["median"] > 0].assign(level=lambda of: pd.Categorical(of["level"], LEVELS, ordered=True))
    rows = rows.sort_values("level", kind="stable").astype({"level": str}).reset_index(drop=True)
    per = rows["per"].iloc[0] if len(rows) else PER_ENCOUNTER
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
            name_rows(axes, y, rows["level"].map(TITLES), vehicles_in_words(rows["vehicle"]))
        axes.set_xlabel(f"injured drivers, of both cars, per {per}")
        finish(drawn, axes, source)
    return drawn, pd.concat([rows, curves.assign(per=per)], ignore_index=True)


def _in_rows(by_curve: pd.DataFrame, injuries: pd.DataFrame, rows: pd.DataFrame) -> pd.DataFrame:
    """Return the medians of single pairs of curves, converted from "per cut-in" to the unit of the rows."""
    keys = ["vehicle", "level"]
    per_cut_in = injuries[injuries["per"] == PER_ENCOUNTER].set_index(keys)["mean"]
    factor = (rows.set_index(keys)["mean"] / per_cut_in).dropna().rename("factor").reset_index()
    found = by_curve.merge(factor, on=keys)
    return found.assign(median=found["median"] * found["factor"])[[*keys, FRONTAL, REAR, "median"]]


@figure
def fig33_risk_curves() -> tuple[Figure, pd.DataFrame]:
    """Draw all published curves of the risk of injury against the change of speed in the crash, delta-v.

    The figure has a panel for each level of injury and side of the impact. The columns of the data are level,
    impact (front or rear), source, delta_v_km_h and probability.
    """
    curves = {(level, impact): published_curves(level, impact) for level in LEVELS for impact in IMPACTS}
    sources = sorted({name for found in curves.values() for name in found})
    looks = dict(zip(sources, LOOKS, strict=False))
    rows = []
    with paper_style():
        size = (2 * COLUMN_WIDTH, 4.6)
        drawn, all_axes = plt.subplots(2, len(LEVELS), sharex=True, sharey="col", figsize=size)
        for (row, impact), (column, level) in product(enumerate(IMPACTS), enumerate(LEVELS)):
            axes = all_axes[row, column]
            for name, curve in curves[level, impact].items():
                risk = curve(DELTA_V * KILOMETRES_PER_HOUR)
                place = sources.index(name)
                axes.plot(DELTA_V, risk, label=name, markevery=(4 * place, 28), **looks[name])
                rows += [(level, impact, name, *at) for at in zip(DELTA_V, risk, strict=True)]
            title = f"({'abcdef'[row * len(LEVELS) + column]}) {TITLES[level]},\n{IMPACTS[impact]}"
            axes.set_title(title, loc="left")
            axes.set(yscale="log", ylim=(LOWEST[level], 1))
        for axes in all_axes[:, 0]:
            axes.set_ylabel("probability of the injury")
        for axes in all_axes[-1]:
            axes.set_xlabel(r"$\Delta v$ [km/h]")
        handles = [Line2D([], [], label=name, **looks[name]) for name in sources]
        drawn.legend(handles=handles, loc="outside upper center", ncols=3)
        note_source(drawn, "published curves")
    return drawn, pd.DataFrame(rows, columns=["level", "impact", "source", "delta_v_km_h", "probability"])
