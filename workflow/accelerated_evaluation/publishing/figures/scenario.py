"""Figures of the study of another scenario than the cut-in: its records, its answer, and its methods."""

from itertools import combinations

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from accelerated_evaluation.publishing.figures.dot_chart import draw_intervals, finish
from accelerated_evaluation.publishing.figures.method_styles import style_of
from accelerated_evaluation.publishing.figures.style import COLUMN_WIDTH, PIECES, note_source, paper_style
from accelerated_evaluation.publishing.published import figure
from accelerated_evaluation.scenarios.protocol import Scenario

CRASH = "#b2182b"
LEVELS = {95: 0.8, 80: 2.0, 50: 4.0}  # line width of each interval


@figure
def fig01_scenario_records(
    scenario_encounters: pd.DataFrame, scenario_runs: pd.DataFrame, scenario: Scenario, source: str
) -> tuple[Figure, pd.DataFrame]:
    """Draw the records, and the crashes among the runs of the surrogate, for each pair of variables.

    Parameters
    ----------
    scenario_encounters
        The records, with a column for each variable.
    scenario_runs
        The runs of the surrogate, with the same columns and ``event``.
    scenario
        The scenario, with the names and units of the variables.
    source
        Description of the data.

    Returns
    -------
    figure, data
        A panel for each pair of variables; the points, with ``kind`` (record or crash).
    """
    names = list(scenario.names)
    crashes = scenario_runs.loc[scenario_runs["event"], names]
    points = pd.concat(
        [scenario_encounters[names].assign(kind="record"), crashes.assign(kind="crash")], ignore_index=True
    )
    pairs = list(combinations(scenario.variables, 2))
    looks = (("record", PIECES[1], 2), ("crash", CRASH, 4))
    with paper_style():
        drawn, panels = plt.subplots(len(pairs), 1, figsize=(COLUMN_WIDTH, 2.1 * len(pairs)), squeeze=False)
        for axes, (x, y) in zip(panels[:, 0], pairs, strict=True):
            for kind, color, size in looks:
                own = points[points["kind"] == kind]
                axes.scatter(own[x.name], own[y.name], s=size, color=color, linewidth=0, label=kind)
            axes.set(xlabel=f"{x.name} [{x.unit}]", ylabel=f"{y.name} [{y.unit}]")
        drawn.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
        note_source(drawn, source)
    return drawn, points


@figure
def fig02_scenario_answer(scenario_answer: pd.DataFrame, source: str) -> tuple[Figure, pd.DataFrame]:
    """Draw the probability of each event with its 50, 80 and 95 % intervals.

    Parameters
    ----------
    scenario_answer
        A row for each event and part of the encounters.
    source
        Description of the data.

    Returns
    -------
    figure, data
        A row for each of them; the table itself.
    """
    table = scenario_answer.reset_index(drop=True)
    y = np.arange(len(table))
    with paper_style():
        drawn, axes = plt.subplots(figsize=(COLUMN_WIDTH, 1.2 + 0.35 * len(table)))
        for level, width in LEVELS.items():
            low, high = table[f"low{level}"], table[f"high{level}"]
            axes.hlines(y, low, high, color=PIECES[0], linewidth=width, label=f"{level} % interval")
        axes.plot(table["median"], y, "o", color="white", markeredgecolor=PIECES[0], label="median")
        axes.set_yticks(y, [f"{row.event}\n{row.encounters}" for row in table.itertuples()], fontsize=6)
        axes.set(xlabel="probability in an encounter", ylim=(len(table) - 0.4, -0.6))
        drawn.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=2)
        note_source(drawn, source)
    return drawn, table


@figure
def fig03_scenario_methods(
    scenario_estimates: pd.DataFrame, alpha: float, source: str
) -> tuple[Figure, pd.DataFrame]:
    """Draw the estimates of every method under the heaviest law, with their intervals.

    Parameters
    ----------
    scenario_estimates
        A row for each law, method and replicate.
    alpha
        The intervals are 100 (1 - alpha) %.
    source
        Description of the data.

    Returns
    -------
    figure, data
        A row for each replicate; law, method, replicate, probability, ci_low, ci_high, simulations.
    """
    together = scenario_estimates["learning"] + scenario_estimates["estimating"]
    columns = ["law", "method", "replicate", "probability", "ci_low", "ci_high", "simulations"]
    table = scenario_estimates.assign(simulations=together)[columns]
    with paper_style():
        drawn, axes = plt.subplots(figsize=(COLUMN_WIDTH, 0.9 + 0.1 * len(table)))
        for method, rows in table.groupby("method", sort=False):
            label = f"{method}, {rows['simulations'].mean():,.0f} simulations"
            draw_intervals(axes, rows, rows.index, label=label, **style_of(method, "color", "marker"))
        axes.set_yticks([])
        axes.set_xlabel(f"crash probability, {100 * (1 - alpha):g} % intervals")
        finish(drawn, axes, source)
    return drawn, table
