"""Figure 24, beyond the paper: coverage of intervals in synthetic worlds."""

from collections.abc import Iterable

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import NullFormatter

from accelerated_evaluation.publishing.figures.dot_chart import FRAME, ROW, name_rows, spaced, write_beside
from accelerated_evaluation.publishing.figures.style import COLUMN_WIDTH, Drawn, note_source
from accelerated_evaluation.publishing.published import figure

OURS = "this project"
# Colour, marker and vertical shift of each procedure in figure 24.
PROCEDURES = {OURS: ("#08306b", "o", -0.25), "paper": ("#b2182b", "s", 0.25)}
# What the world of each kind is or does, in words, as in the table of benchmarks/worlds/README.md.
WORLDS = {
    "paper": "the paper's law",
    "exponential": "exponential tail, as fitted",
    "heavy": "heavier, generalised Pareto tail",
    "light": "tail with an upper end",
    "two kinds": "3 % of drivers nearer and faster",
    "reckless drivers": "0.2 % of drivers much faster",
    "two regions": "30 % from a more dangerous region",
    "host speed limit": "no host faster than 31 m/s",
    "bent tail": "hazard halves far in the tail",
    "local habit": "faster at lead speeds near 14 m/s",
    "few drivers": "50 cut-ins of each driver",
    "season": "last part nearer and faster",
    "some with a limit": "40 % of hosts below 27 m/s",
    "late bend": "hazard falls beyond the records",
    "steep end": "hazard doubles beyond the records",
    "fading dependence": "far tail equal at all places",
    "slow trucks": "10 % of hosts close in slowly",
    "double bend": "hazard rises, then falls",
    "gradual bend": "hazard falls gradually",
    "aggressive when near": "far tail larger at short ranges",
    "heavier in fast traffic": "far tail larger in fast traffic",
    "heavier in slow traffic": "far tail larger in slow traffic",
}


@figure
def fig24_worlds(worlds: pd.DataFrame) -> Drawn:
    """Draw coverage, width and bias of this project's procedure and of the paper's in synthetic worlds.

    A world is a law of cut-ins whose true crash probability is known. Both procedures estimate it from data
    that are drawn from the law.

    ``worlds``: the table ``worlds.csv`` of ``benchmarks/results``, a row for each kind of world and
    procedure; the kinds with ``beyond`` break an assumption of this project. The figure has panels for the
    coverage of the 80 % intervals, for their width, and for the ratio of median estimate and truth. The
    number at the right of a row is that of this project's worlds. The data are the rows of the table with
    ``group`` and ``world``, the kind in words.
    """
    group = np.where(worlds["beyond"], "break an assumption", "similar to the models")
    data = worlds.drop(columns="beyond").assign(group=group)
    data["world"] = data["kind"].map(WORLDS).fillna(data["kind"])
    rows = data[data["procedure"] == OURS]
    y = pd.Series(1.8 * spaced(rows["group"], 1.0), index=rows["kind"])
    size = (2 * COLUMN_WIDTH, FRAME + 1.1 * ROW * (y.max() + 3))
    drawn, panels = plt.subplots(1, 3, sharey=True, figsize=size)
    for procedure, (color, marker, shift) in PROCEDURES.items():
        own = data[data["procedure"] == procedure]
        at = own["kind"].map(y).to_numpy() + shift
        look = {"color": color, "marker": marker, "linestyle": "none", "markersize": 3.5}
        share = own["coverage80"]
        reach = [share - own["coverage80_low"], own["coverage80_high"] - share]
        sizes = " or ".join(map(str, sorted(own["worlds"].unique())))
        label = f"{procedure} ({sizes} worlds of each kind)"
        panels[0].errorbar(100 * share, at, xerr=100 * np.array(reach), label=label, elinewidth=0.8, **look)
        panels[1].plot(own["width80"], at, **look)
        panels[2].plot(own["median_ratio"], at, **look)
    _name_panels(panels)
    name_rows(panels[0], y.to_numpy(), rows["group"], rows["world"])
    write_beside(panels[-1], y, rows["worlds"].astype(str), "worlds")
    panels[0].set_ylim(y.max() + 1, -2.5)
    drawn.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    note_source(drawn, "synthetic worlds, as many cut-ins as recorded; bars: 95 % limits")
    return drawn, data


def _name_panels(panels: Iterable[Axes]) -> None:
    """Write the titles of the panels of figure 24, and draw the ideal value of each as a dotted line."""
    coverage, width, bias = panels
    coverage.set_title("(a) coverage", loc="left")
    coverage.set(xlim=(-3, 103), xlabel="80 % intervals [%]")
    coverage.axvline(80, color="black", linewidth=0.6, linestyle=":")
    width.set_title("(b) width", loc="left")
    width.set_xlabel("upper / lower limit")
    bias.set_title("(c) bias", loc="left")
    bias.set_xlabel("median estimate / truth")
    bias.axvline(1, color="black", linewidth=0.6, linestyle=":")
    for axes, ticks in ((width, (2, 10, 50, 250)), (bias, (0.3, 1, 3, 10))):
        axes.set_xscale("log")
        axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
        axes.xaxis.set_minor_formatter(NullFormatter())
