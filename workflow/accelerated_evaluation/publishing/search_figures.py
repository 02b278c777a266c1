"""The Cross-Entropy search: figures 3 and 8 to 11 of the paper."""

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from accelerated_evaluation.distributions import PiecewiseMixture
from accelerated_evaluation.laws.lane_change_model import LaneChangeModel
from accelerated_evaluation.publishing.flow_chart import Arrow, Box, draw_flow_chart, flow_table
from accelerated_evaluation.publishing.style import COLUMN_WIDTH, PIECES, note_source, paper_style

PIECE_STYLES = tuple(
    {"color": color, "linestyle": line, "marker": marker}
    for color, line, marker in zip(PIECES, ("-", "--", ":"), ("o", "s", "^"), strict=True)
)
CURVES = 5  # densities in figure 11
LINES = ("--", ":", "-.", (0, (6, 1, 1, 1, 1, 1)), "-")
DENSITY_FLOOR = 1e-4  # [s], the lower end of figure 11
FLOW_HEIGHT = 5.6  # [in]


MAIN, WIDE = 1.36, 2.3  # middle and width of the main column of the flow chart [in]
FLOW_BOXES = {
    "start": Box(
        "f* starts as f, no weight below {minimum_weight:g}\n(single: exponentials with f's means)",
        *(MAIN, 5.35, WIDE, 0.36),
    ),
    "draw": Box(
        "draw N = {sample_size:,} cut-ins from f*, simulate\nthem; score t: the least of TTC and of\n"
        "R / ({range_per_ttc:g} m/s); 0 if it is a crash",
        *(MAIN, 4.74, WIDE, 0.5),
    ),
    "rarer": Box(
        "is the {event_quantile:g} quantile of t\nbelow the last $t_{{TTC}}$?",
        *(MAIN, 4.02, WIDE, 0.62),
        question=True,
    ),
    "more": Box(
        "draw on, to {minimum_events}\ncrashes or {maximum_batches} N;\n"
        "take the {minimum_events}th\nsmallest t",
        *(2.98, 3.31, 0.84, 0.56),
    ),
    "event": Box(
        "$t_{{TTC}}$ falls to it, and $t_R$ in step;\nevent: TTC hits $t_{{TTC}}$ or R hits $t_R$",
        *(MAIN, 3.31, 2.05, 0.4),
    ),
    "update": Box(
        "weigh events by f / f*; update weights,\n"
        "$\\theta$ of pieces with {minimum_piece_events} events (single: rates)",
        *(MAIN, 2.71, WIDE, 0.4),
    ),
    "full": Box(
        "heuristic: is the tail at full\nweight, with room below\nall events?",
        *(MAIN, 1.94, WIDE, 0.74),
        question=True,
    ),
    "shift": Box("shift the\ntruncation\npoints up", 3.06, 1.94, 0.62, 0.46),
    "crash": Box(
        "was the crash itself the\nevent {crash_iterations} times in a row?",
        *(MAIN, 1.08, WIDE, 0.62),
        question=True,
    ),
    "end": Box("f*", MAIN, 0.45, 0.5, 0.24),
}
FLOW_ARROWS = (
    Arrow("start", "draw"),
    Arrow("draw", "rarer"),
    Arrow("rarer", "event", answer="yes"),
    Arrow("rarer", "more", ("right", "top"), "no"),
    Arrow("more", "event", ("left", "right")),
    Arrow("event", "update"),
    Arrow("update", "full"),
    Arrow("full", "shift", ("right", "left"), "yes"),
    Arrow("full", "crash", answer="no"),
    Arrow("shift", "draw", ("right", "right"), lane=3.46),
    Arrow("crash", "draw", ("left", "left"), "no", lane=0.04),
    Arrow("crash", "end", answer="yes"),
)


def flow_boxes(settings: Mapping[str, Any]) -> dict[str, Box]:
    """Describe the steps of `sampling.cross_entropy.search` with the settings that it runs with."""
    return {name: replace(box, text=box.text.format(**settings)) for name, box in FLOW_BOXES.items()}


def fig03_cross_entropy_flow(settings: Mapping[str, Any], source: str) -> tuple[Figure, pd.DataFrame]:
    """Draw how our search iterates (paper, figure 3).

    Parameters
    ----------
    settings
        Section ``cross_entropy`` of the configuration.
    source
        Description of the data that the settings are for.

    Returns
    -------
    figure, data
        The flow chart, and its boxes and arrows as `flow_chart.flow_table` has them.
    """
    boxes = flow_boxes(settings)
    with paper_style():
        figure, axes = plt.subplots(figsize=(COLUMN_WIDTH, FLOW_HEIGHT))
        axes.set(xlim=(0, COLUMN_WIDTH), ylim=(0.3, FLOW_HEIGHT))
        draw_flow_chart(axes, boxes, FLOW_ARROWS)
        note_source(figure, f"none; settings of the study of {source}")
    return figure, flow_table(boxes, FLOW_ARROWS)


def fig08_thresholds(trace: pd.DataFrame, segment: str, source: str) -> tuple[Figure, pd.DataFrame]:
    """Draw the thresholds of the relaxed events through the iterations (paper, figure 8).

    Parameters
    ----------
    trace
        ``cross_entropy_trace.csv`` of a study.
    segment
        The segment whose piecewise searches are drawn, the first seed's in front.
    source
        Description of the data.

    Returns
    -------
    figure, data
        The thresholds, t_R on the right scale; seed, iteration, threshold_ttc_s, threshold_range_m, events.
    """
    rows = _piecewise(trace, segment)
    ratio = (rows["threshold_range_m"] / rows["threshold_ttc_s"]).max()
    with paper_style():
        figure, axes = plt.subplots()
        for rank, (seed, search) in enumerate(rows.groupby("seed")):
            style = PIECE_STYLES[0] | _depth(rank, f"seed {seed}", "other seeds")
            axes.plot(search["iteration"], search["threshold_ttc_s"], **style)
        _mark_crash(axes, rows[rows["seed"] == rows["seed"].min()])
        _count_iterations(axes, rows, segment)
        axes.set_ylabel("threshold $t_{TTC}$ [s]")
        right = axes.secondary_yaxis("right", functions=(lambda t: t * ratio, lambda r: r / ratio))
        right.set_ylabel("threshold $t_R$ [m]")
        right.spines["right"].set_visible(True)
        axes.legend()
        note_source(figure, source)
    columns = ["seed", "iteration", "threshold_ttc_s", "threshold_range_m", "events"]
    return figure, rows[columns].reset_index(drop=True)


def _mark_crash(axes: Axes, search: pd.DataFrame) -> None:
    """Point at the first iteration whose event is the crash itself."""
    crash = search[search["threshold_ttc_s"] == 0]
    if len(crash):
        at = crash["iteration"].iloc[0], 0
        arrow = {"arrowstyle": "->", "linewidth": 0.6}
        axes.annotate(
            "the crash", at, (0, 22), textcoords="offset points", ha="center", fontsize=7, arrowprops=arrow
        )


def fig09_inverse_range_parameters(
    trace: pd.DataFrame, segment: str, source: str
) -> tuple[Figure, pd.DataFrame]:
    """Draw weight and tilt of each piece of R^-1 through the iterations (paper, figure 9).

    Parameters are as of `fig08_thresholds`.

    Returns
    -------
    figure, data
        The parameters; seed, iteration, piece, from_per_m, weight and theta_m.
    """
    return _parameters(trace, segment, "inverse_range", source)


def fig10_inverse_ttc_parameters(
    trace: pd.DataFrame, segment: str, source: str
) -> tuple[Figure, pd.DataFrame]:
    """Draw weight and tilt of each piece of TTC^-1 through the iterations (paper, figure 10).

    As `fig09_inverse_range_parameters`, in from_per_s and theta_s.
    """
    return _parameters(trace, segment, "inverse_ttc", source)


def _parameters(trace: pd.DataFrame, segment: str, variable: str, source: str) -> tuple[Figure, pd.DataFrame]:
    symbol, unit = {"inverse_range": ("$R^{-1}$", "m"), "inverse_ttc": ("$TTC^{-1}$", "s")}[variable]
    table = _piece_table(_piecewise(trace, segment), variable)
    with paper_style():
        figure, (upper, lower) = plt.subplots(2, 1, figsize=(COLUMN_WIDTH, 3.6), sharex=True)
        seeds = sorted(table["seed"].unique())
        for (piece, seed), rows in table.groupby(["piece", "seed"]):
            label = f"{symbol} from {rows['from'].iloc[0]:.3g} 1/{unit}"
            style = PIECE_STYLES[piece - 1] | _depth(seeds.index(seed), label)
            upper.plot(rows["iteration"], rows["weight"], **style)
            lower.plot(rows["iteration"], rows["theta"], **style)
        upper.set(ylabel=r"weight $\tilde{\pi}$", yscale="log")
        lower.set(ylabel=rf"tilt $\theta$ [{unit}]")
        _count_iterations(lower, table, segment)
        figure.legend(*upper.get_legend_handles_labels(), loc="outside upper center", ncols=2)
        note_source(figure, source)
    return figure, table.rename(columns={"from": f"from_per_{unit}", "theta": f"theta_{unit}"})


def _piece_table(rows: pd.DataFrame, variable: str) -> pd.DataFrame:
    """Return weight, theta and lower bound by seed, iteration and piece."""
    names = [f"{variable}_{name}_" for name in ("from", "weight", "theta")]
    table = pd.wide_to_long(rows, names, i=["seed", "iteration"], j="piece")[names]
    table.columns = ["from", "weight", "theta"]
    return table.dropna().reset_index().sort_values(["seed", "iteration", "piece"], ignore_index=True)


def fig11_inverse_ttc_density(
    trace: pd.DataFrame, model: LaneChangeModel, segment: str, source: str
) -> tuple[Figure, pd.DataFrame]:
    """Draw how the density of TTC^-1 moves from f to f* in the first seed's search (paper, figure 11).

    Parameters
    ----------
    trace
        ``cross_entropy_trace.csv`` of a study.
    model
        The piecewise model that was searched; the iterations' densities are rebuilt from its pieces.
    segment
        Segment of v_L.
    source
        Description of the data.

    Returns
    -------
    figure, data
        The densities, light to dark; iteration, inverse_ttc_per_s, density_s.
    """
    table = _density_table(_piecewise(trace, segment), model.inverse_ttc[segment])
    chosen = table["iteration"].unique()
    names = {1: "f (iteration 1)", chosen[-1]: f"f* (iteration {chosen[-1]})"}
    with paper_style():
        figure, axes = plt.subplots()
        for place, (at, rows) in enumerate(table.groupby("iteration")):
            look = {
                "color": plt.get_cmap("Blues")(0.4 + 0.6 * place / (chosen.size - 1)),
                "linestyle": LINES[place],
            }
            axes.plot(
                rows["inverse_ttc_per_s"], rows["density_s"], label=names.get(at, f"iteration {at}"), **look
            )
        axes.set(xlabel=f"$TTC^{{-1}}$ [1/s], {_speeds(segment)}", ylabel="density [s]", yscale="log")
        axes.set_ylim(DENSITY_FLOOR, 3 * table["density_s"].max())
        axes.legend(loc="upper right")
        note_source(figure, source)
    return figure, table


def _density_table(rows: pd.DataFrame, pieces: PiecewiseMixture) -> pd.DataFrame:
    """Tabulate the densities of the first seed's search at iterations chosen from f to f*."""
    search = rows[rows["seed"] == rows["seed"].min()].set_index("iteration")
    chosen = np.unique(np.geomspace(1, search.index.max(), CURVES).round().astype(int)).tolist()
    laws = {1: pieces} | {at: _rebuilt(pieces, search.loc[at]) for at in chosen[1:]}
    bounds = [pieces.lower, *pieces.knots, laws[chosen[-1]].isf(0.02)]
    # Points on both sides of every knot, so that jumps are drawn as such.
    x = np.concatenate([np.linspace(low, np.nextafter(high, low), 200) for low, high in pairwise(bounds)])
    columns = ("iteration", "inverse_ttc_per_s", "density_s")
    parts = [dict(zip(columns, (at, x, np.exp(law.logpdf(x))), strict=True)) for at, law in laws.items()]
    return pd.concat(map(pd.DataFrame, parts), ignore_index=True)


def _rebuilt(pieces: PiecewiseMixture, row: pd.Series) -> PiecewiseMixture:
    """Return the f* of TTC^-1 whose parameters stand in a row of the trace."""
    numbers = range(1, len(pieces.components) + 1)
    thetas, weights = ([row[f"inverse_ttc_{name}_{n}"] for n in numbers] for name in ("theta", "weight"))
    return pieces.accelerated(thetas, weights)


def _piecewise(trace: pd.DataFrame, segment: str) -> pd.DataFrame:
    return trace[(trace["method"] == "piecewise") & (trace["segment"] == segment)]


def _depth(rank: int, label: str, others: str = "") -> dict[str, Any]:
    """Style of the first search, in front, or of another, behind it; the second names all others."""
    if rank == 0:
        return {"label": label, "zorder": 3}
    return {"label": others if rank == 1 else None, "alpha": 0.35, "linewidth": 0.6, "marker": None}


def _count_iterations(axes: Axes, rows: pd.DataFrame, segment: str) -> None:
    """Let the axis of figures 8 to 10 run from iteration 1, the start, in whole numbers."""
    axes.set(xlabel=f"iteration, {_speeds(segment)}", xlim=(0.7, rows["iteration"].max() + 0.3))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))


def _speeds(segment: str) -> str:
    return f"$v_L$ {segment.replace('-', '–')} m/s"
