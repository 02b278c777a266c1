"""The estimates and how they converge: figures 12 and 13 of the paper."""

from collections.abc import Mapping, Sequence

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter, StrMethodFormatter

from accelerated_evaluation.publishing.figures.dot_chart import in_math
from accelerated_evaluation.publishing.figures.style import COLUMN_WIDTH, Drawn, Look, say_no_crash, style_of
from accelerated_evaluation.publishing.published import figure
from accelerated_evaluation.publishing.tables.paper_claims import PAPER_PROBABILITY
from accelerated_evaluation.publishing.tables.spreads import of_method

NUMBERS = ("probability", "ci_low", "ci_high", "relative_half_width")
COMPARED = ("piecewise", "single")  # in the paper's figure 12
LARGE, SMALL = 6, 2.5  # markers of convergence, for the median replicate and for the others
REFERENCES = {
    "exact": {"color": "black", "linewidth": 1.0, "linestyle": "-"},
    "paper": {"color": "black", "linewidth": 0.8, "linestyle": ":"},
    "beta": {"color": "black", "linewidth": 0.8, "linestyle": ":"},
}


@figure
def fig12_crash_probability(
    estimates: pd.DataFrame, course: pd.DataFrame, exact: pd.DataFrame, alpha: float
) -> Drawn:
    """Draw the estimates over all segments against the number of simulations (paper, figure 12).

    The methods are importance sampling with the piecewise and with the single distributions.

    The figure has a panel for each method, in which the median replicate by simulations until convergence is
    drawn in front with its interval. The columns of the data are kind (course, converged, exact or paper),
    method, replicate, simulations, probability, ci_low and ci_high.
    """
    table = _rows(estimates, course, COMPARED, "all")
    truth = float(exact.set_index("segment").loc["all", "probability"])
    lines = {"exact": truth, "paper": PAPER_PROBABILITY}
    last = table.groupby(["method", "replicate"])["probability"].last().max()
    drawn, panels = plt.subplots(2, 1, figsize=(COLUMN_WIDTH, 4.2), sharex=True, sharey=True)
    for letter, axes, (method, rows) in zip("ab", panels, table.groupby("method", sort=False), strict=True):
        axes.set_title(f"({letter}) {method}", loc="left")
        _draw_replicates(axes, rows, method, "probability")
        _mark_convergence(axes, rows, method, "probability")
        front = rows[(rows["kind"] == "course") & (rows["replicate"] == _front(rows))]
        style: Look = {"color": "#808080", "alpha": 0.3, "linewidth": 0, "zorder": 1}
        label = f"{100 * (1 - alpha):g} % interval"
        axes.fill_between(front["simulations"], front["ci_low"], front["ci_high"], label=label, **style)
        for name, value in lines.items():
            axes.axhline(value, label=f"{name}: {in_math(value)}", **REFERENCES[name])
        axes.set(ylabel="crash probability", ylim=(0, 2 * max(last, *lines.values())))
        axes.ticklabel_format(axis="y", style="sci", scilimits=(0, 0), useMathText=True)
        if not rows["probability"].any():
            say_no_crash(axes)
    _add_legend(drawn, COMPARED)
    panels[-1].set_xlabel("simulations, all segments")
    panels[-1].xaxis.set_major_locator(MaxNLocator(5))
    panels[-1].xaxis.set_major_formatter(StrMethodFormatter("{x:,.0f}"))
    return drawn, _complete(table, "probability", lines, drop="relative_half_width")


@figure
def fig13_relative_half_width(
    estimates: pd.DataFrame, course: pd.DataFrame, segment: str, beta: float
) -> Drawn:
    """Draw the relative half-width of the interval against the number of simulations (paper, figure 13).

    The figure shows the median replicate of each method in front. A second panel shows where the replicates
    converge, in a row for each method, since these points have the same height in the first one. The columns
    of the data are kind (course, converged or beta), method, replicate, simulations and relative_half_width.
    """
    methods = estimates["method"].unique()
    table = _rows(estimates, course, methods, segment)
    size = (COLUMN_WIDTH, 3.0 + 0.15 * len(methods))
    ratios = (2, 0.15 * len(methods) + 0.2)
    drawn, (axes, ends) = plt.subplots(2, 1, figsize=size, sharex=True, height_ratios=ratios)
    for method, rows in table.groupby("method", sort=False):
        _draw_replicates(axes, rows, method, "relative_half_width")
        height = pd.Series(float(list(methods).index(method)), index=rows.index)
        _mark_convergence(ends, rows.assign(height=height), method, "height")
    axes.axhline(beta, label=rf"$\beta$ = {beta:g}", **REFERENCES["beta"])
    axes.set(xscale="log", yscale="log", ylabel="relative half-width")
    ends.set_title("all replicates, where they converge", loc="left")
    ends.set_yticks(range(len(methods)), methods)
    ends.set(ylim=(len(methods) - 0.4, -0.6))
    ends.set_xlabel(f"simulations, $v_L$ {segment.replace('-', '–')} m/s")
    if table["relative_half_width"].isna().all():
        axes.set_xlim(1, table["simulations"].max())
        say_no_crash(axes)
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.yaxis.set_minor_formatter(NullFormatter())
    for axis in (ends.xaxis, axes.yaxis):
        axis.set_major_formatter(StrMethodFormatter("{x:,g}"))
    _add_legend(drawn, methods)
    return drawn, _complete(table, "relative_half_width", {"beta": beta}, drop=list(NUMBERS[:3]))


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


def _front(rows: pd.DataFrame) -> int:
    """Return the median replicate by simulations until convergence; the first one if none converged."""
    ends = rows[rows["kind"] == "converged"].sort_values(["simulations", "replicate"], kind="stable")
    return rows["replicate"].min() if ends.empty else ends["replicate"].iloc[(len(ends) - 1) // 2]


def _draw_replicates(axes: Axes, rows: pd.DataFrame, method: str, column: str) -> None:
    """Draw all replicates of a method, the median one in front."""
    look = style_of(method, "color", "linestyle")
    front = _front(rows)
    for replicate, course in rows[rows["kind"] == "course"].groupby("replicate"):
        depth: Look = {"zorder": 2, "alpha": 0.3, "linewidth": 0.5}
        if replicate == front:
            depth = {"zorder": 3, "label": method}
        axes.plot(course["simulations"], course[column], **look, **depth)


def _mark_convergence(axes: Axes, rows: pd.DataFrame, method: str, column: str) -> None:
    """Mark where the replicates of a method converge; the marker of the median one is larger."""
    front = _front(rows)
    ends = rows[rows["kind"] == "converged"]
    style: Look = {"marker": "o", "markerfacecolor": "white", "linestyle": "none", "zorder": 4}
    for is_front, size in ((False, SMALL), (True, LARGE)):
        chosen = ends[(ends["replicate"] == front) == is_front]
        color = style_of(method)["color"]
        axes.plot(chosen["simulations"], chosen[column], color=color, markersize=size, **style)
    if len(ends):
        axes.plot([], [], color="black", markersize=LARGE, label="converged", **style)


def _add_legend(drawn: Figure, methods: Sequence[str]) -> None:
    """Draw a common legend above the panels, in which each label occurs once."""
    entries = [dict(zip(*axes.get_legend_handles_labels()[::-1], strict=True)) for axes in drawn.axes]
    named = {label: entry[label] for entry in entries for label in entry if label in methods}
    legend = named | entries[0]
    layout: Look = {"loc": "outside upper center", "ncols": 3, "columnspacing": 0.8, "handlelength": 1.5}
    drawn.legend(legend.values(), legend.keys(), **layout)


def _complete(
    table: pd.DataFrame, column: str, lines: Mapping[str, float], drop: str | list[str]
) -> pd.DataFrame:
    """Append the reference lines, as rows with their kind and value, to the table of drawn data."""
    rows = pd.DataFrame([{"kind": kind, column: value} for kind, value in lines.items()])
    complete = pd.concat([table.drop(columns=drop), rows])
    return complete.astype({"replicate": "Int64", "simulations": "Int64"}).reset_index(drop=True)
