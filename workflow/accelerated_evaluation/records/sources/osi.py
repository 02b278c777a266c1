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

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError, StudyError, readable
from accelerated_evaluation.base.files import begins_in
from accelerated_evaluation.records.recordings import trajectories
from accelerated_evaluation.records.recordings.cut_ins import milliseconds, require_agreement, require_lengths
from accelerated_evaluation.records.recordings.database import database
from accelerated_evaluation.records.recordings.osi_lanes import TraceLanes
from accelerated_evaluation.records.recordings.osi_vehicles import LANE, Fleet
from accelerated_evaluation.records.recordings.trajectories import (
    changes_of_lane,
    check_speeds,
    cut_ins_of,
    trajectory_keys,
)
from accelerated_evaluation.records.sources import source

if TYPE_CHECKING:  # an optional extra
    from betterosi import GroundTruth, MovingObject
    from duckdb import DuckDBPyConnection

ENDINGS = (".mcap", ".osi")
CARS = ("SMALL_CAR", "COMPACT_CAR", "CAR", "LUXURY_CAR")
STRAIGHT = 1.05  # vehicles move in the direction of their heading, except for some degrees
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
    boxes of the two vehicles along the heading of the host. A trailer, which is an object of its own, belongs
    to the vehicle that pulls it, and the range ends at its rear. A row has the columns of
    `recordings.trajectories.cut_ins_of`. InputError is raised if there is no trace, or if a trace or its map
    cannot be read, or if a trace has no vehicle in a lane, speeds that contradict the positions, or
    impossible lengths, or if no vehicle has one of the configured classes; StudyError if the library
    betterosi is not installed.
    """
    found, counts, warnings = [], Counter[str](), []
    with database() as (connection, _):
        for file in tqdm(_files(settings["path"]), desc="find cut-ins", unit="trace", delay=1, disable=None):
            fleet = _read_trace(connection, file, milliseconds(settings["rule"]["gap"]))
            connection.execute(trajectories.frames_sql(FRAMES, settings["rule"]))
            candidates, of_file = changes_of_lane(connection, settings, range_="f.gap", complete=COMPLETE)
            _require_use(str(file), of_file, fleet)
            warnings += [f"{file.name}: {each}" for each in _check_units(connection, str(file), fleet)]
            found.append(fleet.identified(candidates).assign(recording=file.stem))
            counts.update(of_file)
    return cut_ins_of(found, counts, settings, warnings)


def _files(folder: str) -> list[Path]:
    """Return the traces of a folder, in alphabetical order."""
    is_folder = Path(folder).is_dir()
    files = sorted(path for path in Path(folder).glob("*") if path.suffix in ENDINGS) if is_folder else []
    if not files:
        raise InputError(
            str(folder),
            seen="no file *.mcap or *.osi" if is_folder else "no such folder",
            expected="a folder of OSI traces",
            change="Correct data.osi.path." + ("" if is_folder else begins_in(folder)),
        )
    return files


def _require_use(where: str, counts: Mapping[str, float], fleet: Fleet) -> None:
    """Raise InputError if no position of a vehicle can be used, and say what is missing."""
    if counts["used"]:
        return
    parts = ", ".join(f"{name} is missing in {n:,}" for name, n in fleet.missing.items() if n)
    if not counts["read"] and fleet.others:
        parts = f"{fleet.others:,} are of objects whose type is not VEHICLE, or that have no base"
    if fleet.missing[LANE] and fleet.has_boundaries:
        parts += " (the lanes have boundaries, but no centre lines)"
    raise InputError(
        where,
        seen=f"{counts['read']:,.0f} positions of vehicles, of which none is complete"
        + f": {parts}" * bool(parts),
        expected="vehicles with position, velocity and orientation, and either assigned_lane_id, or "
        "lanes with centre lines or an OpenDRIVE map on which the vehicles drive",
        change="Configure the tool that wrote the trace to write what is missing.",
    )


def _check_units(connection: "DuckDBPyConnection", where: str, fleet: Fleet) -> list[str]:
    """Return warnings about units; raise InputError if units are wrong or lengths are impossible."""
    warnings = require_agreement(
        where,
        fleet.ahead / fleet.speed if fleet.speed > 0 else np.nan,
        what="the velocities along orientation.yaw and the speeds",
        key="orientation.yaw [rad, from the x axis to the left] or velocity [m/s, in the axes of the map]",
        factor=STRAIGHT,
    )
    warnings += check_speeds(
        connection,
        where,
        "changes of position and velocity times the time between frames",
        "position [m], velocity [m/s] or timestamp of the messages",
    )
    lengths = pd.Series(fleet.lengths, dtype=float).dropna()
    kind = pd.Series(fleet.classes, dtype=object).replace(
        dict.fromkeys(CARS, "car") | {"HEAVY_TRUCK": "truck"}
    )
    require_lengths(where, "dimension.length of the vehicles", lengths, kind[lengths.index])
    return warnings


def _read_trace(connection: "DuckDBPyConnection", file: Path, gap: int) -> Fleet:
    """Fill the table ``tracks`` with the rows of a trace, and ``meta`` with the class of each vehicle."""
    connection.execute(TRACKS)
    rows: list[tuple] = []
    fleet, lanes = Fleet(gap), TraceLanes(file)
    for message in _messages(file):
        vehicles = [one for one in message.moving_object if one.type.name == "VEHICLE" and one.base]
        fleet.others += len(message.moving_object) - len(vehicles)
        fleet.has_boundaries |= bool(message.lane_boundary or message.logical_lane_boundary)
        if vehicles:
            rows += _rows_of(message, vehicles, lanes, fleet)
        if len(rows) >= BATCH:
            _store(connection, rows)
    _store(connection, rows)
    classes = {number: name for number, name in enumerate(fleet.classes) if name is not None}
    table = pd.DataFrame(
        {"id": pd.array([*classes], "Int64"), "class": pd.array([*classes.values()], "string")}
    )
    connection.register("read", table)
    connection.execute("CREATE OR REPLACE TEMP TABLE meta AS SELECT * FROM read")
    return fleet


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
    expected = "a complete OSI trace with GroundTruth or SensorView messages"
    # The libraries of the two formats raise various errors for a damaged file.
    with readable(str(file), expected, "Write it again, or remove it.", (Exception,)):
        yield from betterosi.read(str(file), return_ground_truth=True)


def _rows_of(
    message: "GroundTruth", vehicles: list["MovingObject"], lanes: TraceLanes, fleet: Fleet
) -> Iterator[tuple]:
    """Yield the rows of one message, and update the distance [m] and last position [m] of each vehicle."""
    time = 1000 * message.timestamp.seconds + round(message.timestamp.nanos / 1e6)
    measured = np.array([_numbers(one) for one in vehicles]).reshape(-1, 6).T
    x, y, yaw, speed_x, speed_y, length = measured
    numbers = [fleet.number(one, time, own) for one, own in zip(vehicles, length, strict=True)]
    lane = [fleet.lane(one) for one in lanes.of_vehicles(message, vehicles, x, y, yaw)]
    along, across = _distances_between(x, y, yaw)
    owners = fleet.owners(vehicles, numbers, along, across)
    host, range_ = _hosts(along, yaw, length, lane, owners)
    velocity = speed_x * np.cos(yaw) + speed_y * np.sin(yaw)
    fleet.ahead += float(np.nansum(velocity * np.hypot(speed_x, speed_y)))
    fleet.speed += float(np.nansum(speed_x**2 + speed_y**2))
    for i, number in enumerate(numbers):
        if owners[i] != i:
            continue  # a trailer
        parts = x[i] + y[i], yaw[i], speed_x[i] + speed_y[i]
        missing = [not np.isfinite(part) for part in parts] + [lane[i] is None]
        fleet.missing.update(dict(zip(fleet.missing, map(int, missing), strict=True)))
        before, x_before, y_before = fleet.driven.get(number, (0.0, x[i], y[i]))
        moved = (x[i] - x_before) * np.cos(yaw[i]) + (y[i] - y_before) * np.sin(yaw[i])
        if np.isfinite(moved):
            fleet.driven[number] = (before + moved, x[i], y[i])
        behind = None if host[i] < 0 else numbers[host[i]]
        yield number, time, lane[i], before + moved, velocity[i], behind, range_[i]


def _numbers(one: "MovingObject") -> list[float]:
    """Return x, y [m], yaw [rad], velocity in x and y [m/s] and length [m]; NaN for missing values."""
    base = one.base
    parts = [(base.position, "x"), (base.position, "y"), (base.orientation, "yaw")]
    parts += [(base.velocity, "x"), (base.velocity, "y"), (base.dimension, "length")]
    return [np.nan if part is None else getattr(part, name) for part, name in parts]


def _distances_between(x: Array, y: Array, yaw: Array) -> tuple[Array, Array]:
    """Return how far the vehicle of a row is ahead and to the left of that of a column [m], shape (n, n)."""
    away_x, away_y, cos, sin = x[:, None] - x, y[:, None] - y, np.cos(yaw), np.sin(yaw)
    return cos * away_x + sin * away_y, cos * away_y - sin * away_x


def _hosts(
    along: Array, yaw: Array, length: Array, lane: list[int | None], owners: list[int]
) -> tuple[Array, Array]:
    """Return, for each vehicle, the index of the nearest vehicle behind in its lane and the range to it [m].

    The range ends at the rear of the vehicle or of its last trailer. The index is -1 and the range is NaN if
    there is no vehicle behind. ``along`` is the first array of `_distances_between`.
    """
    own = np.arange(len(owners))
    same = np.array([[a is not None and a == b for b in lane] for a in lane])
    is_behind = same & (along > 0) & (np.cos(yaw[:, None] - yaw) > 0) & (own == owners)
    distance = np.where(is_behind, along, np.inf)
    host = np.argmin(distance, axis=1)
    found = np.isfinite(distance[own, host])
    gaps = along - (length[:, None] + length) / 2
    np.minimum.at(gaps, owners, gaps.copy())
    return np.where(found, host, -1), np.where(found, gaps[own, host], np.nan)
