"""Traces of ASAM OSI, made of recordings in the format of highD, whose cut-ins are known."""

from pathlib import Path

import betterosi
import numpy as np
import pandas as pd

LANE_PIECE = 150.0  # [m], after which each lane goes on under another number
PIECES = {1: {}, 2: {}}
CLASS = {"Car": "CAR", "Truck": "HEAVY_TRUCK"}
MOVING = betterosi.MovingObject
LANE = betterosi.Lane


def number(value):
    return betterosi.Identifier(value=int(value))


def vector(x, y):
    return betterosi.Vector3d(x=float(x), y=float(y), z=0.0)


def lane_pieces(lanes, pieces, *, joined=True):
    """Return the lanes as OSI has them: each a chain of pieces, numbered 100 lane + piece."""
    made = []
    for lane in lanes:
        for piece in range(pieces):
            pairing = LANE.Classification.LanePairing()
            if joined and piece > 0:
                pairing.antecessor_lane_id = number(100 * lane + piece - 1)
            if joined and piece < pieces - 1:
                pairing.successor_lane_id = number(100 * lane + piece + 1)
            classification = LANE.Classification(lane_pairing=[pairing])
            made.append(LANE(id=number(100 * lane + piece), classification=classification))
    return made


def vehicle(row, angle, *, older=False):
    """Return one vehicle of a frame; the road is turned by an angle [rad]."""
    heading = angle + (np.pi if row.drivingDirection == 1 else 0.0)
    middle, speed = row.x + row.width / 2, abs(row.xVelocity)
    turned = np.cos(angle) * middle - np.sin(angle) * row.y, np.sin(angle) * middle + np.cos(angle) * row.y
    assigned = [number(100 * row.laneId + middle // LANE_PIECE)]
    made = MOVING(
        id=number(row.id),
        type=MOVING.Type.VEHICLE,
        base=betterosi.BaseMoving(
            dimension=betterosi.Dimension3d(length=row.width, width=2.0, height=1.5),
            position=vector(*turned),
            orientation=betterosi.Orientation3d(yaw=float(heading)),
            velocity=vector(speed * np.cos(heading), speed * np.sin(heading)),
        ),
        vehicle_classification=MOVING.VehicleClassification(
            type=MOVING.VehicleClassification.Type[CLASS[row.class_]]
        ),
    )
    if older:
        made.assigned_lane_id = assigned
    else:
        made.moving_object_classification = MOVING.MovingObjectClassification(assigned_lane_id=assigned)
    return made


def write_trace(tracks: Path, target: Path, *, angle=0.5, older=False, joined=True, rate=25):
    """Write the trace of a recording, as its tracks and their meta say."""
    meta = pd.read_csv(str(tracks).replace("_tracks.csv", "_tracksMeta.csv"))
    rows = pd.read_csv(tracks).merge(meta[["id", "class", "drivingDirection"]], on="id")
    rows = rows.rename(columns={"class": "class_"})
    lanes = lane_pieces(sorted(set(rows["laneId"])), 2 + int(rows["x"].max() // LANE_PIECE), joined=joined)
    with betterosi.Writer(str(target)) as writer:
        for frame, of_frame in rows.groupby("frame"):
            nanoseconds = round(frame * 1e9 / rate)
            message = betterosi.GroundTruth(
                timestamp=betterosi.Timestamp(seconds=nanoseconds // 10**9, nanos=nanoseconds % 10**9),
                moving_object=[vehicle(row, angle, older=older) for row in of_frame.itertuples()],
                lane=lanes if frame == rows["frame"].min() else [],
            )
            writer.add(message)
