"""Figures 20 and 35, beyond the paper: what all methods cost and estimate."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter

from accelerated_evaluation.publishing.figures.dot_chart import (
    FRAME,
    INTERVAL,
    ROW,
    TRUTH,
    draw_intervals,
    draw_truth,
    finish,
    in_powers,
    name_groups,
    scale_linearly,
    scale_logarithmically,
    spaced,
)
from accelerated_evaluation.publishing.figures.style import COLUMN_WIDTH, Drawn, Look, style_of
from accelerated_evaluation.publishing.published import figure
from accelerated_evaluation.publishing.tables.methods import contradicted, side_by_side

WIDE = 10.0  # the axis of figure 35 is logarithmic if its values differ by more than this factor


@figure
def fig20_methods(replicates: pd.DataFrame, exact: pd.DataFrame) -> Drawn:
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
    height = FRAME + 0.6 * ROW * y.max()
    drawn, (left, right) = plt.subplots(1, 2, figsize=(COLUMN_WIDTH, height), sharey=True)
    for method in data["method"].unique():
        rows, look = data["method"] == method, style_of(method, "color", "marker")
        style: Look = {"linestyle": "none", "markersize": 3.5, "markeredgewidth": 0.6} | look
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
    sign: Look = {"color": "black", "marker": "o", "linestyle": "none", "markersize": 3.5}
    signs = [
        plt.Line2D([], [], **sign, fillstyle="none", label="estimating"),
        plt.Line2D([], [], **sign, label="learning and estimating"),
        plt.Line2D([], [], **TRUTH, label="exact"),
    ]
    drawn.legend(handles=signs, loc="outside upper center", ncols=3, columnspacing=1, handletextpad=0.3)
    return drawn, data


@figure
def fig35_scenario_methods(scenario_estimates: pd.DataFrame, alpha: float) -> Drawn:
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
    kinds: dict[str, tuple[pd.Series, Look]] = {
        "converged": (found & table["converged"], {}),
        "not converged": (found & ~table["converged"], {"markerfacecolor": "white"}),
    }
    runs = table.groupby("method", sort=False)["simulations"].mean()
    drawn, axes = plt.subplots(figsize=(COLUMN_WIDTH, FRAME + 0.1 * (y.max() + 4)))
    for kind, (chosen, fill) in kinds.items():
        for method, rows in table[chosen].groupby("method", sort=False):
            draw_intervals(axes, rows, y[rows.index], **style_of(str(method), "color", "marker"), **fill)
        if chosen.any():
            axes.plot([], [], "s", color="black", markersize=3.5, label=kind, **fill)
    if table["contradicted"].any():
        cross: Look = {"color": "#cb181d", "linestyle": "none", "markersize": 7, "label": "contradicted"}
        axes.plot(*(table["probability"][table["contradicted"]], y[table["contradicted"]]), "x", **cross)
    if not found.all():
        arrow: Look = {"color": "black", "linestyle": "none", "markersize": 4}
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
    finish(drawn, axes)
    return drawn, table


def _scale(axes: Axes, values: pd.DataFrame, label: str) -> None:
    """Label x, and scale it logarithmically if the positive values differ by more than a factor of `WIDE`."""
    positive = values.to_numpy(float)[values.to_numpy(float) > 0]
    wide = positive.size and positive.max() > WIDE * positive.min()
    (scale_logarithmically if wide else scale_linearly)(axes, label)
