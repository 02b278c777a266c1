"""Made-up recordings in the format of exiD, with cut-ins that are known.

A recording is a motorway that bends, with two lanes and a lane of an entry in each direction. Every lane is a
row of lanelets; where the entry begins, those of two lanes overlap. Pairs of vehicles pass one after the
other, as in `trajectories`. Nothing here shares code with the extraction that it tests.
"""

from pathlib import Path

import numpy as np
import pandas as pd
from trajectories import CUT_IN, OTHERS, RATE, draw, main, make_pairs, planted_in, write_files

RADIUS = {1: 400.0, 2: 370.0}  # [m], of the middle of the left lane; direction 2 drives clockwise
BEGIN = -1.9  # [rad], the angle where the road begins, such that headings pass 360 degrees
LANE = 3.75  # [m], width
PIECE = 60.0  # [m], length of a lanelet
ENTRY = (120.0, 180.0)  # [m], where the lanelets of the right lane and the entry overlap
CROSSING = 5.0  # [s], from the middle of a lane to that of the next
FLICKERS, FAR, EMPTY = "flickers", "far", "empty_lane"
TRACKS = (
    "recordingId,trackId,frame,trackLifetime,xCenter,yCenter,heading,width,length,xVelocity,yVelocity,"
    "xAcceleration,yAcceleration,lonVelocity,latVelocity,lonAcceleration,latAcceleration,traveledDistance,"
    "latLaneCenterOffset,laneWidth,laneletId,laneChange,lonLaneletPos,laneletLength,leadDHW,leadDV,leadTHW,"
    "leadTTC,leadId,rearId,leftLeadId,leftRearId,leftAlongsideId,rightLeadId,rightRearId,rightAlongsideId,"
    "odrRoadId,odrSectionNo,odrLaneId"
)
TRACKS_META = "recordingId,trackId,initialFrame,finalFrame,numFrames,width,length,class"
RECORDING_META = (
    "recordingId,locationId,frameRate,speedLimit,weekday,startTime,duration,numTracks,numVehicles,numVRUs,"
    "latLocation,lonLocation,xUtmOrigin,yUtmOrigin,orthoPxToMeter"
)


def pair(kind: str, first: int, direction: int, start: float, generator: np.random.Generator) -> dict:
    """Make two vehicles: their ``tracks`` and ``meta``, and what is ``planted``, None if nothing is."""
    lane, other = ((0, 1), (1, 0), (1, 2))[generator.integers(3)]  # from the left; 2 is the entry
    lengths = generator.uniform(4, 5.5), generator.uniform(4, 18)  # of the host, of the other
    speeds, gap, moment = draw(kind, generator)
    gap = generator.uniform(150, 200) if kind == FAR else gap
    time = np.round(np.arange(0, 2 * moment, 1 / RATE), 6)
    change = int(np.searchsorted(time, moment - 1e-9))
    aside = _aside(kind, time, change, lane, other)
    distance = (gap + sum(lengths) / 2) * (-1 if kind == "cuts_behind" else 1)
    # Positions along the middle of the left lane, such that the gap is as drawn along the lane of the host,
    # and the speeds are those of the moment
    place = generator.uniform(150, 150 + PIECE)  # of the host at the moment
    ahead = place, place + distance * RADIUS[direction] / _radius(direction, -LANE * lane)
    along = [
        at + speed * RADIUS[direction] / _radius(direction, beside[change]) * (time - time[change])
        for at, speed, beside in zip(ahead, speeds, aside, strict=True)
    ]
    tracks = [_track(time, *way, direction) for way in zip(along, aside, strict=True)]
    for index, length in enumerate(lengths):
        tracks[index] |= {"trackId": first + index, "length": length}
        tracks[index] |= {"frame": np.rint((time + start) * RATE).astype(int)}
        tracks[index] |= _neighbours(first + 1 - index, along[1 - index] > along[index], *aside)
    classes = ["truck" if length > 8 else "car" for length in lengths]
    if kind == "host_is_a_truck":
        classes[0] = "truck"
    planted = None
    if kind in (CUT_IN, FLICKERS, FAR):
        frame = round((start + time[change]) * RATE)
        planted = (frame / RATE, speeds[1], gap, speeds[0] - speeds[1], first + 1, first)
    meta = [(first + index, *of) for index, of in enumerate(zip(lengths, classes, strict=True))]
    return {"tracks": [pd.DataFrame(track) for track in tracks], "meta": meta, "planted": planted}


def _neighbours(of: int, is_ahead: np.ndarray, *aside: np.ndarray) -> dict[str, np.ndarray]:
    """Return what says that the other vehicle, ``of``, is ahead or behind in the same lane; -1 if not."""
    one, two = (_lane(beside) for beside in aside)
    return {
        "leadId": np.where((one == two) & is_ahead, of, -1),
        "rearId": np.where((one == two) & ~is_ahead, of, -1),
    }


def _lane(aside: np.ndarray) -> np.ndarray:
    """Return the lane, counted from the left, of a position aside of the middle of the left lane."""
    return np.rint(-aside / LANE).astype(int)


def _aside(kind: str, time: np.ndarray, change: int, lane: int, other: int) -> list[np.ndarray]:
    """Return how far to the left of the left lane's middle the host and the other are [m], by frame."""
    middle, beside = -LANE * lane, -LANE * other

    def across(crossed: int) -> np.ndarray:
        """Return the way from the other lane to the lane, whose marking is behind first in a frame."""
        part = np.clip((time - time[crossed] + 0.5 / RATE) / CROSSING + 0.5, 0, 1)
        return beside + (middle - beside) * part**2 * (3 - 2 * part)

    host, way = np.full(time.size, middle), across(change)
    if kind == "keeps_lane":
        way = np.full(time.size, middle)
    elif kind == "returns":  # eight frames over the marking, by a tenth of a metre
        phase = np.clip((time - time[change] - 3.5 / RATE) / 2.2, -0.5, 0.5)
        way = beside + (middle - beside) * (0.5 + 0.1 / LANE) * (1 + np.cos(2 * np.pi * phase)) / 2
    elif kind == FLICKERS:  # two frames on the old side again
        way[change + 2 : change + 4] = (middle + beside) / 2 + 0.02 * np.sign(beside - middle)
    elif kind == EMPTY:
        host = np.full(time.size, beside)
    elif kind == "host_just_came":
        host = across(change - 10)
    return [host, way]


def _radius(direction: int, aside: np.ndarray | float) -> np.ndarray | float:
    """Return the radius [m] of what is to the left of the middle of the left lane by ``aside`` [m]."""
    return RADIUS[direction] - aside if direction == 1 else RADIUS[direction] + aside


def _track(time: np.ndarray, along: np.ndarray, aside: np.ndarray, direction: int) -> dict[str, object]:
    """Return the columns of one vehicle that follow from its way.

    Parameters
    ----------
    time
        By frame [s].
    along, aside
        Where it is: along the middle of the left lane, and to the left of that [m].
    direction
        1 drives with the turn of the angle, 2 against it.
    """
    lane, sign = _lane(aside), 1 if direction == 1 else -1
    radius, angle = _radius(direction, aside), BEGIN + sign * along / RADIUS[direction]
    forward = np.gradient(along, time) * radius / RADIUS[direction]
    sideways = np.gradient(aside, time)
    heading = angle + sign * np.pi / 2 + np.arctan2(sideways, forward)
    speed = np.hypot(forward, sideways)
    piece = np.floor(along / PIECE).astype(int)
    # In the overlap a vehicle is in the lanelets of both lanes, of which its own may be the second.
    shared = (along >= ENTRY[0]) & (along < ENTRY[1]) & (lane > 0)
    first, second = np.where(shared, 1, lane), 2
    ids = 1000 * direction + piece
    return {
        "trackLifetime": np.arange(time.size),
        "xCenter": radius * np.cos(angle),
        "yCenter": radius * np.sin(angle),
        "heading": np.degrees(heading) % 360,
        "xVelocity": speed * np.cos(heading),
        "yVelocity": speed * np.sin(heading),
        "lonVelocity": speed,
        "latVelocity": 0.0,
        "traveledDistance": along - along[0],
        "laneletId": _listed(ids + 100 * first, ids + 100 * second, shared, "d"),
        "latLaneCenterOffset": _listed(aside + LANE * first, aside + LANE * second, shared, ".4f"),
        "laneWidth": np.where(shared, f"{LANE};{LANE}", str(LANE)),
        "laneChange": np.diff(lane, prepend=lane[0]).astype(bool).astype(int),
        "lonLaneletPos": _listed(along % PIECE, along % PIECE, shared, ".4f"),
        "laneletLength": np.where(shared, f"{PIECE};{PIECE}", str(PIECE)),
    }


def _listed(first: np.ndarray, second: np.ndarray, shared: np.ndarray, form: str) -> list[str]:
    """Return the cells of a column that has two values where lanelets overlap."""
    return [
        f"{one:{form}};{two:{form}}" if both else f"{one:{form}}"
        for one, two, both in zip(first, second, shared, strict=True)
    ]


def write_recording(folder: Path, number: int, pairs: int, generator: np.random.Generator) -> pd.DataFrame:
    """Write the three files of one recording, and return the cut-ins that are planted in it, units SI."""
    made = make_pairs(pair, pairs, (*OTHERS, FLICKERS, FAR, EMPTY), 0, generator)
    for one in made:
        one["tracks"] = [track.assign(recordingId=number, width=2) for track in one["tracks"]]
        one["meta"] = [(*row, number, 2) for row in one["meta"]]
    recording = {"recordingId": number, "frameRate": RATE, "speedLimit": -1}
    names = {"tracks": TRACKS, "tracksMeta": TRACKS_META, "recordingMeta": RECORDING_META}
    known = ["trackId", "length", "class", "recordingId", "width"]
    write_files(folder / f"{number:02d}", made, recording, known, names, unknown=-1)
    return planted_in(made, f"{number:02d}")


if __name__ == "__main__":
    main("exiD", write_recording)
