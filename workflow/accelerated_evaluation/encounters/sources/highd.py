"""Trajectories of all vehicles on a piece of road, in the CSV format of highD: each is a host in turn."""

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd
from tqdm import tqdm

from accelerated_evaluation.encounters.filters import Account
from accelerated_evaluation.encounters.recordings.cut_ins import (
    drop_in_turn,
    finished,
    milliseconds,
    require_agreement,
    stays_sql,
    with_names,
)
from accelerated_evaluation.encounters.recordings.database import (
    database,
    literal,
    read_csv,
    readable,
    recording_files,
)
from accelerated_evaluation.encounters.sources import SOURCES
from accelerated_evaluation.errors import InputError

if TYPE_CHECKING:
    from duckdb import DuckDBPyConnection

TRACKS = "_tracks.csv"
OUTPUT = ("lead_speed", "range", "closing_speed", "host_speed", "recording", "time", "vehicle", "host")
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
STAYS = """
    CREATE OR REPLACE TEMP TABLE stays AS
    SELECT id, lane, stay, min(time) AS time, max(time) AS until, any_value(seen) AS seen
    FROM ({stays}) GROUP BY id, lane, stay
"""
CANDIDATES = """
    SELECT s.id AS vehicle, f.host, s.time, abs(f.velocity) AS lead_speed, abs(h.velocity) AS host_speed,
        CASE WHEN m.drivingDirection = 1 THEN h.x - f.x - f.width ELSE f.x - h.x - h.width END AS range,
        host_speed - lead_speed AS closing_speed,
        s.time = s.seen AS first_lane,
        NOT list_contains({lead_classes}, coalesce(m.class, '')) AS other_lead,
        s.until - s.time < {stay} AS brief,
        w.id IS NULL AS without_host,
        NOT list_contains({host_classes}, coalesce(o.class, '')) AS other_host,
        coalesce(s.time - w.time < {settled} AND w.time > w.seen, FALSE) AS unsettled,
        coalesce(range <= 0, FALSE) AS overlaps
    FROM stays AS s JOIN frames AS f ON f.id = s.id AND f.time = s.time LEFT JOIN meta AS m ON m.id = s.id
        LEFT JOIN frames AS h ON h.id = f.host AND h.time = f.time LEFT JOIN meta AS o ON o.id = f.host
        LEFT JOIN stays AS w ON w.id = h.id AND w.lane = s.lane AND s.time BETWEEN w.time AND w.until
"""
# The distance of each vehicle is rounded to a micrometre, so that the sum does not depend on its order.
COUNTS = """
    SELECT (SELECT count(*) FROM tracks) AS read,
        (SELECT count(*) FROM tracks WHERE NOT {complete}) AS incomplete,
        (SELECT count(*) FROM frames) AS used,
        (SELECT count(*) FROM stays) AS stays,
        (SELECT coalesce(sum(moved * told), 0) FROM frames) AS moved,
        (SELECT coalesce(sum(told * told), 0) FROM frames) AS told,
        coalesce(sum(lasts), 0) AS milliseconds, coalesce(sum(distance), 0) AS micrometres
    FROM (
        SELECT max(time) - min(time) AS lasts, CAST(round((max(x) - min(x)) * 1e6) AS BIGINT) AS distance
        FROM frames JOIN meta USING (id) WHERE list_contains({host_classes}, class) GROUP BY id
    )
"""


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
    account = _account(counts)
    candidates = with_names(pd.concat(found), "recording {recording} vehicle {vehicle} at {time:g} s")
    cut_ins = drop_in_turn(candidates, _reasons(settings), account)
    return finished(
        cut_ins[list(OUTPUT)].astype({"host": int}),
        account,
        milliseconds=int(counts["milliseconds"]),
        micrometres=int(counts["micrometres"]),
    )


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
    classes = {key: literal(settings[key]) for key in ("lead_classes", "host_classes")}
    complete = "coalesce(" + " AND ".join(f"isfinite({column})" for column in COLUMNS) + ", FALSE)"
    with readable(file):
        read_csv(connection, file, COLUMNS).project(", ".join(COLUMNS)).to_view("tracks")
        connection.execute(FRAMES.format(rate=_frame_rate(connection, recording), complete=complete))
    with readable(meta):
        read_csv(connection, meta, META_COLUMNS, ["class"]).to_view("meta_file")
        connection.execute(META)
    stays = stays_sql("frames", vehicle="id", lane="lane", rule=settings["rule"])
    connection.execute(STAYS.format(stays=stays))
    rule, settled = settings["rule"], milliseconds(settings["settled"])
    query = CANDIDATES.format(stay=milliseconds(rule["stay"]), settled=settled, **classes)
    candidates = connection.execute(f"{query} ORDER BY s.time, s.id").df().assign(recording=name)
    counts = connection.execute(COUNTS.format(complete=complete, **classes)).df().iloc[0].to_dict()
    require_agreement(
        str(file),
        moved=counts["moved"],
        told=counts["told"],
        what="changes of x and xVelocity times the time between frames",
        key="the columns x [m] and xVelocity [m/s], or frameRate in the file of the recording",
    )
    return candidates, counts


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


def _account(counts: Mapping[str, float]) -> Account:
    """Begin the account with what is no first frame in a lane."""
    read, incomplete, used, stays = (int(counts[name]) for name in ("read", "incomplete", "used", "stays"))
    account = Account(read)
    account.enter(incomplete, step="read", reason="a missing or infinite value")
    account.enter(
        read - incomplete - used, step="tracking", reason="the same vehicle in the same frame once more"
    )
    account.enter(used - stays, step="lane", reason="no first frame of a vehicle in a lane")
    return account


def _reasons(settings: Mapping[str, Any]) -> dict[tuple[str, str], str]:
    """Return why a first frame in a lane is no cut-in, in the order in which reasons are looked at."""
    return {
        ("lane", "in the lane when first seen"): "first_lane",
        ("lane", f"in the lane for less than {settings['rule']['stay']:g} s"): "brief",
        ("class", "not of the classes in lead_classes"): "other_lead",
        ("host", "no vehicle behind in the new lane"): "without_host",
        ("host", "the vehicle behind is not of the classes in host_classes"): "other_host",
        (
            "host",
            f"the vehicle behind came into the lane less than {settings['settled']:g} s before",
        ): "unsettled",
        ("range", "range not above 0"): "overlaps",
    }
