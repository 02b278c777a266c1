"""Figures 21 to 23 and 25, beyond the paper: scores and calibration of laws, the answer, and vehicles."""

import re

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from accelerated_evaluation.answer.calibration import HOST
from accelerated_evaluation.answer.law_table import ERRORS
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.publishing.figures.dot_chart import (
    FRAME,
    ROW,
    name_rows,
    scale_logarithmically,
    spaced,
)
from accelerated_evaluation.publishing.figures.style import (
    COLUMN_WIDTH,
    note_source,
    paper_style,
    say_no_crash,
)
from accelerated_evaluation.publishing.published import figure
from accelerated_evaluation.publishing.tables.display import vehicles_in_words
from accelerated_evaluation.scenarios.protocol import Scenario

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


@figure
def fig21_scores(laws: pd.DataFrame, source: str) -> tuple[Figure, pd.DataFrame]:
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
    with paper_style():
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
        note_source(drawn, source)
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


# What the figure counts: the quantity in the table, and the heading of its rows.
COUNTED = {"closing speed": "records by range", "replay": "replayed records"}


@figure
def fig22_calibration(calibration: pd.DataFrame, source: str) -> tuple[Figure, pd.DataFrame]:
    """Draw recorded and expected numbers of cut-ins in the regions that are nearest to the crash set.

    These are the cell of the largest closing speeds of each range, the crashes of replayed records, and the
    near misses with the widest threshold, which include the others.

    Return the figure and ``calibration`` with the column ``drawn``, which is True in the rows of the figure.
    """
    names = calibration["law"].unique()
    calibration = calibration.assign(drawn=_nearest(calibration) & calibration["law"].isin(names[[0, -1]]))
    shown = calibration[calibration["drawn"]].assign(what=calibration["counted"].map(COUNTED))
    defended, paper = (shown[shown["law"] == name] for name in (names[0], names[-1]))
    with paper_style():
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


# The row of the same records as the answer has fewer draws, so its numbers are slightly different.
SAME_READING = {"as in the answer": "as in the answer, fewer draws"}


ALONE = "error of the simulations alone"


@figure
def fig23_answer(
    answer: pd.DataFrame,
    scenario: Scenario,
    source: str,
    paper_interval: tuple[float, float] | None = None,
    answer_thresholds: pd.DataFrame | None = None,
    data_quality: pd.DataFrame | None = None,
    sampled_estimate: pd.DataFrame | None = None,
) -> tuple[Figure, pd.DataFrame]:
    """Draw the crash probability with its 50, 80 and 95 % intervals.

    Further rows show the probability with a single threshold of the laws' tails, and with other treatments of
    the records (``data_quality.csv``). Without these, the other events of the answer are drawn. If the answer
    comes from few runs, a row shows the 80 % interval of their error alone (``estimate.csv``).

    Return the figure and a table with a row for each row of the figure: the columns of the tables, group and
    name. Events whose probability is not known are left out.
    """
    known = answer.dropna(subset="median").assign(group="the answer")
    known["name"] = known["event"]
    if "encounters" in known:
        known["group"] = known["encounters"]
    if answer_thresholds is not None:
        known = known[known["event"] == "crash"].assign(name="all laws, all draws")
    parts = [known]
    if answer_thresholds is not None:
        names = answer_thresholds["level"].map("{:g}".format)
        parts.append(answer_thresholds.assign(group="one threshold of the tails", name=names))
    if data_quality is not None:
        names = data_quality["reading"].replace(SAME_READING)
        parts.append(data_quality.assign(group="other treatment of the records", name=names))
    if sampled_estimate is not None and len(known):
        ends = sampled_estimate[["probability", "ci_low", "ci_high"]].head(1)
        ends = ends.rename(columns={"ci_low": "low80", "ci_high": "high80"})
        parts.append(ends.assign(group=ALONE, name="crash, 80 %"))
    data = pd.concat(parts, ignore_index=True)
    with paper_style():
        y = spaced(data["group"], 1.6)
        size = (1.4 * COLUMN_WIDTH, FRAME + ROW * (y.max(initial=2) + 3))
        drawn, axes = plt.subplots(figsize=size)
        if data.empty:
            say_no_crash(axes)
        else:
            draw_nested(axes, y, data)
            name_rows(axes, y, data["group"], data["name"])
            axes.set_ylim(y.max() + 0.8, -1.6)
        if paper_interval is not None:
            axes.axvspan(*paper_interval, color=PAPER, alpha=0.4, linewidth=0, label="paper, 80 %")
        axes.set_xlabel(label := f"probability for {scenario.one}")
        if paper_interval is not None or (data["high80"] > 0).any():
            scale_logarithmically(axes, label)
        drawn.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=3)
        note_source(drawn, source)
    return drawn, data.drop(columns=["reading"], errors="ignore")


def draw_nested(axes: Axes, y: Array, rows: pd.DataFrame) -> None:
    """Draw 50, 80 and 95 % intervals over each other, the median as a stroke and the mean as a diamond."""
    for level, width in ((95, 0.8), (80, 2.2), (50, 4.5)):
        axes.hlines(
            y, rows[f"low{level}"], rows[f"high{level}"], color="#4292c6", linewidth=width, label=f"{level} %"
        )
    axes.plot(rows["median"], y, "|", color="black", markersize=6, label="median")
    axes.plot(rows["probability"], y, "D", color="black", markersize=2.5, label="mean")


@figure
def fig25_vehicles(vehicles: pd.DataFrame, scenario: Scenario, source: str) -> tuple[Figure, pd.DataFrame]:
    """Draw the crash probability of each vehicle, and its ratio to that of the careful human.

    The second panel is left out if the scenario has no reference vehicles.
    """
    shown = vehicles[vehicles["resolved"].astype(bool)].sort_values("median", kind="stable")
    y, widths = np.arange(len(shown)), (1.5, 1) if "ratio" in vehicles else (1.75,)
    with paper_style():
        size = (0.8 * sum(widths) * COLUMN_WIDTH, FRAME + 2 * ROW * max(len(shown), 3))
        drawn, ((left, *others),) = plt.subplots(
            1, len(widths), sharey=True, figsize=size, width_ratios=widths, squeeze=False
        )
        draw_nested(left, y, shown)
        left.set_title("(a) 50, 80 and 95 % intervals" if others else "", loc="left")
        scale_logarithmically(left, f"crash probability of {scenario.one}")
        left.set_yticks(y, vehicles_in_words(shown["vehicle"]))
        left.set_ylim(len(shown) - 0.5, -0.5)
        for right in others:
            right.hlines(y, shown["ratio_low80"], shown["ratio_high80"], color="#4292c6", linewidth=2.2)
            right.plot(shown["ratio"], y, "|", color="black", markersize=6)
            right.axvline(1, color="black", linewidth=0.6, linestyle=":")
            right.set_title("(b) 80 % interval", loc="left")
            scale_logarithmically(right, "ratio to the careful human")
        drawn.legend(*left.get_legend_handles_labels(), loc="outside upper center", ncols=5 if others else 3)
        note_source(drawn, source)
    return drawn, vehicles
