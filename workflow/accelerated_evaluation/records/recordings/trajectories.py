"""Cut-ins in trajectories of all vehicles on a road: the functions that several formats share.

The reader of a format creates three tables:

- ``tracks`` contains the rows that were read.
- ``frames`` has a row for each vehicle and frame: ``id``, ``time`` [ms], ``lane``, ``host`` (the vehicle
  behind in the same lane, if any), ``velocity`` [m/s], ``x`` [m] along the road, ``moved`` and ``reported``
  (the change of x [m] since the previous frame, measured and computed from the velocity), and ``seen`` (the
  time [ms] at which the track of the vehicle begins, see `recordings.cut_ins.track_sql`).
- ``meta`` has ``id`` and ``class`` of each vehicle.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.sections import listed, number
from accelerated_evaluation.records.ingest import Account
from accelerated_evaluation.records.recordings.cut_ins import (
    AGREEMENT,
    RULE,
    TRACKING,
    drop_in_turn,
    finished,
    milliseconds,
    require_agreement,
    stays_sql,
    track_sql,
    with_names,
)
from accelerated_evaluation.records.recordings.database import literal

if TYPE_CHECKING:
    from duckdb import DuckDBPyConnection

JUMP = 5.0  # [m], largest difference between a change of position and what the velocity explains
OUTPUT = ("lead_speed", "range", "closing_speed", "host_speed", "recording", "time", "vehicle", "host")
# In some recordings a vehicle has several rows for one frame. ``copy`` numbers them; the first one is used.
TRACKED = """
    SELECT * EXCLUDE (copy, before), {{seen}} AS seen
    FROM (SELECT *, lag(time) OVER (PARTITION BY id ORDER BY time) AS before FROM ({rows}) WHERE copy = 1)
"""
FRAMES = f"""
    CREATE OR REPLACE TEMP TABLE frames AS
    SELECT *, x - lag(x) OVER one AS moved, velocity * (time - lag(time) OVER one) / 1000 AS reported
    FROM ({TRACKED}) WINDOW one AS (PARTITION BY id, seen ORDER BY time)
"""
STAYS = """
    CREATE OR REPLACE TEMP TABLE stays AS
    SELECT id, seen, lane, stay, min(time) AS time, max(time) AS until
    FROM ({stays}) GROUP BY id, seen, lane, stay
"""
CANDIDATES = """
    SELECT s.id AS vehicle, f.host, s.time, abs(f.velocity) AS lead_speed, abs(h.velocity) AS host_speed,
        {range} AS range,
        host_speed - lead_speed AS closing_speed,
        s.time = s.seen AS first_lane,
        coalesce(abs(f.moved - f.reported) > {jump}, FALSE) AS jumped,
        NOT list_contains({lead_classes}, lower(coalesce(m.class, ''))) AS other_lead,
        s.until - s.time < {stay} AS brief,
        h.id IS NULL AS without_host,
        NOT coalesce({same_lane}, FALSE) AS elsewhere,
        NOT list_contains({host_classes}, lower(coalesce(o.class, ''))) AS other_host,
        coalesce(s.time - w.time < {settled} AND w.time > w.seen, FALSE) AS unsettled,
        coalesce(range <= 0, FALSE) AS overlaps
    FROM stays AS s JOIN frames AS f ON f.id = s.id AND f.time = s.time LEFT JOIN meta AS m ON m.id = s.id
        LEFT JOIN frames AS h ON h.id = f.host AND h.time = f.time LEFT JOIN meta AS o ON o.id = f.host
        LEFT JOIN stays AS w ON w.id = h.id AND w.lane = h.lane AND s.time BETWEEN w.time AND w.until
"""
# The distance of each vehicle is rounded to a micrometre, so that the sum does not depend on its order.
COUNTS = """
    SELECT (SELECT count(*) FROM tracks) AS read,
        (SELECT count(*) FROM tracks WHERE NOT ({complete})) AS incomplete,
        (SELECT count(*) FROM frames) AS used,
        (SELECT count(*) FROM stays) AS stays,
        coalesce(sum(lasts), 0) AS milliseconds, coalesce(sum(distance), 0) AS micrometres
    FROM (
        SELECT max(time) - min(time) AS lasts, CAST(round((max(x) - min(x)) * 1e6) AS BIGINT) AS distance
        FROM frames JOIN meta USING (id) WHERE list_contains({host_classes}, lower(class)) GROUP BY id, seen
    )
"""
CLASSES = """
    SELECT coalesce(class, 'none') AS class, count(*)
    FROM (SELECT DISTINCT id FROM frames) LEFT JOIN meta USING (id) GROUP BY 1 ORDER BY 1
"""
AGREEMENTS = """
    SELECT sum(moved * reported) / sum(reported * reported) AS ratio, sum(reported * reported) AS weight
    FROM frames GROUP BY id HAVING sum(reported * reported) > 0 ORDER BY ratio
"""
MANY_OTHERS = 0.02  # share of the vehicles whose speeds contradict their positions that causes a warning
CLASS_KEYS = ("lead_classes", "host_classes")


def trajectory_keys(lead_classes: Sequence[str], host_classes: Sequence[str], of: str = "") -> dict[str, Any]:
    """Return the keys of the configuration that all sources of trajectories have, each with its schema.

    The defaults are classes of the vehicles that cut in, and of the hosts. The text ``of`` follows "Classes"
    in the description and says where the names of the classes come from.
    """
    host = "Classes of the hosts: cut-ins in front of them count, and their driving is the exposure."
    lead = f"Classes{of} of the vehicles whose cut-ins count."
    return {
        # Data sets in the same format write Car or car, so the case of the letters is ignored.
        "lead_classes": listed(lead_classes, {"type": "string"}, lead),
        "host_classes": listed(host_classes, {"type": "string"}, host),
        "rule": RULE,
        "settled": number(
            1, 0, 60, "Time [s] for which a host must have been in its lane, unless it came into view there."
        ),
    }


def frames_sql(frames: str, rule: Mapping[str, float], **more: object) -> str:
    """Return the SQL statement that creates ``frames``, given the rule of gaps and further placeholders."""
    return frames.format(seen=track_sql(vehicle="id", rule=rule), **more)


def changes_of_lane(
    connection: "DuckDBPyConnection",
    settings: Mapping[str, Any],
    *,
    range_: str,
    complete: str,
    same_lane: str = "h.lane = f.lane",
) -> tuple[pd.DataFrame, dict[str, float]]:
    """Return the changes of lane of one recording in order of time, with counts and sums for the account.

    ``range_`` [m], ``complete`` and ``same_lane`` are SQL expressions, which may use the frame ``f`` of the
    vehicle, the frame ``h`` of its host, and the row ``m`` of the vehicle in ``meta``. A row of ``tracks`` is
    used if it is ``complete``. The host is in the lane of the vehicle if ``same_lane``, which must be given
    if the numbers in ``lane`` are relative to each vehicle. The results are those of the queries
    `CANDIDATES`, in SI units with ``time`` in milliseconds and a boolean column for each reason why a change
    is not a cut-in, and `COUNTS`, with the number of vehicles of each class under the key (class,).
    """
    rule, settled = settings["rule"], milliseconds(settings["settled"])
    classes = {key: literal(map(str.lower, settings[key])) for key in CLASS_KEYS}
    connection.execute(
        STAYS.format(stays=stays_sql("frames", vehicle="id, seen", lane="lane", rule=settings["rule"]))
    )
    query = CANDIDATES.format(
        range=range_,
        same_lane=same_lane,
        stay=milliseconds(rule["stay"]),
        settled=settled,
        jump=JUMP,
        **classes,
    )
    candidates = connection.execute(f"{query} ORDER BY s.time, s.id").df()
    counts = connection.execute(COUNTS.format(complete=complete, **classes)).df().iloc[0].to_dict()
    counts |= {(name,): count for name, count in connection.execute(CLASSES).fetchall()}
    return candidates, counts


def check_speeds(connection: "DuckDBPyConnection", where: str, what: str, key: str) -> list[str]:
    """Compare the changes of position with those that the velocities explain; see `require_agreement`.

    The ratio is the median of the ratios of the vehicles, each with the weight of its squared changes of
    position, so that a number that was given to another vehicle, which then jumps, does not outweigh all
    others. A further warning is returned if many vehicles have another ratio.
    """
    vehicles = connection.execute(AGREEMENTS).df()
    if vehicles.empty:
        return []
    ratio, weight = vehicles["ratio"], vehicles["weight"].cumsum().to_numpy()
    median = float(ratio.iloc[np.searchsorted(weight, weight[-1] / 2)])
    warnings = require_agreement(where, median, what=what, key=key)
    others = ~ratio.between(1 / AGREEMENT, AGREEMENT)
    if others.mean() > MANY_OTHERS:
        warnings.append(f"{what} have another ratio than 1 in {others.sum():,} of {others.size:,} vehicles")
    return warnings


def require_classes(counts: Mapping[Any, float], settings: Mapping[str, Any]) -> None:
    """Raise InputError if no vehicle has one of the configured classes, and name the classes there are."""
    seen = {key[0]: int(count) for key, count in counts.items() if isinstance(key, tuple)}
    for key in CLASS_KEYS:
        configured = settings[key]
        if seen and not {*map(str.lower, seen)} & {*map(str.lower, configured)}:
            raise InputError(
                f"{settings['path']}, {key}",
                seen="vehicles of the classes " + ", ".join(f"{name} ({n:,})" for name, n in seen.items()),
                expected=f"some of the configured classes {', '.join(configured)}",
                change="State the class of each vehicle in the recordings."
                if [*seen] == ["none"]
                else f"State the classes of your recordings in {key} of the section of this source.",
            )


def cut_ins_of(
    found: Sequence[pd.DataFrame],
    counts: Mapping[str, float],
    settings: Mapping[str, Any],
    warnings: Sequence[str] = (),
) -> pd.DataFrame:
    """Return the cut-ins among the changes of lane of all recordings, with the account and the exposure.

    ``found`` are the results of `changes_of_lane` with the column ``recording``, and ``counts`` its counts,
    added up. Each cut-in has its state in the first frame in the new lane, and ``recording``, ``time`` [s],
    ``vehicle`` and ``host``, which locate it. The attributes are those of `recordings.cut_ins.finished`.
    InputError is raised if no vehicle has one of the configured classes.
    """
    require_classes(counts, settings)
    account = _account(counts)
    candidates = with_names(pd.concat(found), "recording {recording} vehicle {vehicle} at {time:g} s")
    cut_ins = drop_in_turn(candidates, _reasons(settings), account)
    return finished(cut_ins[list(OUTPUT)], account, counts, warnings, settings["path"])


def _account(counts: Mapping[str, float]) -> Account:
    """Begin the account with the rows that are not the first frame of a vehicle in a lane."""
    read, incomplete, used, stays = (int(counts[name]) for name in ("read", "incomplete", "used", "stays"))
    account = Account(read)
    account.enter(incomplete, step="read", reason="a missing or infinite value, or in no lane")
    account.enter(
        read - incomplete - used, step=TRACKING, reason="the same vehicle in the same frame once more"
    )
    account.enter(used - stays, step="lane", reason="no first frame of a vehicle in a lane")
    return account


def _reasons(settings: Mapping[str, Any]) -> dict[tuple[str, str], str]:
    """Return the reasons why a first frame in a lane is not a cut-in, in the order of their application."""
    return {
        ("lane", "in the lane when first seen"): "first_lane",
        (
            "lane",
            f"position that jumps by more than {JUMP:g} m, as of another vehicle with the same number",
        ): "jumped",
        ("lane", f"in the lane for less than {settings['rule']['stay']:g} s"): "brief",
        ("class", "not of the classes in lead_classes"): "other_lead",
        ("host", "no vehicle behind in the new lane"): "without_host",
        ("host", "the vehicle that is named as behind is not behind in the same lane"): "elsewhere",
        ("host", "the vehicle behind is not of the classes in host_classes"): "other_host",
        (
            "host",
            f"the vehicle behind came into the lane less than {settings['settled']:g} s before",
        ): "unsettled",
        ("range", "range not above 0"): "overlaps",
    }
