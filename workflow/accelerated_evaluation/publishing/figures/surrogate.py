"""Figures 19, 20 and 35, beyond the paper: runs of the sampler, and what all methods cost and estimate."""

from collections.abc import Mapping

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.publishing.figures.dot_chart import (
    DOT,
    FRAME,
    INTERVAL,
    ROW,
    TRUTH,
    draw_intervals,
    draw_truth,
    finish,
    in_powers,
    name_groups,
    name_rows,
    scale_linearly,
    scale_logarithmically,
    spaced,
    write_beside,
)
from accelerated_evaluation.publishing.figures.style import COLUMN_WIDTH, note_source, paper_style, style_of
from accelerated_evaluation.publishing.published import figure
from accelerated_evaluation.publishing.tables.methods import PHASES, contradicted, side_by_side

# Names of the shares of simulations in the figure.
QUANTITIES = {"simulations": "all simulations", "of the estimate": "those of the estimate"}
SMALL = 0.01  # shares below this are not written as a number
WIDE = 10.0  # the axis of figure 35 is logarithmic if its values differ by more than this factor
MARGIN = 0.5  # margin around the crashes in figure 19 (b), in units of the normal scores
SCORES = {"z_range": "$R^{-1}$", "z_closing_speed": "$TTC^{-1}$"}
PHASE_LOOKS = {
    "search": {"color": "#8c8c8c", "marker": "^"},
    "learn": {"color": "#2b8cbe", "marker": "s"},
    "estimate": style_of("surrogate", "color", "marker"),
}


@figure
def fig19_surrogate_runs(
    runs: pd.DataFrame, exact: pd.DataFrame, shares: Mapping[str, float], source: str
) -> tuple[Figure, pd.DataFrame]:
    """Draw the cut-ins that the surrogate-guided sampler simulates.

    One replicate is drawn in normal scores, the standard normal coordinates of the law; for all replicates
    the shares of the segments are drawn.

    ``shares``: share of each segment in the lane changes; the paper's methods divide their simulations in the
    same way. Panel (a) shows every simulation of the first replicate over all segments. Panel (b) enlarges
    the part with the crashes of the phases learn and estimate. Their data are run, phase, segment, z_range,
    z_closing_speed and event. Panel (c) shows, for each segment, the shares of lane changes, simulations of
    all replicates, and crashes: segment, quantity and share.
    """
    runs = runs[runs["scope"] == "all"]
    shown = runs.loc[runs["replicate"] == 0, ["run", "phase", "segment", *SCORES, "event"]]
    spread = _shares_by_segment(runs, exact, shares)
    y = spaced(spread["segment"], 1.5)
    with paper_style():
        size = (2 * COLUMN_WIDTH, FRAME + 1.2 * ROW * y.max())
        drawn, panels = plt.subplot_mosaic("abc", figsize=size, width_ratios=(1, 1, 0.8))
        titles = {"a": "all simulations", "b": "near the crashes", "c": "shares by lead speed"}
        for letter, axes in panels.items():
            axes.set_title(f"({letter}) {titles[letter]}", loc="left")
        for letter in "ab":
            _draw_scores(panels[letter], shown)
        core = shown.loc[shown["event"] & (shown["phase"] != PHASES[0]), list(SCORES)]
        if not core.empty:
            low, high = core.min() - MARGIN, core.max() + MARGIN
            panels["b"].set(**{f"{axis}lim": (low[z], high[z]) for axis, z in zip("xy", SCORES, strict=True)})
        panels["a"].set_ylabel(f"score of {SCORES['z_closing_speed']}")
        _draw_shares(panels["c"], spread, y)
        signs = panels["a"].get_legend_handles_labels()
        drawn.legend(*signs, loc="outside upper center", ncols=6, columnspacing=1, handletextpad=0.3)
        note_source(drawn, source)
    return drawn, pd.concat([shown.assign(panel="a, b"), spread.assign(panel="c")], ignore_index=True)


@figure
def fig20_methods(replicates: pd.DataFrame, exact: pd.DataFrame, source: str) -> tuple[Figure, pd.DataFrame]:
    """Draw the number of simulations and the estimate of every replicate of every method, over all segments.

    The data have a row for each replicate: method, replicate, the simulations spent on ``learning``, on
    ``estimating`` and ``together``; probability, ci_low, ci_high and ``to_exact``, the ratio to the exact
    probability.
    """
    truth = exact.set_index("segment").loc["all"]
    data = side_by_side(replicates, "all")
    data["to_exact"] = data["probability"] / truth["probability"]
    ratios = data[["probability", "ci_low", "ci_high"]] / truth["probability"]
    y = spaced(data["method"], 1.0)
    with paper_style():
        height = FRAME + 0.6 * ROW * y.max()
        drawn, (left, right) = plt.subplots(1, 2, figsize=(COLUMN_WIDTH, height), sharey=True)
        for method in data["method"].unique():
            rows, look = data["method"] == method, style_of(method, "color", "marker")
            style = {"linestyle": "none", "markersize": 3.5, "markeredgewidth": 0.6} | look
            left.plot(data.loc[rows, "estimating"], y[rows], fillstyle="none", **style)
            left.plot(data.loc[rows, "together"], y[rows], **style)
            draw_intervals(right, ratios[rows], y[rows], **look)
        right.axvline(1, **TRUTH)
        left.set(xscale="log", xlabel="simulations")
        low, high = left.get_xlim()
        left.xaxis.set_major_locator(LogLocator(subs=(1, 3) if high < 100 * low else (1,), numticks=4))
        left.xaxis.set_major_formatter(lambda value, _: in_powers(value))
        left.xaxis.set_minor_formatter(NullFormatter())
        # The upper limits of estimates without a crash would make the axis too long.
        seen = ratios.loc[ratios["probability"] > 0, "ci_high"].max()
        right.set_xlim(0, 1.05 * np.fmax(seen, 1))
        scale_linearly(right, "estimate / exact")
        name_groups(left, y, data["method"])
        left.invert_yaxis()
        sign = {"color": "black", "marker": "o", "linestyle": "none", "markersize": 3.5}
        signs = [
            plt.Line2D([], [], **sign, fillstyle="none", label="estimating"),
            plt.Line2D([], [], **sign, label="learning and estimating"),
            plt.Line2D([], [], **TRUTH, label="exact"),
        ]
        drawn.legend(handles=signs, loc="outside upper center", ncols=3, columnspacing=1, handletextpad=0.3)
        note_source(drawn, source)
    return drawn, data


def _shares_by_segment(runs: pd.DataFrame, exact: pd.DataFrame, shares: Mapping[str, float]) -> pd.DataFrame:
    """Return the shares of the segments in lane changes, simulations and crashes, in rows."""
    share = pd.Series(shares)
    crashes = exact.set_index("segment")["probability"][share.index] * share
    counted = runs[runs["phase"] == PHASES[-1]]
    table = pd.DataFrame(
        {
            "lane changes": share,
            "simulations": runs["segment"].value_counts(normalize=True),
            "of the estimate": counted["segment"].value_counts(normalize=True),
            "crashes": crashes / crashes.sum(),
        }
    )
    long = (
        table.loc[share.index].fillna(0.0).T.melt(var_name="segment", value_name="share", ignore_index=False)
    )
    return long.rename_axis("quantity").reset_index()[["segment", "quantity", "share"]]


def _draw_scores(axes: Axes, shown: pd.DataFrame) -> None:
    """Draw simulations in the plane of normal scores, with a marker for each phase, filled for a crash."""
    style = {"linestyle": "none", "markersize": 3, "markeredgewidth": 0.6}
    for phase, look in PHASE_LOOKS.items():
        for event, outcome in ((False, "no crash"), (True, "crash")):
            rows = shown[(shown["phase"] == phase) & (shown["event"] == event)]
            how = {"fillstyle": "full" if event else "none", "zorder": 3 if event else 2}
            axes.plot(*(rows[z] for z in SCORES), label=f"{phase}, {outcome}", **style, **how, **look)
    axes.set_xlabel(f"score of {SCORES['z_range']}")


def _draw_shares(axes: Axes, spread: pd.DataFrame, y: Array) -> None:
    """Draw shares as rows, segment by segment, with their values next to them."""
    axes.hlines(y, 0, spread["share"], color=DOT["color"], linewidth=0.8, zorder=2)
    axes.plot(spread["share"], y, clip_on=False, zorder=3, **DOT)
    names = spread["quantity"].replace(QUANTITIES)
    name_rows(axes, y, spread["segment"].str.replace("-", "–") + " m/s", names)
    texts = (f"{100 * share:.0f} %" if share >= SMALL or not share else "<1 %" for share in spread["share"])
    write_beside(axes, y, texts, "")
    axes.set(xlabel="share", xlim=(0, 1.06))
    axes.invert_yaxis()


@figure
def fig35_scenario_methods(
    scenario_estimates: pd.DataFrame, alpha: float, source: str
) -> tuple[Figure, pd.DataFrame]:
    """Draw the estimates of each method with their intervals, for the law with the largest weight.

    The figure has a row for each replicate, with an open marker if it has not converged, a cross if the other
    estimates contradict it (`contradicted`), and an arrow at the upper limit if it has no event. The columns
    of the data are law, event, method, replicate, probability, ci_low, ci_high, simulations, converged and
    contradicted.
    """
    together = scenario_estimates["learning"] + scenario_estimates["estimating"]
    columns = ["law", "event", "method", "replicate", *INTERVAL, "simulations", "converged", "contradicted"]
    table = scenario_estimates.assign(
        simulations=together, contradicted=contradicted(scenario_estimates, alpha)
    )[columns].reset_index(drop=True)
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
        if table["contradicted"].any():
            cross = {"color": "#cb181d", "linestyle": "none", "markersize": 7, "label": "contradicted"}
            axes.plot(*(table["probability"][table["contradicted"]], y[table["contradicted"]]), "x", **cross)
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


def _scale(axes: Axes, values: pd.DataFrame, label: str) -> None:
    """Label x, and scale it logarithmically if the positive values differ by more than a factor of `WIDE`."""
    positive = values.to_numpy(float)[values.to_numpy(float) > 0]
    wide = positive.size and positive.max() > WIDE * positive.min()
    (scale_logarithmically if wide else scale_linearly)(axes, label)
