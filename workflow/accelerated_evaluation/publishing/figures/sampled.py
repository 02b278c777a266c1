"""Figures 35 and 36, beyond the paper: the answer for a slow vehicle, and its simulations."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from accelerated_evaluation.publishing.figures.dot_chart import FRAME, ROW
from accelerated_evaluation.publishing.figures.laws import draw_nested
from accelerated_evaluation.publishing.figures.style import COLUMN_WIDTH, note_source, paper_style
from accelerated_evaluation.publishing.published import figure
from accelerated_evaluation.scenarios.protocol import Scenario

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

    Parameters
    ----------
    answer, sampled_estimate
        ``laws/answer.csv`` and ``laws/estimate.csv`` of a study of a slow vehicle.
    scenario
        The scenario.
    source
        Description of the data.

    Returns
    -------
    figure, data
        The figure, and a table with a row for each row of the figure. Events without a known median are left
        out.
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

    Parameters
    ----------
    sampled_runs, sampled_crashes
        ``laws/runs.csv`` and ``laws/crashes.csv`` of a study of a slow vehicle.
    encounters
        Encounter table, with one row for each recorded cut-in.
    source
        Description of the data.

    Returns
    -------
    figure, data
        The figure, and a row for each simulation: outcome, lead_speed [m/s], range [m], closing_speed [m/s]
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
