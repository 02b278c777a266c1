"""Trajectories at motorway entries and exits in the CSV format of exiD.

In this format roads may bend, and lanes consist of pieces (lanelets).
"""

from collections.abc import Mapping
from typing import Any

import pandas as pd

from accelerated_evaluation.records.recordings import drone, trajectories
from accelerated_evaluation.records.recordings.database import whole
from accelerated_evaluation.records.recordings.own_distances import OwnColumns
from accelerated_evaluation.records.recordings.trajectories import trajectory_keys
from accelerated_evaluation.records.sources import source

NUMBERS = ("trackId", "frame", "xCenter", "yCenter", "heading", "length", "lonVelocity", "laneChange")
NEIGHBOURS = ("leadId", "rearId")  # -1, or empty, if there is none
# If lanelets overlap, a cell has a value for each of them, separated by semicolons. The vehicle is in the
# lane whose middle is nearest.
OFFSET = (
    "list_reduce(CAST(string_split(latLaneCenterOffset, ';') AS DOUBLE[]), "
    "lambda a, b: CASE WHEN abs(b) < abs(a) THEN b ELSE a END)"
)
COMPLETE = "coalesce(" + " AND ".join(f"isfinite({column})" for column in NUMBERS) + ", FALSE)"
COMPLETE += f" AND coalesce(isfinite({OFFSET}), FALSE) AND laneletId IS NOT NULL"
ROWS = f"""
    SELECT {whole("trackId", "trackId")} AS id, {whole("round(frame * 1000 / {rate})", "frame")} AS time,
        xCenter, yCenter, heading, length, lonVelocity AS velocity, laneChange, laneletId,
        {OFFSET} AS aside, {whole("rearId", "rearId")} AS host, {whole("leadId", "leadId")} AS lead, {{own}},
        row_number() OVER (PARTITION BY trackId, frame ORDER BY xCenter, yCenter, laneletId) AS copy
    FROM tracks WHERE {{complete}}
"""
# A lane continues from lanelet to lanelet, so a change of laneletId alone is not a change of lane. If the
# flag laneChange is set in several consecutive frames of one lanelet, they are one change.
CHANGED = "laneChange = 1 AND (lag(laneChange) OVER one = 0 OR laneletId <> lag(laneletId) OVER one)"
# If frames are missing, the flag may be missing, but the offset then leaps by the width of a lane. Where two
# lanes become one, it leaps by half of a width.
LEAP = 2.5  # [m]
# `lane` is the number of lanes by which the vehicle is further to the left than when it was first seen. In a
# change to the left, the vehicle is left of the middle of its lane before the change, and right of the middle
# of its new lane after the change. A vehicle that returns to a lane has the same number again, so that short
# absences can be recognised.
FRAMES = f"""
    CREATE OR REPLACE TEMP TABLE frames AS
    SELECT * EXCLUDE (side), sum(side) OVER one AS lane,
        sum(CAST(round(coalesce(moved, 0) * 1e6) AS BIGINT)) OVER one / 1e6 AS x
    FROM (
        SELECT * EXCLUDE (laneChange, laneletId, aside),
            (xCenter - lag(xCenter) OVER one) * cos(radians(heading))
                + (yCenter - lag(yCenter) OVER one) * sin(radians(heading)) AS moved,
            velocity * (time - lag(time) OVER one) / 1000 AS reported,
            CASE WHEN {CHANGED}
                THEN CASE WHEN aside < lag(aside) OVER one THEN 1 ELSE -1 END ELSE 0 END AS side,
            coalesce(laneChange <> 1 AND abs(aside - lag(aside) OVER one) > {LEAP}, FALSE) AS leapt
        FROM ({trajectories.TRACKED.format(rows=ROWS)}) WINDOW one AS (PARTITION BY id, seen ORDER BY time)
    )
    WINDOW one AS (PARTITION BY id, seen ORDER BY time)
"""
META = """
    CREATE OR REPLACE TEMP TABLE meta AS
    SELECT DISTINCT ON (trackId) trackId AS id, trim(class) AS class FROM meta_file ORDER BY trackId, class
"""
# The distance of two vehicles along the road is the length of the arc of a circle that has the headings of
# the vehicles as tangents. On a straight road this is the distance along the heading.
HALF = "radians((f.heading - h.heading + 540) % 360 - 180) / 2"  # half of the difference of headings [rad]
MEAN = f"(radians(h.heading) + {HALF})"
RANGE = f"""
    ((f.xCenter - h.xCenter) * cos{MEAN} + (f.yCenter - h.yCenter) * sin{MEAN})
    * CASE WHEN abs({HALF}) > 1e-6 THEN {HALF} / sin({HALF}) ELSE 1 END - (f.length + h.length) / 2
"""
FORMAT = drone.Format(
    "exid",
    numbers=(*NUMBERS, *NEIGHBOURS),
    texts=("laneletId", "latLaneCenterOffset"),
    meta_numbers=("trackId",),
    complete=COMPLETE,
    frames=FRAMES,
    meta=META,
    readings={
        "centre of the bounding box": RANGE,
        "front of the vehicle": f"{RANGE} + (h.length - f.length) / 2",
        "rear of the vehicle": f"{RANGE} + (f.length - h.length) / 2",
    },
    own=OwnColumns(
        "leadId",
        "leadDHW",
        "leadTHW",
        "leadTTC",
        length="length",
        difference=f"{RANGE} + (f.length + h.length) / 2",
    ),
    same_lane="h.lead = f.id",
    missed="leapt",
    speeds=(
        "changes of xCenter and yCenter along heading and lonVelocity times the time between frames",
        "the columns xCenter, yCenter [m], heading [degrees] and lonVelocity [m/s], or frameRate in the file "
        "of the recording",
    ),
)


@source(
    "exid",
    description="cut-ins in trajectories in the format of exiD",
    files=drone.FILES,
    **trajectory_keys(["car", "van", "truck"], ["car"]),
)
def read(settings: Mapping[str, Any]) -> pd.DataFrame:
    """Return the cut-ins in recordings in the format of exiD.

    A vehicle that changes into another lane cuts in before the vehicle behind it in the new lane, the host.
    The host is the vehicle that ``rearId`` names in the first frame in the new lane, provided that the
    ``leadId`` of the host names the vehicle that cuts in. The errors are those of
    `recordings.drone.read_recordings`.
    """
    return drone.read_recordings(settings, FORMAT)
