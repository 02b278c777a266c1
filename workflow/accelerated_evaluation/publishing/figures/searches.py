"""The Cross-Entropy search: figures 8 to 11 of the paper."""

import math
from itertools import pairwise
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from accelerated_evaluation.laws.distributions import PiecewiseMixture
from accelerated_evaluation.laws.paper.models import IndependentLaw
from accelerated_evaluation.publishing.figures.style import COLUMN_WIDTH, PIECES, Drawn
from accelerated_evaluation.publishing.published import figure

PIECE_STYLES = tuple(
    {"color": color, "linestyle": line, "marker": marker}
    for color, line, marker in zip(PIECES, ("-", "--", ":"), ("o", "s", "^"), strict=True)
)
# Marks an iteration in which the tilt was not updated.
OPEN = {"linestyle": "none", "markerfacecolor": "white", "label": None, "zorder": 4}
CURVES = 5  # number of densities in figure 11
LINES = ("--", ":", "-.", (0, (6, 1, 1, 1, 1, 1)), "-")
DENSITY_FLOOR = 1e-4  # [s], smallest density that figure 11 shows


@figure
def fig08_thresholds(trace: pd.DataFrame, segment: str) -> Drawn:
    """Draw the thresholds of the relaxed events against the iteration of the search (paper, figure 8).

    A relaxed event is a time to collision or a range below a threshold. The search lowers the thresholds
    until the event is the crash.

    The figure shows the threshold of TTC. That of the range, t_R, is a multiple of it, which is in the label.
    The columns of the data are seed, iteration, threshold_ttc_s, threshold_range_m and events.
    """
    rows = _piecewise(trace, segment)
    ratio = (rows["threshold_range_m"] / rows["threshold_ttc_s"]).max()
    drawn, axes = plt.subplots()
    for rank, (seed, search) in enumerate(rows.groupby("seed")):
        style = PIECE_STYLES[0] | _depth(rank, f"seed {seed}", "other seeds")
        axes.plot(search["iteration"], search["threshold_ttc_s"], **style)
    _mark_crash(axes, rows[rows["seed"] == rows["seed"].min()])
    _count_iterations(axes, rows, segment)
    axes.set_ylabel("threshold $t_{TTC}$ [s]")
    same = f"$t_R$ = {ratio:.2g} m/s $\\times$ $t_{{TTC}}$"
    axes.legend(title=same if ratio > 0 else None)  # 0 if the crash was the event in all iterations
    columns = ["seed", "iteration", "threshold_ttc_s", "threshold_range_m", "events"]
    return drawn, rows[columns].reset_index(drop=True)


def _mark_crash(axes: Axes, search: pd.DataFrame) -> None:
    """Mark the first iteration whose event is the crash itself with an arrow."""
    crash = search[search["threshold_ttc_s"] == 0]
    if len(crash):
        at = crash["iteration"].iloc[0], 0
        arrow = {"arrowstyle": "->", "linewidth": 0.6}
        axes.annotate(
            "the crash", at, (0, 22), textcoords="offset points", ha="center", fontsize=7, arrowprops=arrow
        )


@figure
def fig09_inverse_range_parameters(trace: pd.DataFrame, segment: str) -> Drawn:
    """Draw weight and tilt of each piece of R^-1 against the iteration of the search (paper, figure 9).

    The tilt theta of a piece multiplies its density at x by exp(theta x), up to a constant.

    The figure shows the weights above the tilts of each piece, with open markers where a tilt was not
    updated. The columns of the data are seed, iteration, piece, from_per_m, weight and theta_m.
    """
    return _parameters(trace, segment, "inverse_range")


@figure
def fig10_inverse_ttc_parameters(trace: pd.DataFrame, segment: str) -> Drawn:
    """Draw weight and tilt of each piece of TTC^-1 against the iteration of the search (paper, figure 10).

    The tilt theta of a piece multiplies its density at x by exp(theta x), up to a constant.

    The figure shows the weights above the tilts of each piece, with open markers where a tilt was not
    updated. The columns of the data are seed, iteration, piece, from_per_s, weight and theta_s.
    """
    return _parameters(trace, segment, "inverse_ttc")


def _parameters(trace: pd.DataFrame, segment: str, variable: str) -> Drawn:
    """Draw the weights of all pieces in one panel, and the tilt of each piece in a panel of its own."""
    symbol, unit = {"inverse_range": ("R", "m"), "inverse_ttc": ("TTC", "s")}[variable]
    table = _piece_table(_piecewise(trace, segment), variable)
    seeds = sorted(table["seed"].unique())
    starts = table.groupby("piece")["from"].first()
    names = dict(zip(starts.index, _piece_names(starts.tolist(), symbol, unit), strict=True))
    size = (COLUMN_WIDTH, 2.2 + 1.1 * len(names))
    drawn, (upper, *lowers) = plt.subplots(1 + len(names), 1, figsize=size, sharex=True)
    for (piece, seed), rows in table.groupby(["piece", "seed"]):
        lower = lowers[piece - 1]
        style = PIECE_STYLES[piece - 1] | _depth(seeds.index(seed), names[piece])
        upper.plot(rows["iteration"], rows["weight"], **style)
        lower.plot(rows["iteration"], rows["theta"], **style)
        kept = rows[rows["theta"] == rows["theta"].shift()]
        if seed == seeds[0]:
            lower.plot(kept["iteration"], kept["theta"], **style | OPEN)
    upper.set_title("(a) weights of all pieces", loc="left")
    upper.set(ylabel=r"weight $\tilde{\pi}$", yscale="log")
    for letter, lower, (piece, name) in zip("bcdef", lowers, names.items(), strict=False):
        lower.set_title(f"({letter}) tilt for {name}", loc="left")
        lower.set_ylabel(rf"tilt $\theta$ [{unit}]")
        if not table.loc[(table["piece"] == piece) & (table["seed"] == seeds[0]), "theta"].any():
            say = {"transform": lower.transAxes, "ha": "right", "va": "top", "fontsize": 7}
            lower.text(1, 1, f"seed {seeds[0]}: too few events for an update", **say)
    _count_iterations(lowers[-1], table, segment)
    drawn.legend(*upper.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return drawn, table.rename(columns={"from": f"from_per_{unit}", "theta": f"theta_{unit}"})


def _piece_names(starts: list[float], symbol: str, unit: str) -> list[str]:
    """Name each piece of an inverse by the interval of the quantity itself, such as "R 27–75 m"."""
    ends = [*starts[1:], math.inf]
    names = []
    for start, end in zip(starts, ends, strict=True):
        low, high = 1 / end, 1 / start if start else math.inf
        words = (
            f"< {high:.3g}" if not low else f"> {low:.3g}" if math.isinf(high) else f"{low:.3g}–{high:.3g}"
        )
        names.append(f"${symbol}$ {words} {unit}")
    return names


def _piece_table(rows: pd.DataFrame, variable: str) -> pd.DataFrame:
    """Return a row for each seed, iteration and piece: its lower bound ``from``, weight and theta."""
    names = [f"{variable}_{name}_" for name in ("from", "weight", "theta")]
    table = pd.wide_to_long(rows, names, i=["seed", "iteration"], j="piece")[names]
    table.columns = ["from", "weight", "theta"]
    return table.dropna().reset_index().sort_values(["seed", "iteration", "piece"], ignore_index=True)


@figure
def fig11_inverse_ttc_density(trace: pd.DataFrame, piecewise: IndependentLaw, segment: str) -> Drawn:
    """Draw densities of TTC^-1 at some iterations of a search, from f to the final f* (paper, figure 11).

    The figure shows later iterations in darker colours. The columns of the data are iteration,
    inverse_ttc_per_s and density_s.
    """
    table = _density_table(_piecewise(trace, segment), piecewise.inverse_ttc[segment])
    chosen = table["iteration"].unique()
    names = {1: "f (iteration 1)", chosen[-1]: f"f* (iteration {chosen[-1]})"}
    drawn, axes = plt.subplots()
    for place, (at, rows) in enumerate(table.groupby("iteration")):
        look = {
            "color": plt.get_cmap("Blues")(0.4 + 0.6 * place / (chosen.size - 1)),
            "linestyle": LINES[place],
        }
        axes.plot(
            rows["inverse_ttc_per_s"], rows["density_s"], label=names.get(at, f"iteration {at}"), **look
        )
    axes.set(xlabel=f"$TTC^{{-1}}$ [1/s], {_speeds(segment)}", ylabel="density [s]", yscale="log")
    axes.set_ylim(DENSITY_FLOOR, 10 ** np.ceil(np.log10(table["density_s"].max())))
    axes.legend(loc="upper right")
    return drawn, table


def _density_table(rows: pd.DataFrame, pieces: PiecewiseMixture) -> pd.DataFrame:
    """Tabulate the densities at some iterations of the search with the smallest seed."""
    search = rows[rows["seed"] == rows["seed"].min()].set_index("iteration")
    chosen = np.unique(np.geomspace(1, search.index.max(), CURVES).round().astype(int)).tolist()
    laws = {1: pieces} | {at: _rebuilt(pieces, search.loc[at]) for at in chosen[1:]}
    bounds = [pieces.lower, *pieces.knots, laws[chosen[-1]].isf(0.02)]
    # There are points on both sides of every knot, so that jumps of the density are drawn.
    x = np.concatenate([np.linspace(low, np.nextafter(high, low), 200) for low, high in pairwise(bounds)])
    columns = ("iteration", "inverse_ttc_per_s", "density_s")
    parts = [dict(zip(columns, (at, x, np.exp(law.logpdf(x))), strict=True)) for at, law in laws.items()]
    return pd.concat(map(pd.DataFrame, parts), ignore_index=True)


def _rebuilt(pieces: PiecewiseMixture, row: pd.Series) -> PiecewiseMixture:
    """Return the f* of TTC^-1 with the parameters in a row of the trace."""
    numbers = range(1, len(pieces.components) + 1)
    thetas, weights = ([row[f"inverse_ttc_{name}_{n}"] for n in numbers] for name in ("theta", "weight"))
    return pieces.accelerated(thetas, weights)


def _piecewise(trace: pd.DataFrame, segment: str) -> pd.DataFrame:
    return trace[(trace["method"] == "piecewise") & (trace["segment"] == segment)]


def _depth(rank: int, label: str, others: str = "") -> dict[str, Any]:
    """Return the style of a search: rank 0 is drawn in front; rank 1 has the label of all others."""
    if rank == 0:
        return {"label": label, "zorder": 3}
    return {"label": others if rank == 1 else None, "alpha": 0.35, "linewidth": 0.6, "marker": None}


def _count_iterations(axes: Axes, rows: pd.DataFrame, segment: str) -> None:
    """Label the axis of the iterations, from 1, with whole numbers."""
    axes.set(xlabel=f"iteration, {_speeds(segment)}", xlim=(0.7, rows["iteration"].max() + 0.3))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))


def _speeds(segment: str) -> str:
    return f"$v_L$ {segment.replace('-', '–')} m/s"
