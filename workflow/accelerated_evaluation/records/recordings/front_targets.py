"""SQL queries that find changes into the path of the host, from the targets of a forward-looking sensor.

The tables ``targets`` and ``host`` contain a part of the recordings. The table ``frames`` contains the usable
targets, each with the vehicle to which it belongs. The table ``changes`` has one row for each time that a
vehicle comes into the path.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import pandas as pd

from accelerated_evaluation.records.recordings.cut_ins import milliseconds, stays_sql, track_sql

if TYPE_CHECKING:
    from duckdb import DuckDBPyConnection

# The sensor uses an obstacle number again for another vehicle. A track is a sequence of targets with one
# number and without a gap in time.
TRACKS = """
    CREATE OR REPLACE TEMP TABLE tracks AS
    SELECT * EXCLUDE (before, range_before, rate_before), range - range_before AS moved,
        (range_rate + rate_before) / 2 * (time - before) / 1000 AS reported,
        coalesce(time = before, FALSE) AS repeated,
        {since} AS since
    FROM (
        SELECT * EXCLUDE (type, complete), lag(time) OVER one AS before, lag(range) OVER one AS range_before,
            lag(range_rate) OVER one AS rate_before
        FROM targets
        WHERE complete AND range > 0 AND list_contains({types}, type)
        WINDOW one AS (PARTITION BY device, trip, obstacle ORDER BY time, range, range_rate, side, in_path)
    )
"""

# Two tracks belong to one vehicle if the second one begins soon after the end of the first one, near the
# position that the last range and range rate of the first one predict. The two must be each other's best
# match. Ends and beginnings are joined by slices of time, so that the work does not grow with the square of
# the length of a trip.
LINKS = """
    CREATE OR REPLACE TEMP TABLE links AS
    WITH ends AS (
        SELECT device, trip, obstacle, since, max(time) AS until,
            arg_min(range, time) AS first_range, arg_min(side, time) AS first_side,
            arg_max(range, time) AS last_range, arg_max(range_rate, time) AS last_rate,
            arg_max(side, time) AS last_side
        FROM tracks WHERE NOT repeated GROUP BY ALL
    ), sliced AS (
        SELECT *, unnest([until // {reach}, until // {reach} + 1]) AS slice FROM ends
    )
    SELECT a.device, a.trip, b.obstacle, b.since, a.obstacle AS earlier_obstacle, a.since AS earlier_since,
        abs(b.first_range - a.last_range - a.last_rate * (b.since - a.until) / 1000) AS error
    FROM sliced AS a JOIN ends AS b
        ON a.device = b.device AND a.trip = b.trip AND a.slice = b.since // {reach}
    WHERE b.since > a.until AND b.since - a.until <= {reach} AND abs(b.first_side - a.last_side) <= {side}
        AND error <= {range}
    QUALIFY row_number() OVER (PARTITION BY a.device, a.trip, a.obstacle, a.since
            ORDER BY error, b.since, b.obstacle) = 1
        AND row_number() OVER (PARTITION BY a.device, a.trip, b.obstacle, b.since
            ORDER BY error, a.until DESC, a.obstacle) = 1
"""

# The identifier of a vehicle is the obstacle number of its first track and the time at which it begins.
FRAMES = """
    CREATE OR REPLACE TEMP TABLE frames AS
    WITH RECURSIVE chains AS (
        SELECT device, trip, obstacle, since, earlier_obstacle AS vehicle, earlier_since AS seen FROM links
        UNION ALL
        SELECT c.device, c.trip, c.obstacle, c.since, l.earlier_obstacle, l.earlier_since
        FROM chains AS c JOIN links AS l
            ON c.device = l.device AND c.trip = l.trip AND c.vehicle = l.obstacle AND c.seen = l.since
    ), firsts AS (
        SELECT device, trip, obstacle, since, arg_min(vehicle, seen) AS vehicle, min(seen) AS seen
        FROM chains GROUP BY ALL
    )
    SELECT t.device, t.trip, t.time, t.range, t.range_rate, t.side, t.in_path,
        coalesce(f.vehicle, t.obstacle) AS vehicle, coalesce(f.seen, t.since) AS seen
    FROM tracks AS t LEFT JOIN firsts AS f USING (device, trip, obstacle, since)
    WHERE NOT t.repeated
"""

# Each change also has the vehicle that was in the path in the row before (``other``). If that vehicle was
# nearer, it may have uncovered this one by leaving the path.
CHANGES = """
    CREATE OR REPLACE TEMP TABLE changes AS
    WITH in_path AS (
        SELECT *, lag({{'vehicle': vehicle, 'seen': seen, 'time': time, 'range': range}})
            OVER (PARTITION BY device, trip ORDER BY time, range, vehicle) AS other
        FROM frames WHERE in_path
    ), stays AS ({stays})
    SELECT device, trip, vehicle, seen, stay, min(time) AS time, max(time) AS until,
        arg_min(range, time) AS range, arg_min(range_rate, time) AS range_rate,
        arg_min(other, time) AS other
    FROM stays GROUP BY device, trip, vehicle, seen, stay
"""

CANDIDATES = """
    WITH aside AS (
        SELECT c.device, c.trip, c.vehicle, c.seen, c.stay, max(abs(f.side)) AS aside
        FROM changes AS c JOIN frames AS f USING (device, trip, vehicle, seen)
        WHERE f.time BETWEEN c.time - {look_back} AND c.time GROUP BY ALL
    ), signals AS (
        SELECT device, trip, time FROM host WHERE signal
    )
    SELECT c.device, c.trip, c.vehicle, c.time, c.range, -c.range_rate AS closing_speed,
        h.speed AS host_speed, h.speed + c.range_rate AS lead_speed,
        c.time = c.seen AS found_in_path,
        c.until - c.time < {stay} AS brief,
        coalesce((c.other.vehicle <> c.vehicle OR c.other.seen <> c.seen) AND c.other.range < c.range
            AND c.time - c.other.time <= {gap}, FALSE) AS uncovered,
        aside < {aside} AS ahead,
        h.time IS NULL OR c.time - h.time > {host_gap} AS without_host,
        coalesce(c.time - s.time <= {signal}, FALSE) AS signalled,
        coalesce(h.speed + c.range_rate < 0, FALSE) AS oncoming
    FROM changes AS c JOIN aside USING (device, trip, vehicle, seen, stay)
        ASOF LEFT JOIN host AS h ON c.device = h.device AND c.trip = h.trip AND c.time >= h.time
        ASOF LEFT JOIN signals AS s ON c.device = s.device AND c.trip = s.trip AND c.time >= s.time
"""

COUNTS = """
    SELECT count(*) AS read,
        count(*) FILTER (NOT complete) AS incomplete,
        count(*) FILTER (complete AND range <= 0) AS without_range,
        count(*) FILTER (complete AND range > 0 AND NOT list_contains({types}, type)) AS other_type,
        (SELECT count(*) FROM tracks WHERE repeated) AS repeated,
        (SELECT count(*) FROM changes) AS changes,
        (SELECT coalesce(sum(moved * reported), 0) FROM tracks WHERE {steady}) AS moved,
        (SELECT coalesce(sum(reported * reported), 0) FROM tracks WHERE {steady}) AS reported
    FROM targets
"""
TYPES = "SELECT type, count(*) FROM targets WHERE complete AND range > 0 GROUP BY type ORDER BY type"
STEADY = (
    "NOT repeated AND time > since AND abs(moved) < 5"  # [m]; ranges that jump are not used to check units
)


def changes_into_path(
    connection: "DuckDBPyConnection", settings: Mapping[str, Any]
) -> tuple[pd.DataFrame, dict[str, float]]:
    """Return the changes into the path of the host in a part of the recordings, and counts for the account.

    The database has the tables ``targets`` (of the forward sensor) and ``host`` (speeds). The columns are
    those of the queries `CANDIDATES`, in SI units with times in milliseconds and a boolean column for each
    reason why a change is not a cut-in, and `COUNTS`.
    """
    rule, link = settings["rule"], settings["link"]
    types = [int(type_) for type_ in settings["target_types"]]
    gap = milliseconds(rule["gap"])
    since = track_sql(vehicle="device, trip, obstacle", rule=rule)
    connection.execute(TRACKS.format(since=since, types=types))
    reach = max(milliseconds(link["time"]), 1)
    connection.execute(LINKS.format(reach=reach, range=link["range"], side=link["transversal"]))
    connection.execute(FRAMES)
    stays = stays_sql("in_path", vehicle="device, trip, vehicle, seen", lane="in_path", rule=rule)
    connection.execute(CHANGES.format(stays=stays))
    candidates = CANDIDATES.format(
        gap=gap,
        stay=milliseconds(rule["stay"]),
        look_back=milliseconds(settings["aside"]["time"]),
        aside=settings["aside"]["transversal"],
        host_gap=milliseconds(settings["host_gap"]),
        signal=-1 if settings["turn_signal"] is None else milliseconds(settings["turn_signal"]),
    )
    found = connection.execute(candidates).df()
    counts = connection.execute(COUNTS.format(types=types, steady=STEADY)).df().iloc[0].to_dict()
    counts |= {(kind,): count for kind, count in connection.execute(TYPES).fetchall()}
    return found, counts
