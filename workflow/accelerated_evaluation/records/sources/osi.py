"""Trajectories of all vehicles in traces of ASAM OSI, for example traces that omega-prime writes.

Each vehicle is treated as a host in turn.
"""

from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from tqdm import tqdm

from accelerated_evaluation.base.errors import InputError, StudyError
from accelerated_evaluation.records.recordings import trajectories
from accelerated_evaluation.records.recordings.cut_ins import require_agreement
from accelerated_evaluation.records.recordings.database import database
from accelerated_evaluation.records.recordings.osi_lanes import TraceLanes
from accelerated_evaluation.records.recordings.trajectories import (
    changes_of_lane,
    cut_ins_of,
    trajectory_keys,
)
from accelerated_evaluation.records.sources import source

if TYPE_CHECKING:  # an optional extra
    from betterosi import GroundTruth, MovingObject
    from duckdb import DuckDBPyConnection

ENDINGS = (".mcap", ".osi")
CARS = ("SMALL_CAR", "COMPACT_CAR", "CAR", "LUXURY_CAR")
BATCH = 100_000  # rows in memory at a time
COMPLETE = "coalesce(isfinite(x) AND isfinite(velocity), FALSE) AND lane IS NOT NULL"
# `x` is the distance that the vehicle has driven while in view, so that roads may bend.
TRACKS = """
    CREATE OR REPLACE TEMP TABLE tracks
    (id BIGINT, time BIGINT, lane BIGINT, x DOUBLE, velocity DOUBLE, host BIGINT, gap DOUBLE)
"""
FRAMES = trajectories.FRAMES.format(
    rows="SELECT *, row_number() OVER (PARTITION BY id, time ORDER BY x) AS copy FROM tracks "
    f"WHERE {COMPLETE}"
)


@source(
    "osi",
    description="cut-ins in ASAM OSI traces",
    files="Folder with files *.mcap or *.osi",
    **trajectory_keys(
        [*CARS, "DELIVERY_VAN", "HEAVY_TRUCK", "SEMITRACTOR", "BUS"],
        CARS,
        " (VehicleClassification.Type of OSI)",
    ),
)
def read(settings: Mapping[str, Any]) -> pd.DataFrame:
    """Return the cut-ins in OSI traces of GroundTruth messages; one trace is processed after the other.

    A vehicle that changes into another lane cuts in before the vehicle behind it in the new lane, the host.
    The host is the nearest vehicle behind in the same lane. The range is the distance between the bounding
    boxes of the two vehicles along the heading of the host. A row has the columns of
    `recordings.trajectories.cut_ins_of`. InputError is raised if there is no trace, or if a trace or its map
    cannot be read, or if a trace has no vehicle in a lane, or speeds that contradict the positions;
    StudyError if the library betterosi is not installed.
    """
    found, counts = [], Counter()
    with database() as (connection, _):
        for file in tqdm(_files(settings["path"]), desc="find cut-ins", unit="trace", delay=1, disable=None):
            _read_trace(connection, file)
            connection.execute(FRAMES)
            candidates, of_file = changes_of_lane(connection, settings, range_="f.gap", complete=COMPLETE)
            _require_use(str(file), of_file)
            found.append(candidates.assign(recording=file.stem))
            counts.update(of_file)
    return cut_ins_of(found, counts, settings)


def _files(folder: str) -> list[Path]:
    """Return the traces of a folder, in alphabetical order."""
    is_folder = Path(folder).is_dir()
    files = sorted(path for path in Path(folder).glob("*") if path.suffix in ENDINGS) if is_folder else []
    if not files:
        raise InputError(
            str(folder),
            seen="no file *.mcap or *.osi" if is_folder else "no such folder",
            expected="a folder of OSI traces",
            change="Correct data.osi.path.",
        )
    return files


def _require_use(where: str, counts: Mapping[str, float]) -> None:
    """Raise InputError if a trace has no vehicle in a lane, or if speeds contradict positions."""
    if not counts["used"]:
        raise InputError(
            where,
            seen=f"{counts['read']:,.0f} positions of vehicles, of which none is complete",
            expected="vehicles with position, velocity and orientation, and either assigned_lane_id, or "
            "lanes with centre lines or an OpenDRIVE map on which the vehicles drive",
            change="Configure the tool that wrote the trace to write them.",
        )
    require_agreement(
        where,
        moved=counts["moved"],
        reported=counts["reported"],
        what="changes of position and velocity times the time between frames",
        key="position [m], velocity [m/s] or timestamp of the messages",
    )


def _read_trace(connection: "DuckDBPyConnection", file: Path) -> None:
    """Fill the table ``tracks`` with the rows of a trace, and ``meta`` with the class of each vehicle."""
    connection.execute(TRACKS)
    rows: list[tuple] = []
    classes: dict[int, str] = {}
    driven: dict[int, tuple[float, float, float]] = {}
    lanes = TraceLanes(file)
    for message in _messages(file):
        vehicles = [one for one in message.moving_object if one.type.name == "VEHICLE" and one.base]
        for one in vehicles:
            if one.vehicle_classification:
                classes.setdefault(one.id.value, one.vehicle_classification.type.name)
        if vehicles:
            rows += _rows_of(message, vehicles, lanes, driven)
        if len(rows) >= BATCH:
            _store(connection, rows)
    _store(connection, rows)
    table = pd.DataFrame(
        {"id": pd.array([*classes], "Int64"), "class": pd.array([*classes.values()], "string")}
    )
    connection.register("read", table)
    connection.execute("CREATE OR REPLACE TEMP TABLE meta AS SELECT * FROM read")


def _store(connection: "DuckDBPyConnection", rows: list[tuple]) -> None:
    if rows:
        columns = ["id", "time", "lane", "x", "velocity", "host", "gap"]
        table = pd.DataFrame(rows, columns=columns).astype({"lane": "Int64", "host": "Int64"})
        connection.register("read", table)
        connection.execute("INSERT INTO tracks SELECT * FROM read")
        rows.clear()


def _messages(file: Path) -> Iterator["GroundTruth"]:
    """Yield the GroundTruth messages of a trace, including those inside SensorView messages."""
    try:
        import betterosi
    except ImportError as error:
        raise StudyError(
            "OSI traces need the library betterosi, which is not installed; "
            "install it with `pip install 'accelerated-evaluation[osi]'`"
        ) from error
    try:
        yield from betterosi.read(str(file), return_ground_truth=True)
    except Exception as error:  # the libraries of the two formats raise various errors for a damaged file
        raise InputError(
            str(file),
            seen=f"{type(error).__name__}: {error}",
            expected="a complete OSI trace with GroundTruth or SensorView messages",
            change="Write it again, or remove it.",
        ) from error


def _rows_of(
    message: "GroundTruth",
    vehicles: list["MovingObject"],
    lanes: TraceLanes,
    driven: dict[int, tuple[float, float, float]],
) -> Iterator[tuple]:
    """Yield the rows of one message, and update the distance [m] and last position [m] of each vehicle."""
    time = 1000 * message.timestamp.seconds + round(message.timestamp.nanos / 1e6)
    numbers = np.array([_numbers(one) for one in vehicles]).reshape(-1, 6).T
    x, y, yaw, speed_x, speed_y, length = numbers
    lane = lanes.of_vehicles(message, vehicles, x, y, yaw)
    host, range_ = _hosts(x, y, yaw, length, lane)
    velocity = speed_x * np.cos(yaw) + speed_y * np.sin(yaw)
    for i, one in enumerate(vehicles):
        number = one.id.value
        before, x_before, y_before = driven.get(number, (0.0, x[i], y[i]))
        moved = (x[i] - x_before) * np.cos(yaw[i]) + (y[i] - y_before) * np.sin(yaw[i])
        if np.isfinite(moved):
            driven[number] = (before + moved, x[i], y[i])
        behind = None if host[i] < 0 else vehicles[host[i]].id.value
        yield number, time, lane[i], before + moved, velocity[i], behind, range_[i]


def _numbers(one: "MovingObject") -> list[float]:
    """Return x, y [m], yaw [rad], velocity in x and y [m/s] and length [m]; NaN for missing values."""
    base = one.base
    parts = (base.position, "x"), (base.position, "y"), (base.orientation, "yaw")
    parts += (base.velocity, "x"), (base.velocity, "y"), (base.dimension, "length")
    return [np.nan if part is None else getattr(part, name) for part, name in parts]


def _hosts(
    x: np.ndarray, y: np.ndarray, yaw: np.ndarray, length: np.ndarray, lane: list[int | None]
) -> tuple[np.ndarray, np.ndarray]:
    """Return, for each vehicle, the index of the nearest vehicle behind in its lane and the range to it [m].

    The index is -1 and the range is NaN if there is no vehicle behind.
    """
    along = np.cos(yaw) * (x[:, None] - x) + np.sin(yaw) * (y[:, None] - y)  # row vehicle ahead of column one
    same = np.array([[a is not None and a == b for b in lane] for a in lane])
    is_behind = same & (along > 0) & (np.cos(yaw[:, None] - yaw) > 0)
    distance = np.where(is_behind, along, np.inf)
    host = np.argmin(distance, axis=1)
    nearest = distance[np.arange(x.size), host]
    found = np.isfinite(nearest)
    range_ = np.where(found, nearest - (length + length[host]) / 2, np.nan)
    return np.where(found, host, -1), range_
