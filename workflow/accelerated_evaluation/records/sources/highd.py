"""Trajectories of all vehicles on a section of road, in the CSV format of highD.

Each vehicle is treated as a host in turn.
"""

from collections.abc import Mapping
from typing import Any

import pandas as pd

from accelerated_evaluation.records.recordings import drone, trajectories
from accelerated_evaluation.records.recordings.database import whole
from accelerated_evaluation.records.recordings.own_distances import OwnColumns
from accelerated_evaluation.records.recordings.trajectories import trajectory_keys
from accelerated_evaluation.records.sources import source

# In highD `x` is the left end of the bounding box and `width` is its length along the road. Vehicles that
# drive to the left have their front at x. They have direction 1, but other data sets number directions
# otherwise, so that the change of x decides, and the number only for vehicles that stand still. AD4CHE
# has the same columns and three more, and its `x` is the centre of the box. In SUMO a position is the front.
LEFT_END, CENTRE = "left end of the bounding box", "centre of the bounding box"
AHEAD = "CASE WHEN m.to_left THEN h.x - f.x ELSE f.x - h.x END"
COLUMNS = ("frame", "id", "x", "width", "xVelocity", "followingId", "laneId")
FRAMES = trajectories.FRAMES.format(
    rows=f"""
        SELECT {whole("id", "id")} AS id, {whole("round(frame * 1000 / {rate})", "frame")} AS time, x, width,
            xVelocity AS velocity, {whole("followingId", "followingId")} AS host,
            {whole("laneId", "laneId")} AS lane, {{own}},
            row_number() OVER (PARTITION BY id, frame ORDER BY x, xVelocity, laneId) AS copy
        FROM tracks WHERE {{complete}}
    """
)
META = """
    CREATE OR REPLACE TEMP TABLE meta AS
    SELECT DISTINCT ON (id) id, coalesce(way < 0, drivingDirection = 1) AS to_left, trim(class) AS class
    FROM meta_file LEFT JOIN (SELECT id, nullif(sum(moved), 0) AS way FROM frames GROUP BY id) USING (id)
    ORDER BY id, to_left, class
"""
FORMAT = drone.Format(
    "highd",
    numbers=COLUMNS,
    texts=(),
    meta_numbers=("id", "drivingDirection"),
    complete="coalesce(" + " AND ".join(f"isfinite({column})" for column in COLUMNS) + ", FALSE)",
    frames=FRAMES,
    meta=META,
    readings={
        LEFT_END: f"{AHEAD} - CASE WHEN m.to_left THEN f.width ELSE h.width END",
        CENTRE: f"{AHEAD} - (f.width + h.width) / 2",
        "front of the vehicle": f"{AHEAD} - f.width",
        "rear of the vehicle": f"{AHEAD} - h.width",
    },
    own=OwnColumns("precedingId", "dhw", "thw", "ttc", length="width", difference="abs(f.x - h.x)"),
    same_lane="h.lane = f.lane",
    speeds=(
        "changes of x and xVelocity times the time between frames",
        "the columns x [m] and xVelocity [m/s], or frameRate in the file of the recording",
    ),
    relative=(frozenset({"orientation", "yaw_rate", "ego_offset"}), CENTRE),
)


@source(
    "highd",
    description="cut-ins in trajectories in the format of highD",
    files=drone.FILES,
    **trajectory_keys(["Car", "Truck"], ["Car"]),
)
def read(settings: Mapping[str, Any]) -> pd.DataFrame:
    """Return the cut-ins in recordings in the format of highD, for example those of AD4CHE.

    A vehicle that changes into another lane cuts in before the vehicle behind it in the new lane, the host.
    The exposure is the time and distance that all vehicles of the host classes drive while in view. The
    errors are those of `recordings.drone.read_recordings`.
    """
    return drone.read_recordings(settings, FORMAT)
