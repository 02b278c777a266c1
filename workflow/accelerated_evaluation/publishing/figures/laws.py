"""Figures 21 and 22, beyond the paper: scores and calibration of laws."""

import re

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from accelerated_evaluation.answer.candidates.calibration import HOST
from accelerated_evaluation.answer.candidates.law_table import ERRORS
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.publishing.figures.dot_chart import FRAME, ROW, name_rows, spaced
from accelerated_evaluation.publishing.figures.style import COLUMN_WIDTH, Drawn, note_source
from accelerated_evaluation.publishing.published import figure

DEFENDED, PAPER = "#08306b", "#b2182b"
REGIONS = {
    "gain_inverse_ttc_0.25": "(a) records,\n$TTC^{-1}$ > 0.25/s",
    "gain_simulated_ttc_2": "(b) simulated\nTTC < 2 s",
}
MIXTURE = "all laws, weighted"
# Beginnings of the names of laws in words; a quantile at the end of a name is where the tail begins.
TAILS = {"generalised": "generalised Pareto", "two kinds": "two kinds of drivers", "paper: ": "paper's: "}
TAILS |= {"hazard": "smooth hazard alone"}
BLANK = {"facecolor": "white", "edgecolor": "none", "pad": 0.5}  # hides the lines behind a text
MARGIN = 1.5  # the largest difference of an accepted law, times this, is the end of a panel of figure 21
# What the figure counts: the quantity in the table, and the heading of its rows.
COUNTED = {"closing speed": "records by range", "replay": "replayed records"}


@figure
def fig21_scores(laws: pd.DataFrame) -> Drawn:
    """Draw how far the held-out score of each law is below that of the best law, and the weight of the law.

    Laws that the records contradict have hollow markers.

    The first panels show the differences [nats] in the `REGIONS`, and the third one the largest difference of
    all regions in standard errors. The fourth panel shows the weights. The data are the table itself, with a
    column ``below_...`` for each of the first panels.
    """
    single = laws["law"] != MIXTURE
    below = {region: laws.loc[single, region].max() - laws[region] for region in REGIONS}
    data = laws.assign(**{name.replace("gain", "below"): values for name, values in below.items()})
    y = np.arange(len(laws))
    size = (2 * COLUMN_WIDTH, FRAME + ROW * (len(laws) + 1))
    drawn, all_axes = plt.subplots(1, len(REGIONS) + 2, sharey=True, figsize=size)
    for axes, (region, title) in zip(all_axes, REGIONS.items(), strict=False):
        error = laws[region.replace("gain", "error")]
        _draw_differences(axes, y, below[region], laws["refused"], error)
        axes.set(title=title, xlabel="below the\nbest [nats]")
    errors, weights = all_axes[len(REGIONS) :]
    _draw_differences(errors, y, laws["behind"].where(single), laws["refused"])
    errors.axvline(ERRORS, color="black", linewidth=0.8, linestyle="--")
    errors.set(title="(c) largest\nof six regions", xlabel="below the best\n[standard errors]")
    weights.set_axisbelow(True)
    weights.barh(y[single], laws["weight"][single], height=0.6, color=DEFENDED)
    weights.set(title="(d) weight in\nthe answer", xlabel="weight")
    all_axes[0].set_yticks(y, laws["law"].map(law_in_words))
    all_axes[0].invert_yaxis()
    return drawn, data


def law_in_words(name: str) -> str:
    """Return the name of a law in words, such as "exponential above 92.5 %" for "exponential 0.925"."""
    for code, words in TAILS.items():
        name = re.sub(f"^{code}", words, name)
    return re.sub(r"0\.\d+$", lambda quantile: f"above {100 * float(quantile[0]):g} %", name)


def _draw_differences(
    axes: Axes, y: Array, below: pd.Series, refused: pd.Series, error: pd.Series | float = 0.0
) -> None:
    """Draw the differences of accepted laws and the near ones; others are written as numbers at the edge."""
    end = MARGIN * (below + error)[~refused | refused.all()].max()
    far = (below > end).to_numpy()
    for rows, fill in ((~refused & ~far, DEFENDED), (refused & ~far, "white")):
        axes.plot(below[rows], y[rows], "o", color=DEFENDED, markersize=3.5, markerfacecolor=fill)
        if np.any(error):
            ends = (below - error)[rows], (below + error)[rows]
            axes.hlines(y[rows], *ends, color=DEFENDED, linewidth=0.7, zorder=1)
    for at, value in zip(y[far], below[far], strict=True):
        axes.text(end, at, f"{value:,.0f} →", ha="right", va="center", fontsize=6, bbox=BLANK)
    axes.set_xlim(min(0, (below - error).min()) - 0.08 * end, 1.05 * end)


@figure
def fig22_calibration(calibration: pd.DataFrame, source: str) -> Drawn:
    """Draw recorded and expected numbers of cut-ins in the regions that are nearest to the crash set.

    These are the cell of the largest closing speeds of each range, the crashes of replayed records, and the
    near misses with the widest threshold, which include the others.

    Return the figure and ``calibration`` with the column ``drawn``, which is True in the rows of the figure.
    """
    names = calibration["law"].unique()
    calibration = calibration.assign(drawn=_nearest(calibration) & calibration["law"].isin(names[[0, -1]]))
    shown = calibration[calibration["drawn"]].assign(what=calibration["counted"].map(COUNTED))
    defended, paper = (shown[shown["law"] == name] for name in (names[0], names[-1]))
    drawn, axes = plt.subplots(figsize=(1.4 * COLUMN_WIDTH, FRAME + ROW * (len(defended) + 6)))
    y = spaced(defended["what"], 1.6)
    place = dict(zip(defended["where"], y, strict=True))
    _draw_limits(axes, y - 0.15, defended, ("o", DEFENDED), law_in_words(names[0]))
    _draw_limits(axes, paper["where"].map(place).to_numpy() + 0.2, paper, ("s", PAPER), "paper's law")
    axes.plot(defended["recorded"], y, "k|", markersize=6, label="recorded")
    axes.set_xscale("symlog", linthresh=1, subs=range(2, 10))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.set(xlim=(-0.1, None), xlabel="distinct records (linear below 1, logarithmic above)")
    names = defended["where"].str.replace(r"^R (.*), ", r"\1, closing ", regex=True)
    name_rows(axes, y, defended["what"], names.str.replace(" to ", "–", regex=False))
    axes.set_ylim(y.max() + 1, -2)
    drawn.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    note_source(drawn, f"{source}. Bars: expected, with 90 % Poisson limits")
    return drawn, calibration


def _nearest(calibration: pd.DataFrame) -> pd.Series:
    """Return for each row whether its region is the nearest one to the crash set, or contains the others."""
    kind = calibration["where"].str.replace(r", .*| at most .*| above .*", "", regex=True)
    last = ~calibration.assign(kind=kind).duplicated(["law", "counted", "kind"], keep="last")
    return last & (calibration["counted"] != HOST) & (kind != "impact")


def _draw_limits(axes: Axes, y: Array, rows: pd.DataFrame, look: tuple[str, str], label: str) -> None:
    marker, color = look
    expected = rows["expected"].to_numpy()
    reach = np.abs(rows[["low", "high"]].to_numpy().T - expected)
    axes.errorbar(
        expected,
        y,
        xerr=reach,
        linestyle="none",
        marker=marker,
        markersize=2.5,
        color=color,
        elinewidth=0.8,
        label=label,
    )
