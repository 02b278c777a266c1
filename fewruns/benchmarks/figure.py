"""Draw the comparison: for each problem the simulations that each method needs for the target."""

import argparse
from collections.abc import Mapping

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from accelerated_evaluation.publishing.figures.style import (
    COLUMN_WIDTH,
    note_source,
    paper_style,
    save_figure,
)
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from methods import DIRECTIONS, SEARCHING, TOOLS
from problems import problems

LABELS = {
    "surrogate": "this project",
    "nais": "OpenTURNS NAIS",
    "nais_25": "NAIS, quarter kept",
    "cross_entropy": "OpenTURNS Cross-Entropy",
    "subset": "OpenTURNS subset sampling",
    "form": "OpenTURNS FORM + IS",
    "enkf": "EnKF (rareeventestimation)",
    "directional": "directional sampling",
    "line": "line sampling along FORM",
    "piecewise": "paper, piecewise",
    "single": "paper, single",
    "shifted": "paper, knots shifted",
    "crude": "crude Monte Carlo",
}
KINDS = {  # look of each kind of method, reported apart by shape and grey
    "this project": (("surrogate",), {"marker": "D", "color": "black", "markersize": 4.5}),
    "public tools": ((*TOOLS, *DIRECTIONS), {"marker": "s", "color": "#08306b"}),
    "Cross-Entropy searches": (SEARCHING, {"marker": "o", "color": "#4292c6"}),
    "crude": (("crude",), {"marker": "^", "color": "#777777"}),
}
LOOKS = {method: look for methods, look in KINDS.values() for method in methods}
FAILING = 0.05  # share of failed seeds from which a marker is hollow
# The main problem, a rarer crash, another event, and three events of known shape. The table has all problems.
SHOWN = ("segment_5_15", "segment_15_25", "near_miss_1e-5", "two_regions", "circle", "four_branches")
COLUMNS = 3


def draw_panel(axes: Axes, rows: pd.DataFrame) -> None:
    """Draw the methods of one problem, a row each."""
    heights = {method: height for height, method in enumerate(LABELS)}
    for row in rows.itertuples():
        y, look = heights[row.method], LOOKS[row.method]
        if row.seeds == 0:  # crude Monte Carlo by theory
            style = {"ha": "right", "va": "center"}
            axes.text(0.98, y, in_powers(row.calls_mean), transform=axes.get_yaxis_transform(), **style)
            continue
        hollow = {"markerfacecolor": "white"} if row.failed >= FAILING else {}
        reach = row.effective_calls * relative_reach(row)
        drawn = axes.errorbar(
            row.effective_calls,
            y,
            xerr=reach if np.isfinite(reach) else None,
            linestyle="none",
            **{"markersize": 3.5, "elinewidth": 0.8} | look | hollow,
        )
        drawn[0].set_clip_on(False)  # the marker, but not its bar
        axes.plot(row.calls_mean, y, marker="|", color="black", markersize=5, markeredgewidth=0.6)
        axes.text(1.02, y, remark(row), transform=axes.get_yaxis_transform(), va="center")
    axes.set(xscale="log", xlim=(8, 1e7), ylim=(len(LABELS) - 0.4, -0.6))
    axes.set_xticks([100, 10_000, 1_000_000])
    axes.set_xticks(np.logspace(1, 7, 7), [""] * 7, minor=True)
    axes.set_yticks(range(len(LABELS)), LABELS.values())
    axes.text(1.02, 1.01, "% (failed)", transform=axes.transAxes, va="bottom")
    label = problems()[rows["problem"].iloc[0]].label
    axes.set_title(f"{label}, {in_powers(rows['reference'].iloc[0])}", loc="left", pad=11)


def relative_reach(row: pd.Series) -> float:
    """Relative half-width of the 95 % interval of the effective number of simulations."""
    return 1.96 * float(np.hypot(2 * row.cov_se / row.cov, row.calls_mean_se / row.calls_mean))


def remark(row: pd.Series) -> str:
    """Return the coverage, and the failures if there are any, in percent."""
    failed = f" ({100 * row.failed:.3g})" if row.failed > 0 else ""
    return f"{100 * row.coverage80:.0f}{failed}"


def in_powers(value: float) -> str:
    """Write a number with two digits and a power of ten, as formula."""
    mantissa, exponent = f"{value:.1e}".split("e")
    return rf"{mantissa}$\cdot$10$^{{{int(exponent)}}}$"


def draw(table: pd.DataFrame) -> Figure:
    """Return the figure, a panel for each of the problems ``SHOWN``."""
    compared = table[table["problem"].isin(SHOWN)]
    panels = dict(list(compared.groupby("problem", sort=False)))
    lines = -(-len(panels) // COLUMNS)
    figure, axes = plt.subplots(
        lines,
        COLUMNS,
        figsize=(2 * COLUMN_WIDTH, 2.4 * lines + 0.6),
        sharex=True,
        sharey=True,
        squeeze=False,
    )
    for each, rows in zip(axes.flat, panels.values(), strict=False):
        draw_panel(each, rows)
    for each in axes.flat[len(panels) :]:
        each.set_axis_off()
    for each in axes.flat[max(len(panels) - COLUMNS, 0) : len(panels)]:  # the lowest of each column
        each.set_xlabel("simulations")
        each.tick_params(labelbottom=True)
    run = compared.loc[compared["seeds"] > 0, "method"]
    kinds = {name: kind for name, kind in KINDS.items() if run.isin(kind[0]).any()}
    looks = [Line2D([], [], linestyle="none", label=name, **look) for name, (_, look) in kinds.items()]
    hollow = Line2D([], [], linestyle="none", marker="s", markerfacecolor="white", color="#08306b")
    hollow.set_label(f"{100 * FAILING:g} % and more failed")
    made = Line2D([], [], linestyle="none", marker="|", color="black", label="simulations made")
    figure.legend(handles=[*looks, hollow, made], loc="outside upper center", ncols=3)
    note_source(
        figure,
        f"{seeds_made(compared, kinds)}; a number in a panel: crude by theory.\n"
        "Marker: simulations for a root-mean-square error of 0.156 (95 % limits).\n"
        "On the right: how often the method's own 80 % interval covers, and (failed seeds), in %",
    )
    return figure


def seeds_made(compared: pd.DataFrame, kinds: Mapping[str, tuple]) -> str:
    """Tell the numbers of seeds of each kind of method."""
    parts = []
    for name, (methods, _) in kinds.items():
        seeds = compared.loc[compared["method"].isin(methods) & (compared["seeds"] > 0), "seeds"]
        parts.append(f"{name} {' to '.join(dict.fromkeys((f'{seeds.min():,}', f'{seeds.max():,}')))}")
    return f"seeds: {', '.join(parts)}"


def main() -> None:
    """Draw and save."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("table")
    parser.add_argument("--folder", required=True)
    arguments = parser.parse_args()
    table = pd.read_csv(arguments.table)
    with paper_style():
        save_figure(draw(table), table, arguments.folder, "samplers")


if __name__ == "__main__":
    main()
