"""The estimates and how they converge: figures 12 and 13 of the paper."""

from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter, StrMethodFormatter

from accelerated_evaluation.publishing.figures.method_styles import style_of
from accelerated_evaluation.publishing.figures.style import (
    COLUMN_WIDTH,
    note_source,
    paper_style,
    say_no_crash,
)
from accelerated_evaluation.publishing.published import figure
from accelerated_evaluation.publishing.tables.paper_numbers import PAPER_PROBABILITY
from accelerated_evaluation.publishing.tables.spreads import of_method

NUMBERS = ("probability", "ci_low", "ci_high", "relative_half_width")
COMPARED = ("piecewise", "single")  # in the paper's figure 12
REFERENCE = {"color": "black", "linewidth": 0.8, "linestyle": ":"}


@figure
def fig12_crash_probability(
    estimates: pd.DataFrame, course: pd.DataFrame, alpha: float, source: str
) -> tuple[Figure, pd.DataFrame]:
    """Draw the estimates over all segments against the number of simulations (paper, figure 12).

    The methods are importance sampling with the piecewise and with the single distributions.

    Parameters
    ----------
    estimates, course
        ``estimates.csv`` and ``estimates_course.csv`` of a study.
    alpha
        The level of the intervals is 1 - alpha.
    source
        Description of the data.

    Returns
    -------
    figure, data
        The figure has a panel for each method, in which the first replicate is drawn in front with its
        interval. The columns of the data are kind (course, converged or paper), method, replicate,
        simulations, probability, ci_low and ci_high.
    """
    table = _rows(estimates, course, COMPARED, "all")
    last = table.groupby(["method", "replicate"])["probability"].last().max()
    with paper_style():
        drawn, panels = plt.subplots(2, 1, figsize=(COLUMN_WIDTH, 4.2), sharex=True, sharey=True)
        for axes, (method, rows) in zip(panels, table.groupby("method", sort=False), strict=True):
            _draw_replicates(axes, rows, method, "probability")
            front = rows[(rows["kind"] == "course") & (rows["replicate"] == rows["replicate"].min())]
            style = {**style_of(method, "color"), "alpha": 0.2, "linewidth": 0, "zorder": 1}
            label = f"{100 * (1 - alpha):g} % interval"
            axes.fill_between(front["simulations"], front["ci_low"], front["ci_high"], label=label, **style)
            label = rf"paper: {1e7 * PAPER_PROBABILITY:g} $\times$ 10$^{{-7}}$"
            axes.axhline(PAPER_PROBABILITY, label=label, **REFERENCE)
            axes.set(ylabel="crash probability", ylim=(0, 2 * max(last, PAPER_PROBABILITY)))
            axes.ticklabel_format(axis="y", style="sci", scilimits=(0, 0), useMathText=True)
            if not rows["probability"].any():
                say_no_crash(axes)
        _add_legend(drawn, COMPARED)
        panels[-1].set_xlabel("simulations, all segments")
        panels[-1].xaxis.set_major_locator(MaxNLocator(5))
        panels[-1].xaxis.set_major_formatter(StrMethodFormatter("{x:,.0f}"))
        note_source(drawn, source)
    return drawn, _complete(table, "paper", "probability", PAPER_PROBABILITY, drop="relative_half_width")


@figure
def fig13_relative_half_width(
    estimates: pd.DataFrame, course: pd.DataFrame, segment: str, beta: float, source: str
) -> tuple[Figure, pd.DataFrame]:
    """Draw the relative half-width of the interval against the number of simulations (paper, figure 13).

    Parameters
    ----------
    estimates, course
        ``estimates.csv`` and ``estimates_course.csv`` of a study.
    segment
        Segment of lead speeds; the estimates are those for this segment alone.
    beta
        Relative half-width at which an estimate is said to have converged.
    source
        Description of the data.

    Returns
    -------
    figure, data
        The figure shows the first replicate of each method in front. The columns of the data are kind
        (course, converged or beta), method, replicate, simulations and relative_half_width.
    """
    table = _rows(estimates, course, estimates["method"].unique(), segment)
    with paper_style():
        drawn, axes = plt.subplots(figsize=(COLUMN_WIDTH, 3.0))
        for method, rows in table.groupby("method", sort=False):
            _draw_replicates(axes, rows, method, "relative_half_width")
        axes.axhline(beta, label=rf"$\beta$ = {beta:g}", **REFERENCE)
        axes.set(xscale="log", yscale="log", ylabel="relative half-width")
        axes.set_xlabel(f"simulations, $v_L$ {segment.replace('-', '–')} m/s")
        if table["relative_half_width"].isna().all():
            axes.set_xlim(1, table["simulations"].max())
            say_no_crash(axes)
        axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.yaxis.set_minor_formatter(NullFormatter())
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_formatter(StrMethodFormatter("{x:,g}"))
        _add_legend(drawn, estimates["method"].unique())
        note_source(drawn, source)
    return drawn, _complete(table, "beta", "relative_half_width", beta, drop=list(NUMBERS[:3]))


def _rows(estimates: pd.DataFrame, course: pd.DataFrame, methods: Sequence[str], scope: str) -> pd.DataFrame:
    """Return the courses and the converged estimates of the methods, with NaN for an infinite half-width."""
    course = course.replace({"relative_half_width": {np.inf: np.nan}})
    half_width = course["relative_half_width"] * course["probability"]
    course = course.assign(
        kind="course",
        ci_low=(course["probability"] - half_width).clip(lower=0),
        ci_high=course["probability"] + half_width,
    )
    stacked = pd.concat([course, estimates[estimates["converged"]].assign(kind="converged")])
    rows = pd.concat([of_method(stacked, method, scope) for method in methods], ignore_index=True)
    return rows[["kind", "method", "replicate", "simulations", *NUMBERS]]


def _draw_replicates(axes: Axes, rows: pd.DataFrame, method: str, column: str) -> None:
    """Draw all replicates of a method, the first in front, with circles where they converge."""
    look = style_of(method, "color", "linestyle")
    first = rows["replicate"].min()
    for replicate, course in rows[rows["kind"] == "course"].groupby("replicate"):
        front = replicate == first
        depth = {"zorder": 3, "label": method} if front else {"zorder": 2, "alpha": 0.3, "linewidth": 0.5}
        axes.plot(course["simulations"], course[column], **look, **depth)
    ends = rows[rows["kind"] == "converged"]
    for is_first, size in ((False, 2.5), (True, 6)):
        chosen = ends[(ends["replicate"] == first) == is_first]
        circle = {"marker": "o", "markersize": size, "markerfacecolor": "white", "linestyle": "none"}
        label = "converged" if is_first and len(chosen) else None
        axes.plot(chosen["simulations"], chosen[column], color=look["color"], zorder=4, label=label, **circle)


def _add_legend(drawn: Figure, methods: Sequence[str]) -> None:
    """Draw a common legend above the panels, in which each label occurs once."""
    entries = [dict(zip(*axes.get_legend_handles_labels()[::-1], strict=True)) for axes in drawn.axes]
    named = {label: entry[label] for entry in entries for label in entry if label in methods}
    legend = named | entries[0]
    drawn.legend(legend.values(), legend.keys(), loc="outside upper center", ncols=3)


def _complete(
    table: pd.DataFrame, kind: str, column: str, value: float, drop: str | list[str]
) -> pd.DataFrame:
    """Append the reference line, as a row with its kind and value, to the table of drawn data."""
    complete = pd.concat([table.drop(columns=drop), pd.DataFrame([{"kind": kind, column: value}])])
    return complete.astype({"replicate": "Int64", "simulations": "Int64"}).reset_index(drop=True)
