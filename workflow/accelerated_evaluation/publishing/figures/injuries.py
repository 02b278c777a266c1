"""Figure 32, beyond the paper: injured drivers."""

import matplotlib.pyplot as plt
import pandas as pd

from accelerated_evaluation.answer.consequences.injuries.curves import FRONTAL, LEVELS, REAR
from accelerated_evaluation.answer.consequences.injuries.tables import PER_ENCOUNTER
from accelerated_evaluation.publishing.figures.dot_chart import DOT, FRAME, ROW, finish, name_rows, spaced
from accelerated_evaluation.publishing.figures.style import COLUMN_WIDTH, Drawn, Look, say_no_crash
from accelerated_evaluation.publishing.published import figure
from accelerated_evaluation.publishing.tables.display import vehicles_in_words
from accelerated_evaluation.publishing.tables.exact import best_known

TITLES = {"MAIS2+": "at least moderate (MAIS2+)", "MAIS3+": "at least serious (MAIS3+)", "fatal": "fatal"}


@figure
def fig32_injuries(injuries: pd.DataFrame, injuries_by_curve: pd.DataFrame) -> Drawn:
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
    drawn, axes = plt.subplots(figsize=(2 * COLUMN_WIDTH, FRAME + ROW * (max(len(rows), 3) + 9)))
    if rows.empty:
        say_no_crash(axes)
    else:
        place = dict(zip(zip(rows["vehicle"], rows["level"], strict=True), y, strict=True))
        at = [place[key] for key in zip(curves["vehicle"], curves["level"], strict=True)]
        style: Look = {"marker": "|", "linestyle": "none", "color": "#737373", "markersize": 5}
        axes.plot(curves["median"], at, label="median with one pair of curves", **style)
        reach = [rows["median"] - rows["low80"], rows["high80"] - rows["median"]]
        label = "median and 80 % interval"
        axes.errorbar(rows["median"], y, xerr=reach, elinewidth=0.8, label=label, **DOT)
        axes.set(xscale="log")
        name_rows(axes, y, rows["level"].map(TITLES), vehicles_in_words(rows["vehicle"]))
    axes.set_xlabel(f"injured drivers, of both cars, per {per}")
    finish(drawn, axes)
    return drawn, pd.concat([rows, curves.assign(per=per)], ignore_index=True)


def _in_rows(by_curve: pd.DataFrame, injuries: pd.DataFrame, rows: pd.DataFrame) -> pd.DataFrame:
    """Return the medians of single pairs of curves, converted from "per cut-in" to the unit of the rows."""
    keys = ["vehicle", "level"]
    per_cut_in = injuries[injuries["per"] == PER_ENCOUNTER].set_index(keys)["mean"]
    factor = (rows.set_index(keys)["mean"] / per_cut_in).dropna().rename("factor").reset_index()
    found = by_curve.merge(factor, on=keys)
    return found.assign(median=found["median"] * found["factor"])[[*keys, FRONTAL, REAR, "median"]]
