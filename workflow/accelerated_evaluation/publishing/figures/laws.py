"""Figures 21 to 25, beyond the paper: scores and calibration of laws, the answer, coverage, and vehicles."""

from collections.abc import Iterable

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from accelerated_evaluation.answer.calibration import HOST
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.publishing.figures.dot_chart import FRAME, ROW, name_rows, spaced
from accelerated_evaluation.publishing.figures.style import COLUMN_WIDTH, note_source, paper_style
from accelerated_evaluation.publishing.published import figure

DEFENDED, PAPER = "#08306b", "#b2182b"
REGIONS = {
    "gain_inverse_ttc_0.25": "TTC$^{-1}$ > 0.25 s$^{-1}$",
    "gain_inverse_ttc_0.35": "> 0.35 s$^{-1}$",
    "gain_inverse_ttc_0.45": "> 0.45 s$^{-1}$",
    "gain_simulated_ttc_2": "simulated TTC < 2 s",
    "gain_simulated_ttc_3": "< 3 s",
    "gain_simulated_ttc_4": "< 4 s",
}
SHOWN_SHARE = -0.15  # left edge of a panel, as a share of the best gain; larger losses are drawn at the edge


@figure
def fig21_scores(laws: pd.DataFrame, source: str) -> tuple[Figure, pd.DataFrame]:
    """Draw the gain in held-out log-likelihood [nats] of each law over the paper's law, by region.

    Laws that the records contradict, which have no weight, have hollow markers.

    Parameters
    ----------
    laws
        ``laws.csv`` of a study.
    source
        Description of the data.

    Returns
    -------
    figure, data
        The figure has a panel for each of the `REGIONS`; the data are the table itself.
    """
    y = np.arange(len(laws))
    with paper_style():
        size = (2 * COLUMN_WIDTH, FRAME + ROW * len(laws))
        drawn, all_axes = plt.subplots(1, len(REGIONS), sharey=True, figsize=size)
        for axes, (column, title) in zip(all_axes, REGIONS.items(), strict=True):
            _draw_gains(axes, y, laws, column)
            axes.set_title(title, fontsize=6)
            axes.tick_params(labelsize=6)
            axes.set_xlabel("gain [nats]", fontsize=6)
        all_axes[0].set_yticks(y, laws["law"])
        all_axes[0].invert_yaxis()
        for at, weight in zip(y, laws["weight"], strict=True):
            text = f"{weight:.3f}" if weight > 0 else "–"
            all_axes[-1].text(
                1.05, at, text, transform=all_axes[-1].get_yaxis_transform(), va="center", fontsize=6
            )
        all_axes[-1].text(1.05, 1.01, "weight", transform=all_axes[-1].transAxes, va="bottom", fontsize=6)
        note_source(drawn, f"{source}. Hollow: refused by the records. Triangles: losses beyond the edge")
    return drawn, laws


def _draw_gains(axes: Axes, y: Array, laws: pd.DataFrame, column: str) -> None:
    best = laws[column].max()
    edge = SHOWN_SHARE * best
    for at, gain, refused in zip(y, laws[column], laws["refused"], strict=True):
        look = {"marker": "o" if gain > edge else "<", "color": DEFENDED, "markersize": 3.5}
        axes.plot(max(gain, edge), at, **look, markerfacecolor="white" if refused else DEFENDED)
    axes.axvline(best, color="black", linewidth=0.5, linestyle=":")
    axes.set_xlim(1.3 * edge, 1.12 * best)


@figure
def fig22_calibration(calibration: pd.DataFrame, source: str) -> tuple[Figure, pd.DataFrame]:
    """Draw recorded and expected numbers of cut-ins by region.

    Counts by host speed are in the table ``calibration.csv``, but not in the figure.

    Parameters
    ----------
    calibration
        ``calibration.csv`` of a study.
    source
        Description of the data.

    Returns
    -------
    figure, data
        The figure, and the rows of ``calibration`` that it shows.
    """
    calibration = calibration[calibration["counted"] != HOST].drop(columns="counted")
    names = calibration["law"].unique()
    defended, paper = (calibration[calibration["law"] == name] for name in (names[0], names[-1]))
    with paper_style():
        drawn, axes = plt.subplots(figsize=(1.4 * COLUMN_WIDTH, FRAME + ROW * len(defended)))
        y = np.arange(len(defended))
        place = dict(zip(defended["where"], y, strict=True))
        _draw_limits(axes, y - 0.15, defended, DEFENDED, names[0])
        _draw_limits(axes, paper["where"].map(place).to_numpy() + 0.2, paper, PAPER, names[-1])
        axes.plot(defended["recorded"], y, "k|", markersize=6, label="recorded")
        axes.set_xscale("symlog", linthresh=1)
        axes.set(xlim=(-0.1, None), xlabel="distinct records (linear below 1, logarithmic above)")
        axes.set_yticks(y, defended["where"], fontsize=5.5)
        axes.invert_yaxis()
        axes.legend(loc="lower center", bbox_to_anchor=(0.4, 1.0), fontsize=6)
        note_source(drawn, f"{source}. Bars: expected, with 90 % Poisson limits")
    return drawn, calibration


def _draw_limits(axes: Axes, y: Array, rows: pd.DataFrame, color: str, label: str) -> None:
    expected = rows["expected"].to_numpy()
    reach = np.abs(rows[["low", "high"]].to_numpy().T - expected)
    axes.errorbar(
        expected,
        y,
        xerr=reach,
        linestyle="none",
        marker="o",
        markersize=2.5,
        color=color,
        elinewidth=0.8,
        label=label,
    )


@figure
def fig23_answer(
    answer: pd.DataFrame,
    answer_thresholds: pd.DataFrame,
    data_quality: pd.DataFrame,
    paper_interval: tuple[float, float],
    source: str,
) -> tuple[Figure, pd.DataFrame]:
    """Draw the crash probability with its 50, 80 and 95 % intervals.

    Further rows show the probability with a single threshold of the laws' tails, and with other treatments of
    the records (``data_quality.csv``).

    Parameters
    ----------
    answer, answer_thresholds, data_quality
        Tables of a study: the probability and its intervals by event, by threshold of the tails, and by
        treatment of the records.
    paper_interval
        The paper's 80 % interval (section VI.C).
    source
        Description of the data.

    Returns
    -------
    figure, data
        The figure, and a table with a row for each row of the figure: the columns of the tables, group and
        name.
    """
    crash = answer[answer["event"] == "crash"].assign(group="answer", name="crash of a cut-in")
    levels = answer_thresholds.assign(
        group="threshold alone", name=answer_thresholds["level"].map("{:g}".format)
    )
    readings = data_quality.assign(group="records", name=data_quality["reading"])
    data = pd.concat([crash, levels, readings], ignore_index=True)
    with paper_style():
        y = spaced(data["group"], 1.6)
        drawn, axes = plt.subplots(figsize=(1.4 * COLUMN_WIDTH, FRAME + ROW * y.max()))
        draw_nested(axes, y, data)
        axes.axvspan(*paper_interval, color=PAPER, alpha=0.4, linewidth=0, label="paper, 80 %")
        name_rows(axes, y, data["group"], data["name"])
        axes.set(xscale="log", xlabel="crash probability of a cut-in", ylim=(y.max() + 0.8, -1.6))
        drawn.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=3)
        note_source(drawn, source)
    return drawn, data.drop(columns=["reading"])


def draw_nested(axes: Axes, y: Array, rows: pd.DataFrame) -> None:
    """Draw 50, 80 and 95 % intervals over each other, the median as a stroke and the mean as a diamond.

    Parameters
    ----------
    axes
        The axes.
    y
        Coordinate of each row, shape (n,).
    rows
        Table with columns low50, high50 and so on, median, and probability (the mean).
    """
    for level, width in ((95, 0.8), (80, 2.2), (50, 4.5)):
        axes.hlines(
            y, rows[f"low{level}"], rows[f"high{level}"], color="#4292c6", linewidth=width, label=f"{level} %"
        )
    axes.plot(rows["median"], y, "|", color="black", markersize=6, label="median")
    axes.plot(rows["probability"], y, "D", color="black", markersize=2.5, label="mean")


@figure
def fig24_worlds(worlds: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw coverage, width and bias of this project's procedure and of the paper's in synthetic worlds.

    A world is a law of cut-ins whose true crash probability is known. Both procedures estimate it from data
    that are drawn from the law.

    Parameters
    ----------
    worlds
        ``benchmarks/results/worlds.csv``: a row for each kind of world and procedure.

    Returns
    -------
    figure, data
        The figure has panels for the coverage of 50, 80 and 95 % intervals, for the width of the 80 %
        intervals, and for the ratio of median estimate and truth. The data are the table itself.
    """
    looks = {"this project": (DEFENDED, "o", -0.16), "paper": (PAPER, "s", 0.16)}
    kinds = list(worlds["kind"].unique())
    with paper_style():
        drawn, all_axes = plt.subplots(
            1, 5, sharey=True, figsize=(2 * COLUMN_WIDTH, FRAME + 3 * ROW * len(kinds))
        )
        for procedure, (color, marker, shift) in looks.items():
            rows = worlds[worlds["procedure"] == procedure]
            y = rows["kind"].map(kinds.index).to_numpy() + shift
            look = {
                "color": color,
                "marker": marker,
                "linestyle": "none",
                "markersize": 3.5,
                "elinewidth": 0.8,
            }
            for axes, level in zip(all_axes, (50, 80, 95), strict=False):
                share = rows[f"coverage{level}"]
                reach = [share - rows[f"coverage{level}_low"], rows[f"coverage{level}_high"] - share]
                axes.errorbar(100 * share, y, xerr=100 * np.array(reach), label=procedure, **look)
            del look["elinewidth"]
            all_axes[3].plot(rows["width80"], y, **look)
            all_axes[4].plot(rows["median_ratio"], y, **look)
        _name_panels(all_axes)
        all_axes[0].set_yticks(range(len(kinds)), kinds)
        all_axes[0].invert_yaxis()
        drawn.legend(*all_axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
        counts = sorted(set(worlds["worlds"]))
        number = f"{counts[0]}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"
        note_source(
            drawn, f"{number} synthetic worlds of each kind, as many cut-ins as recorded; bars: 95 % limits"
        )
    return drawn, worlds


def _name_panels(all_axes: Iterable[Axes]) -> None:
    """Write the titles of the panels of figure 24, and draw the ideal value of each as a dotted line."""
    *coverages, width, bias = all_axes
    for axes, level in zip(coverages, (50, 80, 95), strict=True):
        axes.axvline(level, color="black", linewidth=0.6, linestyle=":")
        axes.set_title(f"coverage of {level} %", fontsize=6)
        axes.set(xlim=(-3, 103), xlabel="[%]")
    coverages[1].axvspan(75, 85, color="#4292c6", alpha=0.2, linewidth=0)
    width.set_title("80 % interval, upper / lower", fontsize=6)
    bias.set_title("median estimate / truth", fontsize=6)
    bias.axvline(1, color="black", linewidth=0.6, linestyle=":")
    for axes, ticks in ((width, (2, 5, 10, 20, 50)), (bias, (0.3, 0.5, 1, 2))):
        axes.set_xscale("log")
        axes.minorticks_off()
        axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])


@figure
def fig25_vehicles(vehicles: pd.DataFrame, source: str) -> tuple[Figure, pd.DataFrame]:
    """Draw the crash probability of each vehicle, and its ratio to that of the careful human.

    Parameters
    ----------
    vehicles
        ``vehicles.csv`` of a study. Vehicles whose crash map was rejected (not ``resolved``) are not drawn.
    source
        Description of the data.

    Returns
    -------
    figure, data
        The figure, and the table itself.
    """
    shown = vehicles[vehicles["resolved"]]
    y = np.arange(len(shown))
    with paper_style():
        size = (1.7 * COLUMN_WIDTH, FRAME + 2 * ROW * len(shown))
        drawn, (left, right) = plt.subplots(1, 2, sharey=True, figsize=size, width_ratios=(1.5, 1))
        draw_nested(left, y, shown)
        left.set(xscale="log", xlabel="crash probability of a cut-in")
        left.set_yticks(y, shown["vehicle"])
        left.invert_yaxis()
        right.hlines(y, shown["ratio_low80"], shown["ratio_high80"], color="#4292c6", linewidth=2.2)
        right.plot(shown["ratio"], y, "|", color="black", markersize=6)
        right.axvline(1, color="black", linewidth=0.6, linestyle=":")
        right.set(xscale="log", xlabel="ratio to the careful human")
        drawn.legend(*left.get_legend_handles_labels(), loc="outside upper center", ncols=5)
        note_source(drawn, f"{source}. Right: median and 80 % interval")
    return drawn, vehicles
