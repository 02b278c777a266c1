"""Made-up recordings in the format of highD, with cut-ins that are known.

A recording is a piece of a motorway with two lanes in each direction. Pairs of vehicles pass one after the
other: a host that keeps its lane, and a vehicle that comes over before it, or only seems to.
Nothing here shares code with the extraction that it tests.
"""

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

RATE = 25  # frames a second
LENGTH = 420.0  # [m], of the piece of road
PAUSE = 60.0  # [s] from one pair to the next of its direction, so that pairs never meet
LANES = {1: (2, 3), 2: (5, 6)}  # by direction; 1 drives to the left
HEIGHTS = {2: 10.0, 3: 14.0, 5: 22.0, 6: 26.0}
CUT_IN = "cut_in"
OTHERS = ("keeps_lane", "returns", "cuts_behind", "host_is_a_truck", "host_just_came", "overlaps")
TRACKS = (
    "frame,id,x,y,width,height,xVelocity,yVelocity,xAcceleration,yAcceleration,frontSightDistance,"
    "backSightDistance,dhw,thw,ttc,precedingXVelocity,precedingId,followingId,leftPrecedingId,leftAlongsideId,"
    "leftFollowingId,rightPrecedingId,rightAlongsideId,rightFollowingId,laneId"
)
TRACKS_META = (
    "id,width,height,initialFrame,finalFrame,numFrames,class,drivingDirection,traveledDistance,minXVelocity,"
    "maxXVelocity,meanXVelocity,minDHW,minTHW,minTTC,numLaneChanges"
)
RECORDING_META = (
    "id,frameRate,locationId,speedLimit,month,weekDay,startTime,duration,totalDrivenDistance,totalDrivenTime,"
    "numVehicles,numCars,numTrucks,upperLaneMarkings,lowerLaneMarkings"
)


def pair(kind: str, first: int, direction: int, start: float, generator: np.random.Generator) -> dict:
    """Make two vehicles: their ``tracks`` and ``meta``, and what is ``planted``, None if nothing is."""
    lane, other = generator.permutation(LANES[direction])
    lengths = generator.uniform(4, 5.5), generator.uniform(4, 18)  # of the host, of the other
    speeds, gap, moment = draw(kind, generator)
    # Positions of the fronts along the road, such that the gap is as drawn in the frame of the moment
    time = np.round(np.arange(0, 2 * moment, 1 / RATE), 6)
    change = int(np.searchsorted(time, moment - 1e-9))
    host = 80 + speeds[0] * (time - time[change]) + 100
    front = host[change] + gap + lengths[1] + speeds[1] * (time - time[change])
    lanes = [np.full(len(time), lane), np.where(np.arange(len(time)) >= change, lane, other)]
    if kind == "keeps_lane":
        lanes[1][:] = lane
    elif kind == "returns":
        lanes[1] = np.where(
            (np.arange(len(time)) >= change) & (np.arange(len(time)) < change + 8), lane, other
        )
    elif kind == "cuts_behind":
        front = host - lengths[0] - gap
    elif kind == "host_just_came":
        lanes[0][: max(change - 10, 1)] = other
    following = np.where((lanes[0] == lanes[1]) & (front > host), first, 0)
    tracks, meta = [], []
    for index, (position, speed, length, of) in enumerate(
        zip((host, front), speeds, lengths, lanes, strict=True)
    ):
        number = first + index
        behind = following if index else np.where((lanes[0] == lanes[1]) & (front < host), first + 1, 0)
        truck = (kind == "host_is_a_truck" and index == 0) or length > 8
        columns = {
            "frame": np.round((time + start) * RATE).astype(int),
            "id": number,
            # In direction 1 the road is walked from right to left.
            "x": position - length if direction == 2 else LENGTH - position,
            "y": np.where(of == of.min(), HEIGHTS[of.min()], HEIGHTS[of.max()]),
            "width": length,
            "height": 2.0,
            "xVelocity": speed if direction == 2 else -speed,
            "followingId": behind,
            "laneId": of,
        }
        tracks.append(pd.DataFrame(columns))
        meta.append((number, length, "Truck" if truck else "Car", direction))
    planted = None
    if kind == CUT_IN:
        frame = round((start + time[change]) * RATE)
        planted = (frame / RATE, speeds[1], gap, speeds[0] - speeds[1], first + 1, first)
    return {"tracks": tracks, "meta": meta, "planted": planted}


def draw(kind: str, generator: np.random.Generator) -> tuple[tuple[float, float], float, float]:
    """Draw the speeds of host and other [m/s], the gap [m] and the moment [s]."""
    other = generator.uniform(21, 44)
    gap = 5 + generator.exponential(25)
    closing = generator.exponential(0.045 * gap) if generator.random() < 0.7 else -generator.uniform(0, 3)
    moment = round(generator.uniform(3, 5) * RATE) / RATE
    return (other + min(closing, 12), other), -3.0 if kind == "overlaps" else gap, moment


def write_recording(folder: Path, number: int, pairs: int, generator: np.random.Generator) -> pd.DataFrame:
    """Write the three files of one recording, and return the cut-ins that are planted in it, units SI."""
    made = make_pairs(pair, pairs, OTHERS, 1, generator)
    recording = {"id": number, "frameRate": RATE, "speedLimit": -1, "numVehicles": 2 * pairs}
    recording |= {"upperLaneMarkings": "8;12;16", "lowerLaneMarkings": "20;24;28"}
    names = {"tracks": TRACKS, "tracksMeta": TRACKS_META, "recordingMeta": RECORDING_META}
    known = ["id", "width", "class", "drivingDirection"]
    write_files(folder / f"{number:02d}", made, recording, known, names, unknown=0)
    return planted_in(made, f"{number:02d}")


def write_files(
    path: Path,
    made: Sequence[dict],
    recording: dict,
    known: Sequence[str],
    names: dict[str, str],
    unknown: int,
) -> None:
    """Write the three files of a recording.

    Parameters
    ----------
    path
        Beginning of the names of the files.
    made
        The pairs.
    recording
        The row of the file of the recording.
    known
        Columns of the ``meta`` of a pair, the number of the vehicle first.
    names
        Columns of each file by the end of its name, divided by commas: of the vehicles in each frame, of the
        vehicles, and of the recording.
    unknown
        Value in the columns that no extraction reads.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    tracks = pd.concat([track for one in made for track in one["tracks"]])
    meta = pd.DataFrame([row for one in made for row in one["meta"]], columns=known)
    frames = tracks.groupby(known[0])["frame"].agg(initialFrame="min", finalFrame="max", numFrames="count")
    tables = tracks, meta.join(frames, on=known[0]), pd.DataFrame([recording])
    for (end, columns), table in zip(names.items(), tables, strict=True):
        whole = table.reindex(columns=columns.split(","), fill_value=unknown)
        whole.round(4).to_csv(f"{path}_{end}.csv", index=False)


def make_pairs(
    pair: Callable[..., dict], count: int, others: Sequence[str], first: int, generator: np.random.Generator
) -> list[dict]:
    """Make the pairs of a recording, in both directions in turn, of which three in five are cut-ins.

    Parameters
    ----------
    pair
        Makes one.
    count
        How many.
    others
        Kinds of pairs that are no plain cut-ins.
    first
        Number of the first vehicle, which is also its first frame.
    generator
        Draws the kind, and whatever `pair` draws.
    """
    return [
        pair(
            CUT_IN if generator.random() < 0.6 else generator.choice(others),
            first=first + 2 * index,
            direction=1 + index % 2,
            start=first / RATE + PAUSE * (index // 2),
            generator=generator,
        )
        for index in range(count)
    ]


def planted_in(made: Sequence[dict], recording: str) -> pd.DataFrame:
    """Return the cut-ins that are planted in the pairs of a recording, units SI."""
    columns = ["time", "lead_speed", "range", "closing_speed", "vehicle", "host"]
    planted = pd.DataFrame([one["planted"] for one in made if one["planted"]], columns=columns)
    return planted.assign(recording=recording)


def write_recordings(
    folder: Path,
    recordings: int,
    pairs: int,
    generator: np.random.Generator,
    write: Callable[..., pd.DataFrame] = write_recording,
) -> pd.DataFrame:
    """Write some recordings, numbered from 1, and return their planted cut-ins in the order of the files.

    Parameters
    ----------
    folder
        Where to.
    recordings, pairs
        How many recordings, and how many pairs of vehicles in each.
    generator
        Draws the pairs.
    write
        Writes one recording, in its format.
    """
    made = [write(folder, number, pairs, generator) for number in range(1, recordings + 1)]
    return pd.concat(made, ignore_index=True)


def main(name: str = "highD", write: Callable[..., pd.DataFrame] = write_recording) -> None:
    """Write recordings into a folder, with the cut-ins that are planted in them beside it."""
    parser = argparse.ArgumentParser(description=f"Write recordings in the format of {name}.")
    parser.add_argument("folder", type=Path, help="to write; FOLDER_planted.csv gets what is planted")
    parser.add_argument("--recordings", type=int, default=12, help="(default: %(default)s)")
    parser.add_argument("--pairs", type=int, default=400, help="a recording (default: %(default)s)")
    given = parser.parse_args()
    planted = write_recordings(
        given.folder, given.recordings, given.pairs, np.random.default_rng(2016), write
    )
    planted.to_csv(given.folder.with_name(f"{given.folder.name}_planted.csv"), index=False)


if __name__ == "__main__":
    main()
