"""Figures for a study of a scenario other than the cut-in: its records, its answer, and its methods."""

from itertools import combinations

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from accelerated_evaluation.publishing.figures.dot_chart import INTERVAL, draw_intervals, finish
from accelerated_evaluation.publishing.figures.method_styles import style_of
from accelerated_evaluation.publishing.figures.style import COLUMN_WIDTH, PIECES, note_source, paper_style
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

    Parameters
    ----------
    encounters
        The records, with a column for each variable.
    scenario_runs
        The runs of the surrogate, with the same columns and ``event``.
    scenario
        The scenario, with the names and units of the variables. If its variables include one that others are
        divided by (``divided_by``), the axis of this variable is linear up to its smallest value and
        logarithmic beyond.
    source
        Description of the data.

    Returns
    -------
    figure, data
        The figure has a panel for each pair of variables. The data contain all points, with ``kind``.
        Variables whose sign does not matter have absolute values, as in the laws.
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
    styles = ((RECORD, PIECES[1], "o", 3), (HAPPENED, CRASH, "x", 6))
    with paper_style():
        drawn, panels = plt.subplots(len(pairs), 1, figsize=(COLUMN_WIDTH, 2.1 * len(pairs)), squeeze=False)
        for axes, (x, y) in zip(panels[:, 0], pairs, strict=True):
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

    Parameters
    ----------
    answer
        A row for each event and group of encounters.
    source
        Description of the data.

    Returns
    -------
    figure, data
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
        axes.set_yticks(y, [f"{row.event}\n{row.encounters}" for row in table.itertuples()], fontsize=6)
        axes.set(xlabel="probability in an encounter", ylim=(len(table) - 0.4, -0.6))
        _scale(axes, table[["low95", "high95"]])
        drawn.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=2)
        note_source(drawn, source)
    return drawn, table


@figure
def fig03_scenario_methods(
    scenario_estimates: pd.DataFrame, alpha: float, source: str
) -> tuple[Figure, pd.DataFrame]:
    """Draw the estimates of each method with their intervals, for the law with the largest weight.

    Parameters
    ----------
    scenario_estimates
        A row for each law, method and replicate.
    alpha
        The level of the intervals is 1 - alpha.
    source
        Description of the data.

    Returns
    -------
    figure, data
        The figure has a row for each replicate, with an open marker if it has not converged. The columns of
        the data are law, event, method, replicate, probability, ci_low, ci_high, simulations and converged.
    """
    together = scenario_estimates["learning"] + scenario_estimates["estimating"]
    columns = ["law", "event", "method", "replicate", *INTERVAL, "simulations", "converged"]
    table = scenario_estimates.assign(simulations=together)[columns]
    with paper_style():
        legend = 0.13 * (table["method"].nunique() + 1)  # [in], its height
        drawn, axes = plt.subplots(figsize=(COLUMN_WIDTH, 0.6 + legend + 0.1 * len(table)))
        for method, rows in table.groupby("method", sort=False):
            label = f"{method.replace('_', ' ')}, {rows['simulations'].mean():,.0f} simulations on average"
            style = style_of(method, "color", "marker")
            axes.plot([], [], linestyle="none", label=label, **style)
            for converged, own in rows.groupby("converged"):
                fill = {} if converged else {"markerfacecolor": "white"}
                draw_intervals(axes, own, own.index, **style, **fill)
        if not table["converged"].all():
            axes.plot([], [], "ko", markerfacecolor="white", label="not converged")
        axes.set_yticks([])
        _scale(axes, table[list(INTERVAL)])
        axes.set_xlabel(f"probability ({table['event'].iloc[0]}), {100 * (1 - alpha):g} % intervals")
        finish(drawn, axes, source)
    return drawn, table


def _label(variable: Variable) -> str:
    """Return the label of an axis; bars around the name say that the values are absolute values."""
    name = variable.in_title if variable.sign_matters else f"|{variable.in_title}|"
    return f"{name} [{variable.unit}]"


def _show_small_values(axis: Axis, linear: float) -> None:
    """Scale an axis linearly from 0 to a value, and logarithmically beyond."""
    set_scale = axis.axes.set_xscale if axis.axis_name == "x" else axis.axes.set_yscale
    set_scale("symlog", linthresh=linear)
    ticks = [0, linear, *(tick for tick in (1, 10) if tick > linear)]
    axis.set_ticks(ticks, [f"{tick:g}" for tick in ticks])
    axis.set_minor_locator(NullLocator())


def _scale(axes: Axes, values: pd.DataFrame) -> None:
    """Scale x logarithmically if the positive values differ by more than a factor of `WIDE`."""
    positive = values.to_numpy(float)[values.to_numpy(float) > 0]
    if positive.size and positive.max() > WIDE * positive.min():
        axes.set_xscale("log")
    else:
        axes.ticklabel_format(axis="x", style="sci", scilimits=(0, 0), useMathText=True)
