"""Figures for a study of a scenario other than the cut-in: its records, its answer, and its methods."""

from itertools import combinations
from string import ascii_lowercase

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from accelerated_evaluation.publishing.figures.dot_chart import (
    FRAME,
    INTERVAL,
    ROW,
    draw_intervals,
    draw_truth,
    finish,
    name_groups,
    scale_linearly,
    scale_logarithmically,
    spaced,
)
from accelerated_evaluation.publishing.figures.laws import draw_nested
from accelerated_evaluation.publishing.figures.style import (
    COLUMN_WIDTH,
    PIECES,
    note_source,
    paper_style,
    style_of,
)
from accelerated_evaluation.publishing.published import figure
from accelerated_evaluation.scenarios.protocol import Scenario, Variable

CRASH = "#b2182b"
RECORD, HAPPENED = "record", "event among the runs of the surrogate"  # kinds of points
WIDE = 10.0  # an axis is logarithmic if its largest value is more than this multiple of the smallest one
LEVELS = {95: 0.8, 80: 2.0, 50: 4.0}  # line width of each interval


@figure
def fig01_scenario_records(
    encounters: pd.DataFrame, scenario_runs: pd.DataFrame, scenario: Scenario, source: str
) -> tuple[Figure, pd.DataFrame]:
    """Draw the records, and the events among the runs of the surrogate, for each pair of variables.

    ``scenario``: the scenario, with the names and units of the variables. If its variables include one that
    others are divided by (``divided_by``), the axis of this variable is linear up to its smallest value and
    logarithmic beyond. The figure has a panel for each pair of variables. The data contain all points, with
    ``kind``. Variables whose sign does not matter have absolute values, as in the laws.
    """
    names = list(scenario.names)
    parts = {RECORD: encounters, HAPPENED: scenario_runs[scenario_runs["event"]]}
    points = pd.concat(
        [
            pd.DataFrame(scenario.as_in_law(part[names].to_numpy(float)), columns=names).assign(kind=kind)
            for kind, part in parts.items()
        ],
        ignore_index=True,
    )
    pairs = list(combinations(scenario.variables, 2))
    # Records are drawn last, so that the many events do not hide them.
    styles = ((HAPPENED, CRASH, "x", 5), (RECORD, PIECES[0], "o", 3))
    with paper_style():
        drawn, panels = plt.subplots(len(pairs), 1, figsize=(COLUMN_WIDTH, 2.1 * len(pairs)), squeeze=False)
        for letter, axes, (x, y) in zip(ascii_lowercase, panels[:, 0], pairs, strict=False):
            axes.set_title(f"({letter})", loc="left")
            for kind, color, marker, size in styles:
                own = points[points["kind"] == kind]
                width = 0.0 if marker == "o" else 0.5
                axes.scatter(
                    own[x.name], own[y.name], s=size, color=color, marker=marker, linewidth=width, label=kind
                )
            axes.set_axisbelow(True)
            axes.set(xlabel=_label(x), ylabel=_label(y))
            for axis, variable in ((axes.xaxis, x), (axes.yaxis, y)):
                if scenario.divided_by is not None and variable.name == scenario.divided_by[0]:
                    _show_small_values(axis, scenario.divided_by[1][0])
        handles = panels[0, 0].get_legend_handles_labels()
        drawn.legend(*handles, loc="outside upper center", ncols=2, markerscale=2)
        note_source(drawn, source)
    return drawn, points


@figure
def fig02_scenario_answer(answer: pd.DataFrame, source: str) -> tuple[Figure, pd.DataFrame]:
    """Draw the probability of each event with its 50, 80 and 95 % intervals.

    The figure has a row for each row of the table; the data are the table itself.
    """
    table = answer.reset_index(drop=True)
    y = np.arange(len(table))
    with paper_style():
        drawn, axes = plt.subplots(figsize=(COLUMN_WIDTH, 1.2 + 0.35 * len(table)))
        for level, width in LEVELS.items():
            low, high = table[f"low{level}"], table[f"high{level}"]
            axes.hlines(y, low, high, color=PIECES[0], linewidth=width, label=f"{level} % interval")
        axes.plot(table["median"], y, "o", color="white", markeredgecolor=PIECES[0], label="median")
        for at in y[table["median"].isna()]:
            say = {"transform": axes.get_yaxis_transform(), "ha": "center", "va": "center", "fontsize": 6}
            axes.text(0.5, at, "too few events for an estimate", color="#555555", **say)
        parts = "\n" + table["encounters"] if "encounters" in table else ""  # few runs have no parts
        axes.set_yticks(y, table["event"] + parts, fontsize=6)
        axes.set_ylim(len(table) - 0.4, -0.6)
        _scale(axes, table[["low95", "high95"]], "probability in an encounter")
        drawn.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=2)
        note_source(drawn, source)
    return drawn, table


@figure
def fig03_scenario_methods(
    scenario_estimates: pd.DataFrame, alpha: float, source: str
) -> tuple[Figure, pd.DataFrame]:
    """Draw the estimates of each method with their intervals, for the law with the largest weight.

    The figure has a row for each replicate, with an open marker if it has not converged, and an arrow at the
    upper limit if it has no event. The columns of the data are law, event, method, replicate, probability,
    ci_low, ci_high, simulations and converged.
    """
    together = scenario_estimates["learning"] + scenario_estimates["estimating"]
    columns = ["law", "event", "method", "replicate", *INTERVAL, "simulations", "converged"]
    table = scenario_estimates.assign(simulations=together)[columns].reset_index(drop=True)
    y = spaced(table["method"], 1.0)
    found = table["probability"] > 0
    kinds = {
        "converged": (found & table["converged"], {}),
        "not converged": (found & ~table["converged"], {"markerfacecolor": "white"}),
    }
    runs = table.groupby("method", sort=False)["simulations"].mean()
    with paper_style():
        drawn, axes = plt.subplots(figsize=(COLUMN_WIDTH, FRAME + 0.1 * (y.max() + 4)))
        for kind, (chosen, fill) in kinds.items():
            for method, rows in table[chosen].groupby("method", sort=False):
                draw_intervals(axes, rows, y[rows.index], **style_of(str(method), "color", "marker"), **fill)
            if chosen.any():
                axes.plot([], [], "s", color="black", markersize=3.5, label=kind, **fill)
        if not found.all():
            arrow = {"color": "black", "linestyle": "none", "markersize": 4}
            axes.plot(table["ci_high"][~found], y[~found], "<", label="no event: upper limit", **arrow)
        crude = table[found & (table["method"] == "crude")]
        if len(crude):
            draw_truth(axes, crude.iloc[0], "crude Monte Carlo")
        for _, rows in pd.Series(y).groupby(table["method"].to_numpy()):
            axes.axhspan(rows.min() - 0.6, rows.max() + 0.6, color="#f4f4f4", linewidth=0, zorder=0)
        words = {name: f"{str(name).replace('_', ' ')},\n{runs[name]:,.0f} runs" for name in runs.index}
        name_groups(axes, y, table["method"].map(words))
        label = f"probability: {table['event'].iloc[0]},\n{100 * (1 - alpha):g} % intervals"
        _scale(axes, table[list(INTERVAL)], label)
        finish(drawn, axes, source)
    return drawn, table


def _label(variable: Variable) -> str:
    """Return the label of an axis; bars around the name say that the values are absolute values."""
    words = variable.in_title.replace("sdv", "vehicle")  # the self-driving vehicle, which is under test
    name = words if variable.sign_matters else f"|{words}|"
    return f"{name} [{variable.unit}]"


def _show_small_values(axis: Axis, linear: float) -> None:
    """Scale an axis linearly from 0 to a value, and logarithmically beyond."""
    set_scale = axis.axes.set_xscale if axis.axis_name == "x" else axis.axes.set_yscale
    set_scale("symlog", linthresh=linear)
    ticks = [0, linear, *(tick for tick in (1, 10) if tick > linear)]
    axis.set_ticks(ticks, [f"{tick:.2g}" for tick in ticks])
    axis.set_label_text(f"{axis.get_label_text()}\n(linear below {linear:.2g})")
    axis.set_minor_locator(NullLocator())


def _scale(axes: Axes, values: pd.DataFrame, label: str) -> None:
    """Label x, and scale it logarithmically if the positive values differ by more than a factor of `WIDE`."""
    positive = values.to_numpy(float)[values.to_numpy(float) > 0]
    wide = positive.size and positive.max() > WIDE * positive.min()
    (scale_logarithmically if wide else scale_linearly)(axes, label)


NEAR = 0.15  # [1/s], smallest TTC^-1 of the records that are drawn
ALONE = "crash, error of the simulations alone"
CRASHED, SAFE = "#b2182b", "#08306b"
SMALLEST, LARGEST = 4, 120  # [pt^2], areas of the marker of a crash with a share of 0 and of 1


@figure
def fig35_sampled_answer(
    answer: pd.DataFrame, sampled_estimate: pd.DataFrame, scenario: Scenario, source: str
) -> tuple[Figure, pd.DataFrame]:
    """Draw the probability of each event with its intervals.

    A last row shows the 80 % interval of the crash probability that results from the sampling error of the
    simulations alone.

    Return the figure and a table with a row for each row of the figure. Events without a known median are
    left out.
    """
    known = answer.dropna(subset="median")
    estimate = sampled_estimate.iloc[0]
    alone = {"event": ALONE, "low80": estimate["ci_low"], "high80": estimate["ci_high"]}
    alone |= {"probability": estimate["probability"]}
    data = pd.concat([known, pd.DataFrame([alone] if len(known) else [])], ignore_index=True)
    y = np.arange(len(data))
    with paper_style():
        drawn, axes = plt.subplots(figsize=(1.6 * COLUMN_WIDTH, FRAME + 2 * ROW * max(len(data), 2)))
        if len(data):
            draw_nested(axes, y, data)
            axes.set_xscale("log")
            drawn.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=5)
        axes.set(xlabel=f"probability per {scenario.noun}", ylim=(len(data) - 0.4, -0.6))
        axes.set_yticks(y, data["event"])
        note_source(drawn, source)
    return drawn, data


@figure
def fig36_crashes_among_runs(
    sampled_runs: pd.DataFrame, sampled_crashes: pd.DataFrame, encounters: pd.DataFrame, source: str
) -> tuple[Figure, pd.DataFrame]:
    """Draw the simulations and the most critical records by range and closing speed.

    The area of the marker of a crash grows with its share of the crash probability.

    Return the figure and a row for each simulation: outcome, lead_speed [m/s], range [m], closing_speed [m/s]
    and share.
    """
    near = encounters[encounters["inverse_ttc"] > NEAR]
    safe = sampled_runs[~sampled_runs["event"]].assign(outcome="no crash", share=0.0)
    crashes = sampled_crashes.assign(outcome="crash")
    columns = ["outcome", "lead_speed", "range", "closing_speed", "share"]
    data = pd.concat([safe[columns], crashes[columns]] if len(crashes) else [safe[columns]])
    with paper_style():
        drawn, axes = plt.subplots(figsize=(1.4 * COLUMN_WIDTH, 1.1 * COLUMN_WIDTH))
        axes.plot(near["range"], near["closing_speed"], ".", color="#aaaaaa", markersize=1.2, label="records")
        axes.plot(safe["range"], safe["closing_speed"], "o", color=SAFE, markersize=2.5, fillstyle="none")
        axes.plot([], [], "o", color=SAFE, markersize=2.5, fillstyle="none", label="simulated, no crash")
        area = SMALLEST + (LARGEST - SMALLEST) * crashes["share"].astype(float)
        place = crashes["range"].astype(float), crashes["closing_speed"].astype(float)
        axes.scatter(*place, s=area, color=CRASHED, alpha=0.6, linewidths=0, label="simulated, crash")
        top = max(36, 1.6 * encounters["closing_speed"].max())
        axes.set(xlabel="range [m]", ylabel="closing speed [m/s]", ylim=(0, top))
        axes.set_xlim(0, encounters["range"].max())
        drawn.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=3)
        note_source(drawn, source)
    return drawn, data.reset_index(drop=True)
