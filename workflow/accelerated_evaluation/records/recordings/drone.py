"""Recordings from drones in the CSV formats of highD and exiD, which are recognised by their columns."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd
from tqdm import tqdm

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.records.recordings.cut_ins import require_lengths
from accelerated_evaluation.records.recordings.database import (
    csv_errors,
    csv_relation,
    database,
    header_of,
    recording_files,
)
from accelerated_evaluation.records.recordings.own_distances import OwnColumns, compared
from accelerated_evaluation.records.recordings.trajectories import (
    changes_of_lane,
    check_speeds,
    cut_ins_of,
    frames_sql,
)

if TYPE_CHECKING:
    from duckdb import DuckDBPyConnection

TRACKS = "_tracks.csv"
FILES = "Folder with files *_tracks.csv, *_tracksMeta.csv and *_recordingMeta.csv"
RECORDING = "recordingId"
WITHOUT_META = """
    SELECT CAST(min(id) AS VARCHAR), count(*) FROM (SELECT DISTINCT id FROM frames)
    ANTI JOIN (FROM meta WHERE class <> '') USING (id)
"""
LENGTHS_OF = """
    SELECT min(f.{length}) AS length, any_value(lower(m.class)) AS kind
    FROM frames AS f JOIN meta AS m USING (id) GROUP BY id
"""
LARGEST_RATE = 1000  # frames per second, more than any traffic camera has


@dataclass(frozen=True)
class Format:
    """A format of recordings: how its files are converted to the tables of `trajectories.changes_of_lane`."""

    source: str  # name of the source in the configuration
    numbers: tuple[str, ...]  # columns of *_tracks.csv that are read as numbers
    texts: tuple[str, ...]  # columns of *_tracks.csv that are read as text
    # Columns of *_tracksMeta.csv that are read as numbers, in addition to the text ``class``.
    meta_numbers: tuple[str, ...]
    complete: str  # SQL condition that a row of ``tracks`` is used
    # SQL statement that creates this table from the views ``tracks`` and ``meta_file``, with the placeholders
    # {rate}, {own}, {complete} and {seen}; `meta` likewise.
    frames: str
    meta: str
    # SQL expressions of the range [m], by what a position means; the first is used if the distances in the
    # file do not show which is right.
    readings: Mapping[str, str]
    own: OwnColumns  # columns with distances to the vehicle ahead, which a file may lack
    same_lane: str  # SQL condition that the host is in the lane of the vehicle that cuts in
    speeds: tuple[str, str]  # for the check of the units: what is compared, and what the user has to correct
    missed: str = (
        "FALSE"  # SQL condition that a row of frames shows a change of lane which the file does not mark
    )
    # Columns that only another data set in this format has, and the reading of its positions.
    relative: tuple[frozenset[str], str] = (frozenset(), "")


def read_recordings(settings: Mapping[str, Any], form: Format) -> pd.DataFrame:
    """Return the cut-ins in a folder of recordings; one recording is processed after the other.

    The folder has files *_tracks.csv, each with its *_tracksMeta.csv and *_recordingMeta.csv. A row has
    ``lead_speed`` [m/s], ``range`` [m] from the front of the host to the rear of the vehicle, and
    ``closing_speed`` [m/s] in the first frame in the new lane; ``host_speed`` [m/s]; and ``recording``,
    ``time`` [s], ``vehicle`` and ``host``, which locate the cut-in. The attributes are described in
    `recordings.cut_ins.finished`. InputError is raised if a file is missing, has another format or cannot be
    read, if a vehicle has no row in *_tracksMeta.csv, if lengths of vehicles are impossible, if speeds
    contradict positions, or if no vehicle has one of the configured classes.
    """
    files = recording_files(settings["path"], f"*{TRACKS}", f"data.{form.source}.path")
    found, counts, warnings = [], Counter[str](), []
    with database() as (connection, _):
        for file in tqdm(files, desc="find cut-ins", unit="recording", delay=1, disable=None):
            candidates, of_file, of_own = _read_recording(connection, file, settings, form)
            found.append(candidates)
            counts.update(of_file)
            warnings += [f"{file.name}: {warning}" for warning in of_own]
    return cut_ins_of(found, counts, settings, warnings)


def _read_recording(
    connection: "DuckDBPyConnection", file: Path, settings: Mapping[str, Any], form: Format
) -> tuple[pd.DataFrame, dict[str, float], list[str]]:
    """Return the changes of lane of one recording in order of time, counts for the account, and warnings."""
    name = file.name.removesuffix(TRACKS)
    meta, recording = (file.with_name(f"{name}_{kind}Meta.csv") for kind in ("tracks", "recording"))
    header = set(header_of(file, [*form.numbers, *form.texts]))
    for other in (meta, recording):
        if not other.is_file():
            raise InputError(
                str(other),
                seen="no such file",
                expected=f"this file next to {file.name}",
                change="Add or rename it.",
            )
    rate = _frame_rate(connection, recording)
    with csv_errors(file):
        own = {form.own.ahead, form.own.gap, form.own.headway, form.own.ttc} & {*header}
        columns = dict.fromkeys([*form.numbers, *form.texts, *sorted(own | {RECORDING} & {*header})])
        csv_relation(connection, file, form.numbers, form.texts).project(", ".join(columns)).to_view("tracks")
        placeholders = {"rate": rate, "own": form.own.sql(header), "complete": form.complete}
        connection.execute(frames_sql(form.frames, settings["rule"], **placeholders))
    with csv_errors(meta):
        csv_relation(connection, meta, form.meta_numbers, ["class"]).to_view("meta_file")
        connection.execute(form.meta)
    _require_meta(connection, file, meta)
    _require_lengths(connection, file, form)
    with csv_errors(file):
        supported, warnings = compared(connection, str(file), form.readings, form.own)
        warnings += check_speeds(connection, str(file), *form.speeds)
        [(missed,)] = connection.execute(f"SELECT count(*) FROM frames WHERE {form.missed}").fetchall()
        if missed:
            warnings.append(
                f"{missed:,} changes of lane are not marked as such; use all frames of the recording"
            )
        reading = supported or _usual_reading(connection, file, header, form)
        candidates, counts = changes_of_lane(
            connection,
            settings,
            range_=form.readings[reading],
            complete=form.complete,
            same_lane=form.same_lane,
        )
        if RECORDING in header and counts["read"] - counts["incomplete"] > counts["used"]:
            _require_one_recording(connection, file)
    return candidates.assign(recording=name), counts, warnings


def _usual_reading(connection: "DuckDBPyConnection", file: Path, header: set[str], form: Format) -> str:
    """Return what positions mean in the data set of a file, which its columns and classes show."""
    usual, (marks, of_relative) = next(iter(form.readings)), form.relative
    if marks & header:
        return of_relative
    classes = [name for (name,) in connection.execute("SELECT DISTINCT class FROM meta").fetchall()]
    if of_relative and any(classes) and all(name == name.lower() for name in classes if name):
        names = ", ".join(sorted(filter(None, classes)))
        raise InputError(
            f"{file}, column x",
            seen=f"classes in lower case ({names}), as in a data set whose x is the {of_relative}, and no "
            "distances that show whether it is",
            expected=f"the {usual}, or columns {form.own.ahead} and {form.own.gap} that show what x is",
            change="Add these columns if x is the "
            + of_relative
            + ". Otherwise write the classes as Car and "
            "Truck.",
        )
    return usual


def _require_meta(connection: "DuckDBPyConnection", file: Path, meta: Path) -> None:
    """Raise InputError if vehicles have no class, because they would count neither as hosts nor as leads."""
    first, count = connection.execute(WITHOUT_META).fetchone()
    if count:
        raise InputError(
            str(meta),
            seen=f"no row with a class for vehicle {first}"
            + (f" and {count - 1:,} more" if count > 1 else ""),
            expected=f"one row for each vehicle of {file.name}",
            change="Use the complete file that belongs to this recording.",
        )


def _require_one_recording(connection: "DuckDBPyConnection", file: Path) -> None:
    """Raise InputError if several recordings in one file give the same numbers to different vehicles."""
    (count,) = connection.execute(f"SELECT count(DISTINCT {RECORDING}) FROM tracks").fetchone()
    if count > 1:
        raise InputError(
            f"{file}, column {RECORDING}",
            seen=f"{count:,} recordings in one file, in which different vehicles have the same number",
            expected="one recording",
            change="Write a file for each recording.",
        )


def _require_lengths(connection: "DuckDBPyConnection", file: Path, form: Format) -> None:
    """Raise InputError if lengths of vehicles are not positive or not in metres."""
    query = LENGTHS_OF.format(length=form.own.length)
    lengths = connection.execute(query).df()
    require_lengths(str(file), f"column {form.own.length}", lengths["length"], lengths["kind"])


def _frame_rate(connection: "DuckDBPyConnection", file: Path) -> float:
    """Return the frame rate of a recording [1/s]."""
    with csv_errors(file):
        rates = csv_relation(connection, file, ["frameRate"]).project("frameRate").fetchall()
    if len(rates) != 1 or not 0 < (rates[0][0] or 0) <= LARGEST_RATE:
        raise InputError(
            f"{file}, column frameRate",
            seen=", ".join(str(rate) for (rate,) in rates) or "no row",
            expected=f"one row with the frames per second, above 0 and at most {LARGEST_RATE:,}",
            change="Correct the file.",
        )
    return rates[0][0]
