"""Figures 14 to 17, beyond the paper: estimates, choices, uncertainty, severity and the exact probability."""

import re
from itertools import cycle
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
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
    spaced,
    write_beside,
)
from accelerated_evaluation.publishing.figures.method_styles import style_of
from accelerated_evaluation.publishing.figures.style import (
    COLUMN_WIDTH,
    PIECES,
    note_source,
    paper_style,
    say_no_crash,
)
from accelerated_evaluation.publishing.published import figure
from accelerated_evaluation.publishing.tables.exact import severity_digest
from accelerated_evaluation.publishing.tables.spreads import of_method

PAPER = {"color": "black", "marker": "*"}
RARE = 1e-6  # smallest share of crashes that figure 17 shows


@figure
def fig14_estimates_against_truth(
    estimates: pd.DataFrame,
    exact: pd.DataFrame,
    paper_interval: tuple[float, float],
    alpha: float,
    source: str,
    crude: pd.DataFrame | None = None,
) -> tuple[Figure, pd.DataFrame]:
    """Draw the estimates over all segments with their intervals against the exact probability.

    Parameters
    ----------
    estimates, exact
        ``estimates.csv`` and ``exact.csv`` of a study.
    paper_interval
        Lower and upper limit of the paper's interval (section VI.C).
    alpha
        The level of the intervals is 1 - alpha.
    source
        Description of the data.
    crude
        ``crude.csv``, where crude Monte Carlo has been run.

    Returns
    -------
    figure, data
        The figure has a row for each replicate. The columns of the data are kind (exact, paper or estimate),
        method, replicate, simulations, probability, ci_low and ci_high.
    """
    data = _estimate_rows(estimates, _all(exact), paper_interval, alpha, crude)
    with paper_style():
        shown = data.iloc[1:]
        label = shown["method"].fillna("paper")
        y = spaced(label, 1.0)
        drawn, axes = plt.subplots(figsize=(COLUMN_WIDTH, FRAME + 0.7 * ROW * y.max()))
        for name in label.unique():
            look = (PAPER if name == "paper" else style_of(name)) | {"linestyle": "none"}
            draw_intervals(axes, shown[label == name], y[label == name], **look)
        draw_truth(axes, data.iloc[0], f"exact, {100 * (1 - alpha):g} % band")
        name_groups(axes, y, label)
        # The upper limits of estimates without a crash would make the axis too long.
        seen = data.loc[data["probability"] > 0, "ci_high"]
        axes.set(xlabel="crash probability", xlim=(0, 1.05 * seen.max()))
        if not data["probability"].iloc[0]:
            say_no_crash(axes)
        axes.ticklabel_format(axis="x", style="sci", scilimits=(0, 0), useMathText=True)
        finish(drawn, axes, source)
    return drawn, data


@figure
def fig15_sensitivity(
    sensitivity: pd.DataFrame, exact: pd.DataFrame, source: str
) -> tuple[Figure, pd.DataFrame]:
    """Draw the crash probability over all segments when one choice of the study is changed at a time.

    Parameters
    ----------
    sensitivity, exact
        ``sensitivity.csv`` and ``exact.csv`` of a study.
    source
        Description of the data.

    Returns
    -------
    figure, data
        The figure has a row for each choice and value. The columns of the data are choice, value,
        probability, standard_error and ratio, the ratio to the probability of the study. The first row is the
        study.
    """
    truth = _all(exact)
    study = {"choice": "study", "value": "all as configured", **truth[["probability", "standard_error"]]}
    data = pd.concat([pd.DataFrame([study]), sensitivity], ignore_index=True)
    data["ratio"] = data["probability"] / truth["probability"]
    shown = data.iloc[1:]
    y = spaced(shown["choice"], 1.5)
    with paper_style():
        drawn, axes = plt.subplots(figsize=(COLUMN_WIDTH, FRAME + ROW * y.max()))
        axes.plot(shown["probability"], y, **DOT)
        draw_truth(axes, data.iloc[0], "model, data and vehicle of the study")
        name_rows(axes, y, shown["choice"].map(_in_symbols), shown["value"].map(_value_label))
        write_beside(axes, y, in_ratios(shown["ratio"]), "to study")
        axes.set(xlabel="crash probability")
        if shown["probability"].gt(0).any():
            axes.set_xscale("log")
        else:
            say_no_crash(axes)
        finish(drawn, axes, source)
    return drawn, data


@figure
def fig16_uncertainty(
    uncertainty: pd.DataFrame, bootstrap: pd.DataFrame, exact: pd.DataFrame, source: str
) -> tuple[Figure, pd.DataFrame]:
    """Draw the crash probability with its interval for each source of uncertainty.

    The first source is the sampling error, which is the only one in the paper.

    Parameters
    ----------
    uncertainty, bootstrap, exact
        ``uncertainty.csv``, ``bootstrap.csv`` and ``exact.csv`` of a study.
    source
        Description of the data.

    Returns
    -------
    figure, data
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
    with paper_style():
        drawn, axes = plt.subplots(figsize=(COLUMN_WIDTH, 2.2))
        at = np.flatnonzero(budget["source"] == "data")[0] + 0.3
        strokes = {"color": PIECES[2], "marker": "|", "linestyle": "none", "markersize": 5, "zorder": 1}
        axes.plot(refits["probability"], np.full(len(refits), at), markeredgewidth=0.3, **strokes)
        draw_intervals(axes, budget, y, **{**DOT, "linewidth": 1.5})
        draw_truth(axes, data.iloc[0], "exact, model of the study")
        axes.set_yticks(y, budget["source"].replace(names))
        write_beside(axes, y, budget["variance_share"].map("{:.1%}".format), "of variance")
        axes.set(xlabel="crash probability")
        axes.ticklabel_format(axis="x", style="sci", scilimits=(0, 0), useMathText=True)
        axes.set(xlim=(0, None), ylim=(-0.5, len(budget) - 0.4))
        if not data["probability"].iloc[0]:
            say_no_crash(axes)
        finish(drawn, axes, source)
    return drawn, data


@figure
def fig17_severity(severity: pd.DataFrame, source: str) -> tuple[Figure, pd.DataFrame]:
    """Draw the distribution of impact speeds by segment, and the probabilities of near misses.

    Parameters
    ----------
    severity
        ``severity.csv`` of a study.
    source
        Description of the data.

    Returns
    -------
    figure, data
        Panel (a) shows the share of crashes with an impact speed above a threshold, down to `RARE`. Panel (b)
        shows the probability of a crash and of each near miss, over all segments. The data have the columns
        of ``severity``, and panel.
    """
    near = severity_digest(severity[severity["quantity"] != "impact_speed"])
    chosen = (severity["quantity"] != "impact_speed") & (severity["segment"] == "all")
    impacts = severity[severity["quantity"] == "impact_speed"].assign(panel="a")
    data = pd.concat([impacts, severity[chosen].assign(panel="b")], ignore_index=True)
    segments = impacts["segment"].unique()
    colors = mpl.colormaps["Blues"](np.linspace(1, 0.45, segments.size))
    with paper_style():
        drawn, (top, bottom) = plt.subplots(2, 1, figsize=(COLUMN_WIDTH, 4.2))
        for segment, color, line, marker in zip(
            segments[::-1], colors, cycle(("-", "--", "-.", ":")), cycle("os^D")
        ):
            rows = impacts[(impacts["segment"] == segment) & (impacts["to_crash"] >= RARE)]
            label = segment if segment == "all" else f"{segment.replace('-', '–')} m/s"
            look = {"color": color, "linestyle": line, "marker": marker, "markersize": 3}
            top.plot(rows["threshold"], rows["to_crash"], label=label, **look)
        if impacts["to_crash"].ge(RARE).any():
            top.set_yscale("log")
        else:
            say_no_crash(top)
        top.set(xlabel="impact speed $v$ [m/s]", ylabel="share of crashes above $v$")
        y = np.arange(len(near))
        bottom.plot(near["probability"], y, **DOT)
        bottom.set_yticks(y, near["event"])
        write_beside(bottom, y, in_ratios(near["to_crash"]), "to crash")
        if near["probability"].gt(0).any():
            bottom.set_xscale("log")
        bottom.set(xlabel="probability in a lane change")
        bottom.invert_yaxis()
        drawn.legend(*top.get_legend_handles_labels(), loc="outside upper center", ncols=4)
        note_source(drawn, source)
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
