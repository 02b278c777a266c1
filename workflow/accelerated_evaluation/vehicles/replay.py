"""The trace of one encounter, as a table and as a figure, and the lead motion with which it is simulated."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import atomic_path, write_csv
from accelerated_evaluation.base.tables import read_csv, require_file
from accelerated_evaluation.laws.motion import LONGEST, MOTIONS, STATES, STEP, draw_lead_speeds
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.scenarios.protocol import Panel, Scenario
from accelerated_evaluation.vehicles.loading import load_vehicle

if TYPE_CHECKING:
    from matplotlib.axes import Axes


FILE_COLUMNS = ("time_s", "lead_speed_m_per_s")  # as in the table that the command replay writes
DRAWN = ("constant", "ngsim")  # laws of lead motion that need no records


def lead_speeds_of(text: str, encounter: Array, generator: np.random.Generator) -> Array:
    """Return the lead speeds [m/s] of one encounter at 0, 0.1, ..., 8 s, shape (81,).

    The text is one of the names `DRAWN` of laws of lead motion; or the path of a CSV file with the columns
    ``time_s``, from 0 to 8 s or more, and ``lead_speed_m_per_s``, between which speeds are interpolated; or
    the path of a Parquet file of recorded cut-ins with speed profiles, for the law `recorded`. InputError is
    raised if there is no such law or file, or if the file has other columns, times that do not increase from
    0 to 8 s, or speeds that are negative or not finite.
    """
    if text.endswith(".csv"):
        return _read(Path(text))
    if text.endswith(".parquet"):
        motion = MOTIONS["recorded"].read(text)
    elif text in DRAWN:
        motion = MOTIONS[text]()
    else:
        raise InputError(
            "--motion",
            seen=repr(text),
            expected=f"{' or '.join(DRAWN)}, or a file that ends in .csv or .parquet",
            change="Name one of these.",
        )
    return draw_lead_speeds(motion, np.reshape(encounter, (3, 1)), generator)[0]


def _read(path: Path) -> Array:
    require_file(path, "Correct the path, or name a law of lead motion.")
    table = read_csv(path, {name: name for name in FILE_COLUMNS}).apply(pd.to_numeric, errors="coerce")
    times, speeds = (table[name].to_numpy(dtype=float) for name in FILE_COLUMNS)
    if not (times.size > 1 and times[0] == 0 and np.all(np.diff(times) > 0) and np.isfinite(times[-1])):
        raise _error(
            path,
            ", ".join(f"{time:g}" for time in times[:4]) or "no rows",
            "finite times that increase from 0",
        )
    if times[-1] < LONGEST:
        raise _error(path, f"times up to {times[-1]:g} s", f"times up to {LONGEST:g} s or more")
    if (longest := np.diff(times).max()) > LONGEST:
        raise _error(path, f"times {longest:g} s apart", f"times in seconds, at most {LONGEST:g} s apart")
    if not (np.isfinite(speeds) & (speeds >= 0)).all():
        wrong = int(np.argmin(np.isfinite(speeds) & (speeds >= 0)))
        seen = f"a lead speed of {speeds[wrong]:g} m/s at {times[wrong]:g} s"
        raise _error(path, seen, "finite speeds of 0 m/s or more")
    return np.interp(STEP * np.arange(STATES), times, speeds)


def _error(path: Path, seen: str, expected: str) -> InputError:
    change = "Correct the lead motion: its columns are time_s and lead_speed_m_per_s."
    return InputError(str(path), seen=seen, expected=expected, change=change)


HOST = "#08306b"
STYLES = {"color": HOST, "linestyle": "-"}, {"color": "#777777", "linestyle": "--"}  # of two lines
TIME, EMERGENCY = "time_s", "emergency"  # columns of a trace that are not drawn as lines


def trace_encounter(
    name: str,
    *encounter: float,
    scenario: Scenario = CUT_IN,
    lead_speeds: Array | None = None,
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
        raise InputError(
            "vehicle",
            seen=name,
            expected=f"one whose states are known: {', '.join(followed) or 'this scenario has none'}",
            change="Name one of these. Other vehicles return only the outcomes of an encounter.",
        )
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
    write_csv(table, trace)
    if figure is not None:
        each = [Panel(name, {name: name}) for name in trace if name not in (TIME, EMERGENCY)]
        _draw(trace, figure, title, panels or each)


def _draw(trace: pd.DataFrame, path: Path, title: str, panels: Sequence[Panel]) -> None:
    """Draw the panels over time, and shade emergencies."""
    import matplotlib as mpl  # slow to import, and only needed here
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5, 1.75 * len(panels)), layout="constrained", dpi=150)
    axes = figure.subplots(len(panels), sharex=True, squeeze=False)[:, 0]
    for axis, panel in zip(axes, panels, strict=True):
        _draw_panel(axis, trace, panel)
    axes[-1].set_xlabel("time [s]")
    axes[0].set_title(title, fontsize=9)
    # Without a date, and with a fixed salt, equal figures give equal files.
    dates = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}, ".png": None}
    with atomic_path(path) as temporary, mpl.rc_context({"svg.hashsalt": "accelerated-evaluation"}):
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
