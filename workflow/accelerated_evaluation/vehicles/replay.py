"""The trace of one encounter, as a table and as a figure."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.drawing import own_settings
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import atomic_path, write_csv
from accelerated_evaluation.scenarios.protocol import Panel, Scenario
from accelerated_evaluation.vehicles.loading import load_vehicle

if TYPE_CHECKING:
    from matplotlib.axes import Axes

HOST = "#08306b"
# Styles of two lines.
STYLES: Sequence[dict] = {"color": HOST, "linestyle": "-"}, {"color": "#777777", "linestyle": "--"}
TIME, EMERGENCY = "time_s", "emergency"  # columns of a trace that are not drawn as lines


def trace_encounter(
    name: str, *encounter: float, scenario: Scenario, lead_speeds: Array | None = None
) -> pd.DataFrame:
    """Simulate one encounter with a built-in vehicle, and return the states over time (the trace).

    The columns for a cut-in are listed in `traces.COLUMNS`. The smallest range, the smallest time to
    collision and the last closing speed are exactly the outcomes of `simulate`. If the vehicle simulates
    lateral motion, this is true of the states in which the cars are in the same lane. InputError is raised if
    the vehicle cannot be traced, or the encounter is not valid.
    """
    vehicle = load_vehicle(name, scenario)
    if not hasattr(vehicle, "trace"):
        known = scenario.vehicles
        followed = [each for each in known if hasattr(known[each], "trace")]
        expected = f"one whose states are known: {', '.join(followed)}"
        change = "Name one of these. Other vehicles return only the outcomes of an encounter."
        if not followed:
            expected = f"a vehicle with a method `trace`, which none of the scenario {scenario.name} has"
            change = (
                "Use `simulate` to see the outcomes, or give your vehicle a trace (docs/your_scenario.md)."
            )
        raise InputError("vehicle", seen=name, expected=expected, change=change)
    return vehicle.trace(*encounter) if lead_speeds is None else vehicle.trace(*encounter, lead_speeds)


def write_trace(
    trace: pd.DataFrame, table: Path, figure: Path | None, title: str, panels: Sequence[Panel] = ()
) -> None:
    """Write a trace as CSV and, with ``figure``, as a figure whose format follows from the file name.

    By default there is a panel for every column. InputError is raised if the name does not end in .png, .pdf
    or .svg.
    """
    if figure is not None and figure.suffix not in (".png", ".pdf", ".svg"):
        change = "Choose one of these formats."
        raise InputError(str(figure), seen=repr(figure.suffix), expected=".png, .pdf or .svg", change=change)
    with atomic_path(table) as temporary:  # a figure that cannot be written leaves no table either
        write_csv(temporary, trace)
        if figure is not None:
            each = [Panel(name, {name: name}) for name in trace if name not in (TIME, EMERGENCY)]
            with own_settings({"svg.hashsalt": "accelerated-evaluation"}):  # equal figures give equal files
                _draw(trace, figure, title, panels or each)


def _draw(trace: pd.DataFrame, path: Path, title: str, panels: Sequence[Panel]) -> None:
    """Draw the panels over time, and shade emergencies."""
    from matplotlib.figure import Figure  # slow to import, and only needed here

    figure = Figure(figsize=(5, 1.75 * len(panels)), layout="constrained", dpi=150)
    axes = figure.subplots(len(panels), sharex=True, squeeze=False)[:, 0]
    for axis, panel in zip(axes, panels, strict=True):
        _draw_panel(axis, trace, panel)
    axes[-1].set_xlabel("time [s]")
    axes[0].set_title(title, fontsize=9)
    # Equal figures give equal files only without a date.
    dates = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}, ".png": None}
    with atomic_path(path) as temporary:
        figure.savefig(temporary, metadata=dates[path.suffix])


def _draw_panel(axis: "Axes", trace: pd.DataFrame, panel: Panel) -> None:
    """Draw the lines of a panel: a single line with its points, or two lines with a legend."""
    time = trace[TIME]
    if len(panel.lines) == 1:
        (column,) = panel.lines
        axis.plot(time, trace[column].replace(np.inf, np.nan), color=HOST, marker=".", markersize=3)
    else:
        for (column, label), style in zip(panel.lines.items(), STYLES, strict=True):
            axis.plot(time, trace[column], label=label, **style)
        axis.legend(frameon=False)
    axis.set_ylabel(panel.label)
    if EMERGENCY in trace:
        axis.fill_between(
            time,
            0,
            1,
            where=trace[EMERGENCY] == 1,
            transform=axis.get_xaxis_transform(),
            color="#b2182b",
            alpha=0.15,
            linewidth=0,
        )
    if panel.zero:
        axis.axhline(0, color="black", linewidth=0.6)
    if panel.limits is not None:
        axis.set_ylim(panel.limits)
