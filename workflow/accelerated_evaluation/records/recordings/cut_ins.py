"""The definition of a cut-in, and the account and exposure that an extraction returns with the cut-ins."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.sections import number, section
from accelerated_evaluation.records.ingest import Account

RULE = section(  # the section ``rule`` of each source that finds cut-ins in recordings
    gap=number(
        0.5,
        0,
        10,
        "Longest time [s] without detection after which a vehicle is still taken to be the same.",
        exclusive=True,
    ),
    absence=number(
        1, 0, 60, "Longest time [s] outside the lane of the host that does not count as leaving it."
    ),
    stay=number(0.5, 0, 60, "Shortest time [s] in the lane of the host that counts as a cut-in."),
)
AGREEMENT = 1.25  # factor by which speeds may differ from changes of position, or from other recorded speeds
# Limits of the median length [m] of the vehicles of a class. Cars have about 15 feet; trucks are 2.5 m wide.
LENGTHS = {"car": (2.5, 8.0), "truck": (4.0, 30.0)}
TRACKING = "tracking"  # step of the account with rows that repeat the number and the time of another row
EXCERPT = 1000  # so few rows may be an excerpt, in which no host has two frames
MANY_REPEATED = 0.01  # share of these rows that causes a warning
LONGEST = 30.0  # [m]: limit of the median length of vehicles, as the longest lorries have 25 m

# The frames of a vehicle in a lane are joined to stays. A short absence from the lane does not end a stay. A
# stay is a change into the lane if the vehicle was recorded outside of the lane before the first frame of the
# stay.
STAYS = """
    SELECT *, sum(begins) OVER (PARTITION BY {vehicle}, {lane} ORDER BY time) AS stay
    FROM (
        SELECT *, CASE WHEN time - lag(time) OVER (PARTITION BY {vehicle}, {lane} ORDER BY time) <= {absence}
            THEN 0 ELSE 1 END AS begins
        FROM {frames}
    )
"""
TRACK = """
    max(CASE WHEN time - before <= {gap} THEN NULL ELSE time END)
        OVER (PARTITION BY {vehicle} ORDER BY time ROWS UNBOUNDED PRECEDING)
"""


def stays_sql(frames: str, *, vehicle: str, lane: str, rule: Mapping[str, float]) -> str:
    """Return the SQL query that numbers the stays of each vehicle in each lane.

    A stay is a sequence of frames of a vehicle in a lane in which no two consecutive frames are farther apart
    than the larger of ``absence`` and ``gap``. The ``frames`` have a row for each frame that a vehicle spends
    in a lane; the column ``time`` is in whole milliseconds. ``vehicle`` and ``lane`` are names of columns,
    separated by commas, and ``rule`` has ``absence`` and ``gap`` in seconds. The query returns the frames
    with ``begins`` (1 in the first frame of a stay, otherwise 0) and the number ``stay``.
    """
    absence = milliseconds(max(rule["absence"], rule["gap"]))
    return STAYS.format(frames=frames, vehicle=vehicle, lane=lane, absence=absence)


def track_sql(*, vehicle: str, rule: Mapping[str, float]) -> str:
    """Return the SQL expression of the time [ms] at which the track of each row begins.

    A track is a sequence of rows of one ``vehicle`` (names of columns, separated by commas), in which no two
    consecutive rows are farther apart than ``gap`` of the ``rule`` [s]. After a longer gap, the number may
    belong to another vehicle. The rows have ``time`` and ``before``, the time of the previous row [ms].
    """
    return TRACK.format(vehicle=vehicle, gap=milliseconds(rule["gap"]))


def milliseconds(seconds: float) -> int:
    """Convert seconds to whole milliseconds, so that comparisons of times are exact."""
    return round(1000 * seconds)


def drop_in_turn(
    candidates: pd.DataFrame, reasons: Mapping[tuple[str, str], str], account: Account
) -> pd.DataFrame:
    """Drop the candidates that are not cut-ins, each for the first reason that applies to it.

    ``reasons`` maps step and reason to the boolean column that selects the rows to drop.
    """
    for (step, reason), column in reasons.items():
        candidates = account.take(candidates, candidates[column].astype(bool), step=step, reason=reason)
    return candidates


def with_names(candidates: pd.DataFrame, name: str) -> pd.DataFrame:
    """Convert the times [ms] of the candidates to seconds, and use names for the account as their index.

    The format of the name has columns in braces, such as ``"trip {trip} at {time:g} s"``.
    """
    candidates = candidates.assign(time=candidates["time"] / 1000)
    names = [name.format_map(row) for row in candidates.to_dict("records")]
    return candidates.set_index(pd.Index(names, dtype=object))


def finished(
    cut_ins: pd.DataFrame, account: Account, counts: Mapping[str, float], warnings: Sequence[str], where: str
) -> pd.DataFrame:
    """Return the cut-ins in the form of a source, with rows numbered from 1.

    The attributes (``attrs``) are ``account``; ``exposure``, with the ``hours`` and ``kilometres`` that the
    hosts drove while cut-ins could be observed, from the counts of milliseconds and micrometres; and
    ``warnings``, texts about units that could not be checked or nearly disagree, about many rows that were
    left out, and about recordings without a cut-in. InputError, which names the folder ``where``, is raised
    if no host was recorded twice within the rule of gaps, because no change of lane can then be seen.
    """
    lines = account.table().to_dict("records")
    read = lines[0]["rows_in"]
    if not counts["milliseconds"] > 0 and read > EXCERPT:
        raise InputError(
            where,
            seen="no host with two frames that are at most rule.gap apart",
            expected="the frames of each vehicle in succession, and hosts in the recordings",
            change="Correct the numbers or the unit of frames or times, or the numbers of the vehicles.",
        )
    result = cut_ins.set_index(pd.RangeIndex(1, len(cut_ins) + 1, name="row"))
    result.attrs["account"] = lines
    result.attrs["exposure"] = {
        "hours": int(counts["milliseconds"]) / 3.6e6,
        "kilometres": int(counts["micrometres"]) / 1e9,
    }
    repeated = sum(each["rows_dropped"] for each in lines if each["step"] == TRACKING)
    result.attrs["warnings"] = list(warnings)
    if cut_ins.empty:
        result.attrs["warnings"].append(f"no row is a cut-in; rows left out: {account.summary()}")
    if repeated > MANY_REPEATED * read:
        result.attrs["warnings"].append(
            f"{repeated:,} of {read:,} rows of the recordings have the number and the time of another row, "
            "and were left out; numbers may belong to several vehicles or recordings"
        )
    return result


def require_agreement(
    where: str, ratio: float, *, what: str, key: str, factor: float = AGREEMENT
) -> list[str]:
    """Raise InputError if speeds contradict another recorded quantity, because of a wrong unit or sign.

    The ``ratio`` of two quantities, such as distances from positions and from speeds, is 1, except for noise,
    if the units are right. InputError is raised if it is below ``1 / factor`` or above ``factor``. The
    default detects mph in place of km/h, knots in place of m/s, feet in place of metres and a wrong sign. A
    warning is returned if the ratio differs from 1 by more than a quarter of this, as for yards in place of
    metres. Nothing is checked if the ratio is NaN, which means that it is unknown.
    """
    if not (np.isnan(ratio) or 1 / factor <= ratio <= factor):
        raise InputError(
            where,
            seen=f"{what} in the ratio {ratio:.3g}",
            expected="a ratio near 1, because both have the same unit and sign",
            change=f"Correct {key}.",
        )
    near = 1 + (factor - 1) / 4
    if np.isnan(ratio) or 1 / near <= ratio <= near:
        return []
    return [f"{what} are in the ratio {ratio:.3g}, though it should be 1; check {key}"]


def require_lengths(where: str, column: str, lengths: pd.Series, kind: pd.Series) -> None:
    """Check that lengths of vehicles are positive and in metres, because ranges are computed from them.

    ``kind`` is the class of each vehicle in lower case. InputError is raised if a length is not above 0, if
    the median length of a class is outside of `LENGTHS`, or if that of all vehicles is above `LONGEST`.
    """
    medians = lengths.groupby(kind).median()
    seen = ""
    if (lengths <= 0).any():
        seen = (
            f"{(lengths <= 0).sum():,} vehicles with a length of 0 or less, the smallest {lengths.min():g} m"
        )
    elif outside := [one for one, (low, high) in LENGTHS.items() if not low <= medians.get(one, low) <= high]:
        seen = " and ".join(f"a median length of {one}s of {medians[one]:.3g} m" for one in outside)
    elif len(lengths) and lengths.median() > LONGEST:
        seen = f"a median length of vehicles of {lengths.median():.3g} m"
    if seen:
        raise InputError(
            f"{where}, {column}",
            seen=seen,
            expected="lengths above 0 m, "
            + " and ".join(
                f"those of {kind}s from {low:g} to {high:g} m" for kind, (low, high) in LENGTHS.items()
            ),
            change="Correct the column. Its unit (feet instead of metres) or its sign may be wrong, or it "
            "may contain widths.",
        )
