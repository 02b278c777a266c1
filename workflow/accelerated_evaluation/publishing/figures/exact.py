"""Figures 14 to 17, beyond the paper: estimates, choices, uncertainty, severity and the exact probability."""

import re
from itertools import cycle
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from scipy.special import ndtri

from accelerated_evaluation.publishing.figures.dot_chart import (
    DOT,
    FRAME,
    INTERVAL,
    ROW,
    draw_intervals,
    draw_truth,
    finish,
    in_ratios,
    name_groups,
    name_rows,
    scale_linearly,
    scale_logarithmically,
    spaced,
    write_beside,
)
from accelerated_evaluation.publishing.figures.style import (
    COLUMN_WIDTH,
    PIECES,
    Drawn,
    Look,
    say_no_crash,
    style_of,
)
from accelerated_evaluation.publishing.published import figure
from accelerated_evaluation.publishing.tables.exact import severity_digest
from accelerated_evaluation.publishing.tables.spreads import of_method

PAPER: Look = {"color": "black", "marker": "*"}
RARE = 1e-6  # smallest share of crashes that figure 17 shows, and of a segment in all of them


@figure
def fig14_estimates_against_truth(
    estimates: pd.DataFrame,
    exact: pd.DataFrame,
    paper_interval: tuple[float, float],
    alpha: float,
    crude: pd.DataFrame | None = None,
) -> Drawn:
    """Draw the estimates over all segments with their intervals against the exact probability.

    The figure has a row for each replicate. The columns of the data are kind (exact, paper or estimate),
    method, replicate, simulations, probability, ci_low and ci_high.
    """
    data = _estimate_rows(estimates, _all(exact), paper_interval, alpha, crude)
    shown = data.iloc[1:]
    label = shown["method"].fillna("paper")
    y = spaced(label, 1.0)
    drawn, axes = plt.subplots(figsize=(COLUMN_WIDTH, FRAME + 0.7 * ROW * y.max()))
    for name in label.unique():
        look = (PAPER if name == "paper" else style_of(name)) | {"linestyle": "none"}
        draw_intervals(axes, shown[label == name], y[label == name], **look)
    draw_truth(axes, data.iloc[0], "exact")
    name_groups(axes, y, label.replace("paper", "paper\n(its model)"))
    # The upper limits of estimates without a crash would make the axis too long.
    seen = data.loc[data["probability"] > 0, "ci_high"]
    axes.set(xlim=(0, 1.05 * seen.max()))
    if not data["probability"].iloc[0]:
        say_no_crash(axes)
    scale_linearly(axes, "crash probability")
    finish(drawn, axes)
    return drawn, data


@figure
def fig15_sensitivity(sensitivity: pd.DataFrame, exact: pd.DataFrame) -> Drawn:
    """Draw the crash probability over all segments when one choice of the study is changed at a time.

    The figure has a row for each choice and value. The caps on the closing speed have a panel of their own,
    because they change the probability by orders of magnitude. The columns of the data are choice, value,
    probability, standard_error and ratio, the ratio to the probability of the study. The first row is the
    study.
    """
    truth = _all(exact)
    study = {"choice": "study", "value": "all as configured", **truth[["probability", "standard_error"]]}
    data = pd.concat([pd.DataFrame([study]), sensitivity], ignore_index=True)
    data["ratio"] = data["probability"] / truth["probability"]
    shown = data.iloc[1:]
    is_cap = shown["choice"].str.startswith("closing-speed cap")
    parts = [part for part in (shown[~is_cap], shown[is_cap]) if len(part)]
    places = [spaced(part["choice"], 1.5) for part in parts]
    heights = [y.max() + 3 for y in places]
    size = (COLUMN_WIDTH, FRAME + ROW * sum(heights))
    drawn, panels = plt.subplots(len(parts), 1, figsize=size, height_ratios=heights, squeeze=False)
    for axes, part, y in zip(panels[:, 0], parts, places, strict=True):
        axes.plot(part["probability"], y, **DOT)
        draw_truth(axes, data.iloc[0], "the study")
        name_rows(axes, y, part["choice"].map(_in_symbols), part["value"].map(_value_label))
        write_beside(axes, y, in_ratios(part["ratio"]), "× study")
        axes.invert_yaxis()
        if part["probability"].gt(0).any():
            scale_logarithmically(axes, "crash probability")
        else:
            say_no_crash(axes)
    drawn.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside upper center")
    return drawn, data


@figure
def fig16_uncertainty(uncertainty: pd.DataFrame, bootstrap: pd.DataFrame, exact: pd.DataFrame) -> Drawn:
    """Draw the crash probability with its interval for each source of uncertainty.

    The first source is the sampling error, which is the only one in the paper.

    The columns of the data are kind (exact, budget or refit), source, probability, ci_low, ci_high and
    variance_share. A refit is the probability from one bootstrap sample of the records.
    """
    budget = uncertainty.assign(kind="budget")
    refits = bootstrap[["probability"]].assign(kind="refit", source="data")
    truth = _all(exact)[["probability"]].to_frame().T.assign(kind="exact")
    data = pd.concat([truth, budget, refits], ignore_index=True)
    data = data[["kind", "source", *INTERVAL, "variance_share"]]
    names = {"sampling": "sampling (paper)", "data": "data (bootstrap)"}
    y = np.arange(len(budget))
    drawn, axes = plt.subplots(figsize=(COLUMN_WIDTH, 2.2))
    at = np.flatnonzero(budget["source"] == "data")[0] + 0.3
    strokes: Look = {"color": PIECES[2], "marker": "|", "linestyle": "none", "markersize": 5, "zorder": 1}
    strokes["label"] = "one bootstrap refit"
    axes.plot(refits["probability"], np.full(len(refits), at), markeredgewidth=0.5, **strokes)
    draw_intervals(axes, budget, y, **{**DOT, "linewidth": 1.5})
    draw_truth(axes, data.iloc[0], "exact, model of the study")
    axes.set_yticks(y, budget["source"].replace(names))
    write_beside(axes, y, (100 * budget["variance_share"]).map("{:.1f} %".format), "variance")
    axes.set(xlim=(0, None), ylim=(-0.5, len(budget) - 0.4))
    scale_linearly(axes, "crash probability")
    if not data["probability"].iloc[0]:
        say_no_crash(axes)
    finish(drawn, axes)
    return drawn, data


@figure
def fig17_severity(severity: pd.DataFrame) -> Drawn:
    """Draw the distribution of impact speeds by segment, and the probabilities of near misses.

    Panel (a) shows the share of crashes with an impact speed above a threshold, down to `RARE`. Segments
    whose crash probability is below `RARE` times that of all are left out. Panel (b) shows the probability of
    a crash and of each near miss, over all segments. The data have the columns of ``severity``, and panel.
    """
    near = severity_digest(severity[severity["quantity"] != "impact_speed"])
    chosen = (severity["quantity"] != "impact_speed") & (severity["segment"] == "all")
    impacts = severity[severity["quantity"] == "impact_speed"].assign(panel="a")
    data = pd.concat([impacts, severity[chosen].assign(panel="b")], ignore_index=True)
    of_crash = severity[severity["quantity"] == "crash"].set_index("segment")["probability"]
    segments = [name for name in of_crash.index if name != "all" and of_crash[name] > RARE * of_crash["all"]]
    colors = mpl.colormaps["Blues"](np.linspace(1, 0.6, max(len(segments), 1)))
    drawn, (top, bottom) = plt.subplots(2, 1, figsize=(COLUMN_WIDTH, 4.2))
    looks = [{"color": "#c0c0c0", "linewidth": 4, "label": "all segments"}]
    looks += [
        {"color": color, "linestyle": line, "marker": marker, "markersize": 3}
        for color, line, marker in zip(colors, cycle(("-", "--", "-.", ":")), cycle("os^D"), strict=False)
    ]
    for segment, look in zip(("all", *segments), looks, strict=False):
        rows = impacts[(impacts["segment"] == segment) & (impacts["to_crash"] >= RARE)]
        named = {"label": f"{segment.replace('-', '–')} m/s"} | look
        top.plot(rows["threshold"], rows["to_crash"], **named)
    if impacts["to_crash"].ge(RARE).any():
        top.set_yscale("log")
    else:
        say_no_crash(top)
    top.set_title("(a) impact speeds, paper's law", loc="left")
    top.set(xlabel="impact speed $v$ [m/s]", ylabel="share of crashes above $v$")
    y = np.arange(len(near))
    bottom.set_title("(b) near misses, paper's law", loc="left")
    bottom.plot(near["probability"], y, **DOT)
    bottom.set_yticks(y, near["event"].str.replace("smallest ", "", regex=False))
    write_beside(bottom, y, in_ratios(near["to_crash"]), "× crash")
    bottom.set_xlabel("probability in a lane change")
    if near["probability"].gt(0).any():
        scale_logarithmically(bottom, bottom.get_xlabel())
    bottom.invert_yaxis()
    drawn.legend(*top.get_legend_handles_labels(), loc="outside upper center", ncols=4)
    return drawn, data


def _estimate_rows(
    estimates: pd.DataFrame,
    truth: pd.Series,
    paper: tuple[float, float],
    alpha: float,
    crude: pd.DataFrame | None,
) -> pd.DataFrame:
    """Return rows for the exact value, the paper's interval, the estimates and crude Monte Carlo."""
    reach = -ndtri(alpha / 2) * truth["standard_error"]
    value = {"kind": "exact", "probability": truth["probability"]}
    lines = [value | {"ci_low": value["probability"] - reach, "ci_high": value["probability"] + reach}]
    lines.append(dict(zip(("kind", *INTERVAL), ("paper", sum(paper) / 2, *paper), strict=True)))
    parts = [of_method(estimates, method) for method in estimates["method"].unique()]
    if crude is not None:
        parts.append(crude[crude["segment"] == "all"].assign(method="crude", replicate=0))
    rows = pd.concat([pd.DataFrame(lines), pd.concat(parts).assign(kind="estimate")], ignore_index=True)
    return rows[["kind", "method", "replicate", "simulations", *INTERVAL]].astype(
        {"replicate": "Int64", "simulations": "Int64"}
    )


def _all(exact: pd.DataFrame) -> pd.Series:
    return exact.set_index("segment").loc["all"]


def _in_symbols(text: str) -> str:
    """Write the names of quantities as in the paper."""
    return re.sub(r"(TTC|R)\^-1", r"$\1^{-1}$", text).replace("v_L", "$v_L$ [m/s]")


def _value_label(value: Any) -> str:  # noqa: ANN401
    return str(value).replace(" ", "–").replace("_", " ")
