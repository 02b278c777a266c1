"""Raw recordings of the Safety Pilot Model Deployment: targets of a forward sensor, and host speeds."""

import glob
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from tqdm import tqdm

from accelerated_evaluation.base.arrays import SPEED
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.sections import choice, listed, number, section
from accelerated_evaluation.records.ingest import Account
from accelerated_evaluation.records.recordings.cut_ins import (
    RULE,
    TRACKING,
    drop_in_turn,
    finished,
    milliseconds,
    require_agreement,
    with_names,
)
from accelerated_evaluation.records.recordings.database import (
    csv_errors,
    csv_relation,
    database,
    literal,
    recording_files,
    whole,
)
from accelerated_evaluation.records.recordings.front_targets import changes_into_path
from accelerated_evaluation.records.sources import source

if TYPE_CHECKING:
    from duckdb import DuckDBPyConnection, DuckDBPyRelation

TARGETS, HOST = "DataFrontTargets*.csv", "DataWsu*.csv"
PART = 150_000_000  # bytes of targets, about three million rows, that are processed at a time
OUTPUT = ("lead_speed", "range", "closing_speed", "host_speed", "device", "trip", "time", "vehicle")

KEYS: dict[str, Any] = {
    "time_unit": number(0.01, 0, 1, "Unit of the column Time [s].", exclusive=True),
    "speed_unit": choice("km/h", SPEED, "Unit of SpeedWsu."),
    "target_types": listed(
        [0],
        {"type": "integer", "minimum": 0, "maximum": 255},
        "Values of TargetType whose cut-ins count; 0 means cars.",
    ),
    "rule": RULE,
    "link": section(
        time=number(
            0.5, 0, 10, "Longest time [s] after which a lost vehicle is recognised under another number."
        ),
        range=number(
            3, 0, 100, "Largest difference [m] from the range that its last range and range rate predict."
        ),
        transversal=number(1, 0, 100, "Largest difference of its lateral position [m]."),
    ),
    "uncovered": choice(
        "drop",
        ("drop", "keep"),
        "Whether to drop or keep a vehicle that is the nearest in the path only because a nearer one has "
        "just left it.",
    ),
    "aside": section(
        time=number(
            3, 0, 60, "Time before a change into the path [s] in which the vehicle must have been next to it."
        ),
        transversal=number(
            1, 0, 100, "Least lateral offset [m] that it must have reached in that time; 0 for no condition."
        ),
    ),
    "host_gap": number(0.2, 0, 10, "Largest age [s] of the host speed that is used for a cut-in."),
    "turn_signal": number(
        3,
        0,
        60,
        "A change into the path within this time [s] after a turn signal of the host is a manoeuvre of the "
        "host and no cut-in; null to count it.",
        null=True,
    ),
}

# Columns of the two kinds of files, and queries that convert them to the tables ``targets`` and ``host``. All
# rows of a trip are assigned to the same part.
TARGET_COLUMNS = (
    "Device",
    "Trip",
    "Time",
    "ObstacleId",
    "Range",
    "RangeRate",
    "Transversal",
    "TargetType",
    "CIPV",
)
PLACE = f"""
    {whole("Device", "Device")} AS device, {whole("Trip", "Trip")} AS trip,
    {whole("round(Time * {tick})", "Time")} AS time,
"""
SELECT_TARGETS = f"""
    {PLACE} {whole("ObstacleId", "ObstacleId")} AS obstacle,
    Range AS range, RangeRate AS range_rate, Transversal AS side, {whole("TargetType", "TargetType")} AS type,
    CIPV = 1 AS in_path, coalesce({{complete}}, FALSE) AS complete, hash(device, trip) % {{parts}} AS part
"""
HOST_COLUMNS = (
    "Device",
    "Trip",
    "Time",
    "SpeedWsu",
    "GpsSpeedWsu",
    "TurnSngRWsu",
    "TurnSngLWsu",
    "ValidCanWsu",
)
SELECT_HOST = f"""
    {PLACE} SpeedWsu * {{speed}} AS speed, GpsSpeedWsu AS gps_speed,
    coalesce(TurnSngRWsu = 1 OR TurnSngLWsu = 1, FALSE) AS signal, hash(device, trip) % {{parts}} AS part
"""
USABLE_HOST = "ValidCanWsu = 1 AND SpeedWsu >= 0"
LOAD = """
    CREATE OR REPLACE TEMP TABLE targets AS SELECT * EXCLUDE (part) FROM {targets} WHERE part = {part};
    CREATE OR REPLACE TEMP TABLE host AS
    SELECT device, trip, time, min(speed) AS speed, bool_or(signal) AS signal, min(gps_speed) AS gps_speed
    FROM {host} WHERE part = {part} GROUP BY device, trip, time
"""
# The distance of each frame is rounded to a micrometre, so that the sum does not depend on its order.
EXPOSURE = """
    SELECT coalesce(sum(lasts), 0) AS milliseconds,
        coalesce(sum(CAST(round(speed * lasts * 1000) AS BIGINT)), 0) AS micrometres,
        coalesce(sum(speed) FILTER (gps_speed > 5), 0) AS speed,
        coalesce(sum(gps_speed) FILTER (gps_speed > 5), 0) AS gps_speed
    FROM (
        SELECT *, lead(time) OVER (PARTITION BY device, trip ORDER BY time) - time AS lasts FROM host
        WHERE device IN (SELECT device FROM devices)
    ) WHERE lasts <= {gap}
"""


@source(
    "spmd_raw",
    description="cut-ins in raw recordings in the format of the Safety Pilot Model Deployment",
    files="Folder with files DataFrontTargets*.csv and DataWsu*.csv",
    **KEYS,
)
def read(settings: Mapping[str, Any]) -> pd.DataFrame:
    """Return the cut-ins in raw recordings, which may be larger than the memory.

    The rows are first sorted into parts on the disk, so that each trip is in one part. The parts are then
    processed one after the other. Computing time and temporary files grow in proportion to the number of
    rows, but the memory does not. The folder has files DataFrontTargets*.csv and DataWsu*.csv. A row has the
    state in the first frame in the path, and ``device``, ``trip``, ``time`` [s] and ``vehicle`` (its first
    obstacle number), which locate the cut-in. InputError is raised if a file is missing or cannot be read, or
    if recorded quantities contradict the configured units.
    """
    folder, key = settings["path"], "data.spmd_raw.path"
    targets, hosts = (recording_files(folder, pattern, key) for pattern in (TARGETS, HOST))
    parts = 1 + sum(file.stat().st_size for file in targets) // PART
    with database() as (connection, space):
        tick, complete = 1000 * settings["time_unit"], " AND ".join(f"isfinite({c})" for c in TARGET_COLUMNS)
        query = SELECT_TARGETS.format(tick=tick, parts=parts, complete=complete)
        _sort_into_parts(connection, targets, space / "targets", query, TARGET_COLUMNS)
        query = SELECT_HOST.format(tick=tick, parts=parts, speed=SPEED[settings["speed_unit"]])
        _sort_into_parts(connection, hosts, space / "host", query, HOST_COLUMNS)
        with csv_errors(Path(folder)):
            found, counts = _work(connection, space, parts, settings)
    _require_types(folder, counts, settings["target_types"])
    warnings = _require_units(folder, counts, settings["speed_unit"])
    account = _account(counts)
    candidates = pd.concat(found).sort_values(["device", "trip", "time", "vehicle"])
    candidates = with_names(candidates, "device {device} trip {trip} at {time:g} s")
    cut_ins = drop_in_turn(candidates, _reasons(settings), account)
    return finished(cut_ins[list(OUTPUT)], account, counts, warnings, folder)


def _sort_into_parts(
    connection: "DuckDBPyConnection", files: Sequence[Path], folder: Path, select: str, columns: Sequence[str]
) -> None:
    """Write the rows of the files as Parquet, in a folder for each file with a subfolder for each part."""
    size = sum(file.stat().st_size for file in files)
    with tqdm(
        desc=f"sort {folder.name}", total=size, unit="B", unit_scale=True, delay=1, disable=None
    ) as bar:
        for number, file in enumerate(files):
            with csv_errors(file):
                rows: DuckDBPyRelation = csv_relation(connection, file, columns)
                rows = rows.filter(USABLE_HOST) if "SpeedWsu" in columns else rows
                target = folder / str(number)
                target.mkdir(parents=True)
                rows.project(select).write_parquet(str(target), partition_by=["part"], compression="zstd")
            bar.update(file.stat().st_size)
        if not any(folder.rglob("*.parquet")):
            raise InputError(
                ", ".join(map(str, files)),
                seen="no row that can be used",
                expected="rows below the header" + (f", with {USABLE_HOST}" if folder.name == "host" else ""),
                change="Export the recordings again.",
            )


def _work(
    connection: "DuckDBPyConnection", folder: Path, parts: int, settings: Mapping[str, Any]
) -> tuple[list[pd.DataFrame], Counter]:
    """Return the changes into the path in each part, and counts and exposure added up over all parts."""
    place = Path(glob.escape(str(folder)))
    tables = {
        name: f"read_parquet({literal([place / name / '*/*/*.parquet'])}, hive_partitioning = TRUE)"
        for name in ("targets", "host")
    }
    connection.execute(f"CREATE TEMP TABLE devices AS SELECT DISTINCT device FROM {tables['targets']}")
    exposure = EXPOSURE.format(gap=milliseconds(settings["rule"]["gap"]))
    found, counts = [], Counter[str]()
    for part in tqdm(range(parts), desc="find cut-ins", delay=1, disable=None):
        connection.execute(LOAD.format(part=part, **tables))
        changes, of_part = changes_into_path(connection, settings)
        found.append(changes)
        counts.update(of_part)
        counts.update(connection.execute(exposure).df().iloc[0].to_dict())
    return found, counts


def _require_types(folder: str, counts: Mapping[Any, float], types: Sequence[int]) -> None:
    """Raise InputError if no target has one of the configured types, and name the types there are."""
    seen = {int(key[0]): int(count) for key, count in counts.items() if isinstance(key, tuple)}
    if seen and seen.keys().isdisjoint(types):
        raise InputError(
            f"{folder}, column TargetType",
            seen="rows of the types " + ", ".join(f"{kind} ({n:,})" for kind, n in seen.items()),
            expected=f"some of the configured types {', '.join(map(str, types))}",
            change="State the types of cars in data.spmd_raw.target_types.",
        )


def _require_units(folder: str, counts: Mapping[str, float], unit: str) -> list[str]:
    """Raise InputError if units contradict each other; return warnings about units that cannot be checked."""
    warnings = require_agreement(
        folder,
        counts["moved"] / counts["reported"] if counts["reported"] > 0 else np.nan,
        what="changes of Range and RangeRate times the time between frames",
        key="data.spmd_raw.time_unit, or the columns Range [m] and RangeRate [m/s, negative when closing]",
        factor=2,  # the radar's range rates are noisy
    )
    warnings += require_agreement(
        folder,
        counts["speed"] / counts["gps_speed"] if counts["gps_speed"] > 0 else np.nan,
        what="SpeedWsu, as m/s, and GpsSpeedWsu [m/s]",
        key="data.spmd_raw.speed_unit, or the column SpeedWsu",
    )
    if counts["gps_speed"] > 0:
        return warnings
    return [
        *warnings,
        f"no row with a GpsSpeedWsu above 5 m/s, so that the unit of SpeedWsu ({unit}) could not be checked",
    ]


def _account(counts: Mapping[str, float]) -> Account:
    """Begin the account with the rows that are not the first frame of a vehicle in the path."""
    account = Account(int(counts["read"]))
    used = counts["read"]
    for name, step, reason in (
        ("incomplete", "read", "a missing or infinite value"),
        ("without_range", "read", "range not above 0"),
        ("other_type", "target type", "not of the types in target_types"),
        ("repeated", TRACKING, "the same obstacle at the same time once more"),
    ):
        account.enter(int(counts[name]), step=step, reason=reason)
        used -= counts[name]
    account.enter(
        int(used - counts["changes"]),
        step="path",
        reason="no first frame of a vehicle in the path of the host",
    )
    return account


def _reasons(settings: Mapping[str, Any]) -> dict[tuple[str, str], str]:
    """Return the reasons why a change into the path is not a cut-in, in the order of their application."""
    aside, stay = settings["aside"], settings["rule"]["stay"]
    uncovered = ("path", "uncovered by a nearer vehicle that left the path")
    return {
        ("path", "in the path when first seen"): "found_in_path",
        ("path", f"in the path for less than {stay:g} s"): "brief",
        **({uncovered: "uncovered"} if settings["uncovered"] == "drop" else {}),
        ("path", f"less than {aside['transversal']:g} m aside in the {aside['time']:g} s before"): "ahead",
        ("host", f"no host speed in the {settings['host_gap']:g} s before"): "without_host",
        ("host", f"turn signal of the host in the {settings['turn_signal'] or 0:g} s before"): "signalled",
        ("lead speed", "comes towards the host"): "oncoming",
    }
