"""Traces of ASAM OSI and omega-prime, made of recordings in the format of highD, whose cut-ins are known."""

from pathlib import Path

import betterosi
import numpy as np
import pandas as pd

LANE_PIECE = 150.0  # [m], after which each lane goes on under another number
LANE_WIDTH = 4.0  # [m]
CLASS = {"Car": "CAR", "Truck": "HEAVY_TRUCK"}
MOVING = betterosi.MovingObject
LANE = betterosi.Lane


def number(value):
    return betterosi.Identifier(value=int(value))


def vector(x, y):
    return betterosi.Vector3d(x=float(x), y=float(y), z=0.0)


def turned(x, y, angle):
    """Return a point after the road has been turned by an angle [rad]."""
    return np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y


def lane_pieces(heights, pieces, *, joined=True, one_sided=False, angle=None):
    """Return the lanes as OSI has them: each a chain of pieces, numbered 100 lane + piece.

    ``heights`` gives the place of each lane across the road [m]. With ``one_sided``, only the later of two
    pieces names the other. The lanes have centre lines if an ``angle`` is given.
    """
    made = []
    for lane, height in heights.items():
        for piece in range(pieces):
            pairing = LANE.Classification.LanePairing()
            if joined and piece > 0:
                pairing.antecessor_lane_id = number(100 * lane + piece - 1)
            if joined and piece < pieces - 1 and not one_sided:
                pairing.successor_lane_id = number(100 * lane + piece + 1)
            classification = LANE.Classification(
                lane_pairing=[pairing], type=LANE.Classification.Type.DRIVING
            )
            if angle is not None:
                ends = [turned(LANE_PIECE * end, height, angle) for end in (piece, piece + 1)]
                classification.centerline = [vector(*end) for end in ends]
            made.append(LANE(id=number(100 * lane + piece), classification=classification))
    return made


def open_drive(heights, pieces, angle):
    """Return an OpenDRIVE map of the same lanes: one road, whose lanes lie on the right of its reference."""
    top = max(heights.values()) + LANE_WIDTH / 2
    drawn = {round((top - height) / LANE_WIDTH + 0.5): "driving" for height in heights.values()}
    lanes = "".join(
        f"<lane id='{-place}' type='{drawn.get(place, 'none')}'>"
        f"<width sOffset='0' a='{LANE_WIDTH}' b='0' c='0' d='0'/>"
        f"<link><predecessor id='{-place}'/><successor id='{-place}'/></link></lane>"
        for place in range(1, max(drawn) + 1)
    )
    sections = "".join(
        f"<laneSection s='{LANE_PIECE * piece}'><right>{lanes}</right></laneSection>"
        for piece in range(pieces)
    )
    x, y = turned(0.0, top, angle)
    return (
        f"<OpenDRIVE><road id='1' length='{LANE_PIECE * pieces}'><planView>"
        f"<geometry s='0' x='{x}' y='{y}' hdg='{angle}' length='{LANE_PIECE * pieces}'><line/></geometry>"
        f"</planView><lanes>{sections}</lanes></road></OpenDRIVE>"
    )


def vehicle(row, angle, lane_field="newer"):
    """Return one vehicle of a frame; the road is turned by an angle [rad].

    ``lane_field`` is the field of its lane: newer, older or, for a vehicle that is assigned to none, None.
    """
    heading = angle + (np.pi if row.drivingDirection == 1 else 0.0)
    middle, speed = row.x + row.width / 2, abs(row.xVelocity)
    assigned = [number(100 * row.laneId + middle // LANE_PIECE)]
    made = MOVING(
        id=number(row.id),
        type=MOVING.Type.VEHICLE,
        base=betterosi.BaseMoving(
            dimension=betterosi.Dimension3d(length=row.width, width=2.0, height=1.5),
            position=vector(*turned(middle, row.y, angle)),
            orientation=betterosi.Orientation3d(yaw=float(heading)),
            velocity=vector(speed * np.cos(heading), speed * np.sin(heading)),
        ),
        vehicle_classification=MOVING.VehicleClassification(
            type=MOVING.VehicleClassification.Type[CLASS[row.class_]]
        ),
    )
    if lane_field == "older":
        made.assigned_lane_id = assigned
    elif lane_field == "newer":
        made.moving_object_classification = MOVING.MovingObjectClassification(assigned_lane_id=assigned)
    return made


def write_trace(
    tracks: Path, target: Path, *, angle=0.5, lanes="newer", joined=True, one_sided=False, rate=25
):
    """Write the trace of a recording, as its tracks and their meta say.

    ``lanes`` says how the lanes of vehicles are known: by a field (newer, older), or by ``centre lines``, an
    OpenDRIVE ``map`` within the trace, or one in a ``file`` next to it.
    """
    meta = pd.read_csv(str(tracks).replace("_tracks.csv", "_tracksMeta.csv"))
    rows = pd.read_csv(tracks).merge(meta[["id", "class", "drivingDirection"]], on="id")
    rows = rows.rename(columns={"class": "class_"})
    heights = rows.groupby("laneId")["y"].agg(lambda y: y.mode()[0]).to_dict()
    pieces = 2 + int(rows["x"].max() // LANE_PIECE)
    drawn_at = angle if lanes == "centre lines" else None
    drawn = lane_pieces(heights, pieces, joined=joined, one_sided=one_sided, angle=drawn_at)
    with betterosi.Writer(str(target)) as writer:
        if lanes == "map":
            content = open_drive(heights, pieces, angle)
            writer.add(
                betterosi.MapAsamOpenDrive(open_drive_xml_content=content),
                topic="ground_truth_map",
                log_time=0,
            )
        if lanes == "file":
            target.with_name("road.xodr").write_text(open_drive(heights, pieces, angle))
        for frame, of_frame in rows.groupby("frame"):
            nanoseconds = round(frame * 1e9 / rate)
            message = betterosi.GroundTruth(
                timestamp=betterosi.Timestamp(seconds=nanoseconds // 10**9, nanos=nanoseconds % 10**9),
                moving_object=[vehicle(row, angle, lanes) for row in of_frame.itertuples()],
                lane=drawn if frame == rows["frame"].min() and lanes not in ("map", "file") else [],
                map_reference="road.xodr" if lanes == "file" else "",
            )
            writer.add(message)
