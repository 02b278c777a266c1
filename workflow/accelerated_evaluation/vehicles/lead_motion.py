"""The lead motion of a single encounter, which is drawn from a named law or read from a file."""

from pathlib import Path

import numpy as np

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.tables import column_of_numbers, read_csv, require_file
from accelerated_evaluation.laws.motion import LONGEST, MOTIONS, STATES, STEP, draw_lead_speeds
from accelerated_evaluation.laws.motion.recorded import FASTEST_CHANGE, is_jump

FILE_COLUMNS = ("time_s", "lead_speed_m_per_s")  # as in the table that the command replay writes
DRAWN = ("constant", "ngsim")  # laws of lead motion that need no records


def lead_speeds_of(text: str, encounter: Array, generator: np.random.Generator) -> Array:
    """Return the lead speeds [m/s] of one encounter at 0, 0.1, ..., 8 s, shape (81,).

    Parameters
    ----------
    text
        One of the names `DRAWN` of laws of lead motion; or the path of a CSV file with the columns
        ``time_s``, from 0 to 8 s or more, and ``lead_speed_m_per_s``, between which speeds are interpolated;
        or the path of a Parquet file of recorded cut-ins with speed profiles, for the law `recorded`.
    encounter
        Lead speed [m/s], range [m] and closing speed [m/s], shape (3,).
    generator
        Random generator, if the motion is drawn.

    Raises
    ------
    InputError
        If there is no such law or file, or if the file has other columns, times that do not increase from 0
        to 8 s, or speeds that are negative, not finite, or change faster than those of a car.
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
    table = read_csv(path, {name: name for name in FILE_COLUMNS})

    def place(row: int) -> str:
        return f"{path}, row {row + 2}"

    times, speeds = (
        column_of_numbers(table[name], place, "Correct this cell.").to_numpy() for name in FILE_COLUMNS
    )
    if not (times.size > 1 and times[0] == 0 and np.all(np.diff(times) > 0)):
        raise _error(
            path,
            ", ".join(f"{time:g}" for time in times[:4]) or "no rows",
            "times that increase from 0",
        )
    if times[-1] < LONGEST:
        raise _error(path, f"times up to {times[-1]:g} s", f"times up to {LONGEST:g} s or more")
    if (longest := np.diff(times).max()) > LONGEST:
        raise _error(path, f"times {longest:g} s apart", f"times in seconds, at most {LONGEST:g} s apart")
    if (speeds < 0).any():
        wrong = int(np.argmax(speeds < 0))
        seen = f"a lead speed of {speeds[wrong]:g} m/s at {times[wrong]:g} s"
        raise _error(path, seen, "speeds of 0 m/s or more")
    if (jumps := is_jump(speeds[None], times)[0]).any():
        k = int(jumps.argmax())
        seen = f"{speeds[k]:g} m/s at {times[k]:g} s and {speeds[k + 1]:g} m/s at {times[k + 1]:g} s"
        raise _error(path, seen, f"speeds in m/s that change by at most {FASTEST_CHANGE:g} m/s²")
    return np.interp(STEP * np.arange(STATES), times, speeds)


def _error(path: Path, seen: str, expected: str) -> InputError:
    change = "Correct the lead motion: its columns are time_s and lead_speed_m_per_s."
    return InputError(str(path), seen=seen, expected=expected, change=change)
