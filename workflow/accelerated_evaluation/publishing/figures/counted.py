"""Figure 31, beyond the paper: crashes as predicted, replayed and counted."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from accelerated_evaluation.publishing.figures.dot_chart import (
    FRAME,
    ROW,
    finish,
    name_rows,
    scale_logarithmically,
    spaced,
)
from accelerated_evaluation.publishing.figures.style import COLUMN_WIDTH, PIECES, Drawn, Look, note_source
from accelerated_evaluation.publishing.published import figure
from accelerated_evaluation.publishing.tables.display import NAMES, vehicles_in_words

GROUPS = {
    "predicted": "predicted crashes of closing cut-ins",
    "replayed": "recorded near-crashes, replayed",
    "counted crash": "counted crashes, 100-Car study",
    "counted near-crash": "counted near-crashes, 100-Car study",
    "counted other": "published crash rates of other kinds",
}
MARKERS = {"predicted": ("o", PIECES[0]), "replayed": ("D", PIECES[1]), "counted": ("s", "black")}
# Sources of counts whose names in the table do not say what was counted.
SOURCES = {
    "GES 1999": "lane changes, reported to the police, 1999",
    "Human benchmark, police-reported": "of every kind, reported to the police",
    "Human benchmark, any injury reported": "of every kind, any injury reported",
}


def rows_to_draw(counted: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of the chart, sorted by the group to which they belong.

    Return the same rows with two more columns: ``group``, one of `GROUPS`, and ``label``, the name of the row
    in the chart.
    """
    severity = counted["what"].str.extract(r"^(crash|near-crash): ", expand=False).fillna("other")
    is_count = counted["kind"] == "counted"
    groups = np.where(is_count, "counted " + severity, counted["kind"])
    what = counted["what"].str.replace(r"^(?:crash|near-crash): ", "", regex=True)
    label = np.where(is_count & (severity != "other"), what, _in_words(counted["who"]))
    order = pd.Categorical(groups, list(GROUPS), ordered=True)
    drawn = counted.assign(group=order, label=label).sort_values("group", kind="stable")
    return drawn.assign(group=drawn["group"].astype(str).map(GROUPS)).reset_index(drop=True)


def _in_words(who: pd.Series) -> pd.Series:
    """Write codes of vehicles and of sources in words, shape (n,)."""
    known = vehicles_in_words(who).replace(SOURCES)
    return known.str.replace("cc_human in", f"{NAMES['cc_human']} in", regex=False)


@figure
def fig31_counted_crashes(counted_crashes: pd.DataFrame, source: str) -> Drawn:
    """Draw predicted, replayed and counted crash rates per million miles with their 95 % limits.

    Return the figure and its rows as from `rows_to_draw`.
    """
    rows = rows_to_draw(counted_crashes)
    y = spaced(rows["group"], 1.6)
    drawn, axes = plt.subplots(figsize=(2 * COLUMN_WIDTH, FRAME + ROW * (y[-1] + 3)))
    for kind, (marker, color) in MARKERS.items():
        of_kind = (rows["kind"] == kind).to_numpy()
        chosen = rows[of_kind]
        rate = chosen["per_million_miles"].where(chosen["per_million_miles"] > 0)
        reach = [rate - chosen["low95"].fillna(rate), chosen["high95"].fillna(rate) - rate]
        look: Look = {"color": color, "linestyle": "none", "markersize": 3.5}
        label = f"{kind}, 95 % limits"
        axes.errorbar(rate, y[of_kind], xerr=reach, elinewidth=0.8, marker=marker, label=label, **look)
    none = (rows["per_million_miles"] == 0).to_numpy()
    if none.any():
        look = {"color": "black", "linestyle": "none", "markersize": 4}
        axes.plot(rows["high95"][none], y[none], marker="<", label="none counted: upper 95 % limit", **look)
    scale_logarithmically(axes, "crashes or near-crashes per million miles")
    name_rows(axes, y, rows["group"], rows["label"])
    finish(drawn, axes)
    note_source(drawn, f"{source}, and the 100-Car study")
    return drawn, rows
