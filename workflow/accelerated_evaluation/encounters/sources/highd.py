"""Trajectories of all vehicles on a piece of road, in the CSV format of highD: each is a host in turn."""

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd
from tqdm import tqdm

from accelerated_evaluation.encounters.recordings.cut_ins import require_agreement
from accelerated_evaluation.encounters.recordings.database import (
    database,
    read_csv,
    readable,
    recording_files,
)
from accelerated_evaluation.encounters.recordings.trajectories import changes_of_lane, cut_ins_of
from accelerated_evaluation.encounters.sources import SOURCES
from accelerated_evaluation.errors import InputError

if TYPE_CHECKING:
    from duckdb import DuckDBPyConnection

TRACKS = "_tracks.csv"
# In the format `x` is the left end of the bounding box and `width` its length along the road. Vehicles of
# direction 1 drive to the left, so that their front is at x; those of direction 2 drive to the right.
COLUMNS = ("frame", "id", "x", "width", "xVelocity", "followingId", "laneId")
META_COLUMNS = ("id", "drivingDirection")
FRAMES = """
    CREATE OR REPLACE TEMP TABLE frames AS
    SELECT * EXCLUDE (copy), x - lag(x) OVER one AS moved,
        velocity * (time - lag(time) OVER one) / 1000 AS told,
        min(time) OVER (PARTITION BY id) AS seen
    FROM (
        SELECT CAST(id AS INTEGER) AS id, CAST(round(frame * 1000 / {rate}) AS BIGINT) AS time, x, width,
            xVelocity AS velocity, CAST(followingId AS INTEGER) AS host, CAST(laneId AS INTEGER) AS lane,
            row_number() OVER (PARTITION BY id, frame ORDER BY x, xVelocity, laneId) AS copy
        FROM tracks WHERE {complete}
    ) WHERE copy = 1
    WINDOW one AS (PARTITION BY id ORDER BY time)
"""
META = """
    CREATE OR REPLACE TEMP TABLE meta AS
    SELECT DISTINCT ON (id) id, drivingDirection, class FROM meta_file ORDER BY id, drivingDirection, class
"""
RANGE = "CASE WHEN m.drivingDirection = 1 THEN h.x - f.x - f.width ELSE f.x - h.x - h.width END"


@SOURCES.add("highd")
def read(settings: Mapping[str, Any]) -> pd.DataFrame:
    """Find the cut-ins in recordings in the format of highD, one recording after the other.

    A change of lane is a cut-in before the vehicle that is behind in the new lane, its host. Each vehicle of
    the host classes is watched for as long as it is in view, and so all of that is exposure.

    Parameters
    ----------
    settings
        Section ``data.highd`` of a valid configuration; ``path`` is a folder with files *_tracks.csv, and
        beside each *_tracksMeta.csv and *_recordingMeta.csv.

    Returns
    -------
    pandas.DataFrame
        ``lead_speed`` [m/s], ``range`` [m] from the front of the host to the rear of the vehicle, and
        ``closing_speed`` [m/s] in the first frame in the new lane; ``host_speed`` [m/s], and ``recording``,
        ``time`` [s], ``vehicle`` and ``host``, which say where the cut-in is. Attributes as
        `recordings.cut_ins.finished` describes them.

    Raises
    ------
    InputError
        If a file is missing or cannot be read, or speeds contradict positions.
    """
    files = recording_files(settings["path"], f"*{TRACKS}", "data.highd.path")
    found, counts = [], Counter()
    with database() as (connection, _):
        for file in tqdm(files, desc="find cut-ins", unit="recording", delay=1, disable=None):
            candidates, of_file = _read_recording(connection, file, settings)
            found.append(candidates)
            counts.update(of_file)
    return cut_ins_of(found, counts, settings)


def _read_recording(
    connection: "DuckDBPyConnection", file: Path, settings: Mapping[str, Any]
) -> tuple[pd.DataFrame, dict[str, float]]:
    """Return the changes of lane of one recording, in order of time, and what was counted and added up."""
    name = file.name.removesuffix(TRACKS)
    meta, recording = (file.with_name(f"{name}_{kind}Meta.csv") for kind in ("tracks", "recording"))
    for beside in (meta, recording):
        if not beside.is_file():
            raise InputError(
                str(beside),
                seen="no such file",
                expected=f"it beside {file.name}",
                change="Add or rename it.",
            )
    complete = "coalesce(" + " AND ".join(f"isfinite({column})" for column in COLUMNS) + ", FALSE)"
    with readable(file):
        read_csv(connection, file, COLUMNS).project(", ".join(COLUMNS)).to_view("tracks")
        connection.execute(FRAMES.format(rate=_frame_rate(connection, recording), complete=complete))
    with readable(meta):
        read_csv(connection, meta, META_COLUMNS, ["class"]).to_view("meta_file")
        connection.execute(META)
    candidates, counts = changes_of_lane(connection, settings, range_=RANGE, complete=complete)
    require_agreement(
        str(file),
        moved=counts["moved"],
        told=counts["told"],
        what="changes of x and xVelocity times the time between frames",
        key="the columns x [m] and xVelocity [m/s], or frameRate in the file of the recording",
    )
    return candidates.assign(recording=name), counts


def _frame_rate(connection: "DuckDBPyConnection", file: Path) -> float:
    """Return the frames a second of a recording."""
    with readable(file):
        rates = read_csv(connection, file, ["frameRate"]).project("frameRate").fetchall()
    if len(rates) != 1 or not (rates[0][0] or 0) > 0:
        raise InputError(
            f"{file}, column frameRate",
            seen=", ".join(str(rate) for (rate,) in rates) or "no row",
            expected="one row with the frames a second",
            change="Correct the file.",
        )
    return rates[0][0]
