"""The trace of one encounter, as a table and as a figure."""

from pathlib import Path

import numpy as np
import pandas as pd

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import atomic_path, write_csv
from accelerated_evaluation.vehicles.loading import load_vehicle
from accelerated_evaluation.vehicles.registry import VEHICLES


def trace_encounter(name: str, lead_speed: float, range_: float, closing_speed: float) -> pd.DataFrame:
    """Return the trace of one encounter with a built-in vehicle.

    Parameters
    ----------
    name
        The vehicle's name.
    lead_speed, range_, closing_speed
        Lead speed [m/s], range [m] and closing speed [m/s].

    Returns
    -------
    pandas.DataFrame
        One row for each state; see `traces` for the columns. The smallest range, the smallest time to
        collision and the last closing speed are exactly the outcomes of `simulate`. If the vehicle simulates
        lateral motion, only states in the same lane count.

    Raises
    ------
    InputError
        If the vehicle cannot be traced, or the encounter is not valid.
    """
    vehicle = load_vehicle(name)
    if not hasattr(vehicle, "trace"):
        followed = [each for each in VEHICLES if hasattr(VEHICLES[each], "trace")]
        raise InputError(
            "vehicle",
            seen=name,
            expected=f"one whose states are known: {', '.join(followed)}",
            change="Name one of these; of other vehicles only the outcomes are known.",
        )
    return vehicle.trace(lead_speed, range_, closing_speed)


def write_trace(trace: pd.DataFrame, table: Path, figure: Path | None, title: str) -> None:
    """Write a trace as CSV, and as a figure whose format follows from the file name.

    Parameters
    ----------
    trace
        The states of one encounter.
    table, figure
        The files to write; no figure if it is None.
    title
        The title of the figure.
    """
    if figure is not None and figure.suffix not in (".png", ".pdf", ".svg"):
        change = "Name the figure so."
        raise InputError(str(figure), seen=repr(figure.suffix), expected=".png, .pdf or .svg", change=change)
    write_csv(table, trace)
    if figure is not None:
        _draw(trace, figure, title)


def _draw(trace: pd.DataFrame, path: Path, title: str) -> None:
    """Draw speeds, acceleration, range and time to collision over time; emergencies are shaded."""
    import matplotlib as mpl  # slow to import, and only needed here
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5, 7), layout="constrained", dpi=150)
    axes = figure.subplots(4, sharex=True)
    time = trace["time_s"]
    axes[0].plot(time, trace["host_speed_m_per_s"], color="#08306b", label="host")
    axes[0].plot(time, trace["lead_speed_m_per_s"], color="#777777", linestyle="--", label="lead vehicle")
    axes[0].legend(frameon=False)
    for axis, column, label in (
        (axes[0], None, "speed [m/s]"),
        (axes[1], "host_acceleration_m_per_s2", "acceleration [m/s²]"),
        (axes[2], "range_m", "range [m]"),
        (axes[3], "time_to_collision_s", "time to collision [s]"),
    ):
        if column:
            axis.plot(time, trace[column].replace(np.inf, np.nan), color="#08306b", marker=".", markersize=3)
        axis.set_ylabel(label)
        axis.fill_between(
            time,
            0,
            1,
            where=trace["emergency"] == 1,
            transform=axis.get_xaxis_transform(),
            color="#b2182b",
            alpha=0.15,
            linewidth=0,
        )
    axes[2].axhline(0, color="black", linewidth=0.6)
    axes[3].set_ylim(0, 10)
    axes[3].set_xlabel("time [s]")
    axes[0].set_title(title, fontsize=9)
    # Without a date and with a fixed salt the same figure is the same file.
    dates = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}, ".png": None}
    with atomic_path(path) as temporary, mpl.rc_context({"svg.hashsalt": "accelerated-evaluation"}):
        figure.savefig(temporary, metadata=dates[path.suffix])
