"""Recordings that others wrote: columns with another meaning, identifiers, trailers, and missing parts."""

import sys
from functools import partial
from pathlib import Path

import pandas as pd
import pytest
from accelerated_evaluation import InputError
from drone_checks import MOMENT, RATE
from drone_checks import extract as extract_from

ROOT = Path(__file__).resolve().parents[3]
sys.path.append(str(ROOT / "benchmarks" / "recordings"))

highd = partial(extract_from, "highd")
CAR, TRUCK, GAP = 4.5, 12.0, 20.0  # [m]
LEFT, RIGHT = 2, 3  # lanes
MARKS = {"orientation": 0.0, "yaw_rate": 0.0, "ego_offset": 0.1}  # columns that only AD4CHE has


def recording(
    folder,
    *,
    centre=False,
    to_left=False,
    bumper=None,
    names=("Car", "Truck"),
    distance=None,
    lead_class=None,
    **more,
):
    """Write a car at 30 m/s and a truck at 27 m/s that comes into its lane, 20 m ahead, in highD's format.

    ``distance`` says what the column dhw contains: the gap, the distance to the front of the truck (front),
    or the difference of the positions x, as in highD. The position is the left end of a vehicle, its centre,
    or its front, rear or rear axle (bumper).
    """
    rows = []
    for frame in range(150):
        time = (frame - MOMENT) / RATE
        front, rear = 200 + 30 * time, 200 + GAP + 27 * time
        ends = {1: (front - CAR, CAR), 2: (rear, TRUCK)}
        ends = {of: (600 - x - length if to_left else x, length) for of, (x, length) in ends.items()}
        share = {None: centre / 2, "front": 1 - to_left, "rear": to_left, "axle": abs(to_left - 0.2)}[bumper]
        x = {of: end + share * length for of, (end, length) in ends.items()}
        follows, gap = frame >= MOMENT, rear - front
        dhw = {"gap": gap, "front": gap + TRUCK, "difference": abs(x[1] - x[2]), "feet": gap / 0.3048}
        for of, (_, length) in ends.items():
            speed = 30.0 if of == 1 else 27.0
            row = {"frame": frame + 1, "id": of, "x": x[of], "width": length}
            row |= {
                "xVelocity": -speed if to_left else speed,
                "laneId": RIGHT if of == 1 or follows else LEFT,
            }
            row |= {
                "followingId": 1 if of == 2 and follows else 0,
                "precedingId": 2 if of == 1 and follows else 0,
            }
            ahead = of == 1 and follows
            if distance:
                row |= {"dhw": dhw[distance] if ahead else 0.0, "thw": dhw[distance] / 30 if ahead else 0.0}
                row |= {"ttc": dhw[distance] / 3 if ahead else 0.0}
            rows.append(row | more)
    folder.mkdir(exist_ok=True)
    pd.DataFrame(rows).to_csv(folder / "01_tracks.csv", index=False, float_format="%.4f")
    meta = {"id": [1, 2], "class": names, "drivingDirection": 1 if to_left else 2}
    pd.DataFrame(meta).to_csv(folder / "01_tracksMeta.csv", index=False)
    pd.DataFrame({"id": [1], "frameRate": [RATE]}).to_csv(folder / "01_recordingMeta.csv", index=False)
    return folder


@pytest.mark.parametrize("to_left", [False, True])
@pytest.mark.parametrize("distance", [None, "gap", "front", "difference"])
def test_ad4che_has_the_centre_of_the_box_and_classes_in_lower_case(tmp_path, distance, to_left):
    folder = recording(
        tmp_path, centre=True, to_left=to_left, names=("car", "truck"), distance=distance, **MARKS
    )
    found = highd(folder)
    assert found["range"].tolist() == pytest.approx([GAP], abs=1e-3)
    assert found["closing_speed"].tolist() == [3.0]
    assert found.attrs["exposure"]["hours"] > 0
    assert found.attrs["warnings"] == []


@pytest.mark.parametrize("to_left", [False, True])
@pytest.mark.parametrize("centre", [False, True])
@pytest.mark.parametrize("distance", ["gap", "front"])
def test_the_distances_in_the_file_say_what_a_position_is(tmp_path, centre, distance, to_left):
    folder = recording(tmp_path, centre=centre, to_left=to_left, distance=distance)
    assert highd(folder)["range"].tolist() == pytest.approx([GAP], abs=1e-3)
    wrong = recording(tmp_path / "none", centre=True, to_left=to_left)  # nothing shows that it is no highD
    assert highd(wrong)["range"].tolist() == pytest.approx([GAP + (-1) ** to_left * 3.75], abs=1e-3)


@pytest.mark.parametrize("to_left", [False, True])
@pytest.mark.parametrize("marks", [{}, MARKS])
@pytest.mark.parametrize(("bumper", "distance"), [("front", "gap"), ("rear", "gap"), ("rear", "front")])
def test_the_distances_show_that_a_position_is_a_bumper(tmp_path, to_left, marks, distance, bumper):
    folder = recording(tmp_path, bumper=bumper, to_left=to_left, distance=distance, **marks)
    assert highd(folder)["range"].tolist() == pytest.approx([GAP], abs=1e-3)


def test_classes_in_lower_case_without_anything_that_shows_what_a_position_is_are_refused(tmp_path):
    folder = recording(tmp_path, centre=True, names=("car", "truck"))
    with pytest.raises(
        InputError, match=r"01_tracks\.csv, column x: seen classes in lower case \(car, truck\)"
    ):
        highd(folder)
    assert len(highd(recording(tmp_path, centre=False, distance="difference"))) == 1


def test_distances_that_contradict_the_positions_are_reported(tmp_path):
    for more in ({"distance": "feet"}, {"distance": "gap", "bumper": "axle"}):
        with pytest.raises(InputError, match=r"01_tracks\.csv, column dhw: seen distances that differ by "):
            highd(recording(tmp_path, **more))
    faster = recording(tmp_path, centre=False, distance="gap", thw=9.0, ttc=0.1)
    warnings = highd(faster).attrs["warnings"]
    assert [warning.split(" of ")[0] for warning in warnings] == ["01_tracks.csv: thw", "01_tracks.csv: ttc"]


@pytest.mark.parametrize("key", ["host_classes", "lead_classes"])
def test_a_filter_that_leaves_no_vehicle_names_the_classes_there_are(tmp_path, key):
    folder = recording(tmp_path, centre=False)
    expected = rf"{key}: seen vehicles of the classes Car \(1\), Truck \(1\); expected .* Van\. State"
    with pytest.raises(InputError, match=expected):
        highd(folder, **{key: ["Van"]})
    assert len(highd(folder, **{key: ["Van", "CAR", "truck"]})) == 1  # the case of letters is ignored


def test_a_number_that_is_given_to_another_vehicle_is_no_cut_in(tmp_path):
    recording(tmp_path, centre=False)
    rows = pd.read_csv(tmp_path / "01_tracks.csv")
    other = rows[(rows["id"] == 2) & (rows["frame"] <= MOMENT)].index
    rows.loc[other, "x"] -= 150  # the vehicle in the other lane is another one, far behind
    rows.to_csv(tmp_path / "01_tracks.csv", index=False)
    found = highd(tmp_path)
    assert found.empty
    assert "position that jumps by more than 5 m" in str(found.attrs["account"])


# ---------------------------------------------------------------- ASAM OSI

betterosi = pytest.importorskip("betterosi", reason="betterosi, the extra 'osi', is not installed")
import osi_trace  # noqa: E402

osi = partial(extract_from, "osi")
TYPES = osi_trace.MOVING.VehicleClassification.Type
HUGE = 2**63 + 12345


def boxed(identifier, x, lane, *, speed, length=CAR, kind="CAR", trailer=None, base=()):
    """Return a moving object whose centre is at x [m]."""
    row = {"id": identifier, "x": x - length / 2, "y": 0.0, "width": length, "xVelocity": speed, "laneId": 1}
    made = osi_trace.vehicle(pd.Series(row | {"drivingDirection": 2, "class_": "Car"}), 0.0, None)
    assigned = [] if lane is None else [osi_trace.number(lane)]
    made.moving_object_classification = osi_trace.MOVING.MovingObjectClassification(assigned_lane_id=assigned)
    made.vehicle_classification.type = TYPES[kind]
    if trailer is not None:
        made.vehicle_classification.has_trailer = True
        made.vehicle_classification.trailer_id = osi_trace.number(trailer)
    for part, value in dict(base).items():
        setattr(made.base, part, value)
    return made


def write_trace(folder, objects_at, frames=150, **message):
    """Write a trace of 25 frames per second with the objects that a function returns for a time [s]."""
    with betterosi.Writer(str(folder / "a.mcap")) as writer:
        for frame in range(frames):
            nanoseconds = frame * 40_000_000
            stamp = betterosi.Timestamp(seconds=nanoseconds // 10**9, nanos=nanoseconds % 10**9)
            objects = objects_at((frame - MOMENT) / RATE)
            writer.add(betterosi.GroundTruth(timestamp=stamp, moving_object=objects, **message))
    return folder


def pair(time, identifiers=(1, 2), lanes=(10, 20), **of_lead):
    """Return a car at 30 m/s and a car at 27 m/s that comes into its lane at the time 0, 20 m ahead."""
    host = boxed(identifiers[0], 200 + 30 * time, lanes[1], speed=30.0)
    lead = boxed(identifiers[1], 200 + CAR + GAP + 27 * time, lanes[time >= 0], speed=27.0, **of_lead)
    return [host, lead]


@pytest.mark.parametrize("identifiers", [(1, 2), (2**53 + 1, 2**53 + 2), (HUGE, HUGE + 1), (5, 2**64 - 1)])
@pytest.mark.parametrize("lanes", [(10, 20), (HUGE, HUGE + 1)])
def test_identifiers_have_64_bits_without_a_sign(tmp_path, identifiers, lanes):
    found = osi(write_trace(tmp_path, lambda time: pair(time, identifiers, lanes)))
    assert found[["vehicle", "host"]].to_numpy().tolist() == [[identifiers[1], identifiers[0]]]
    assert found["range"].tolist() == pytest.approx([GAP])


@pytest.mark.parametrize("is_named", [True, False])
@pytest.mark.parametrize("kind", ["TRAILER", "SEMITRAILER"])
def test_a_trailer_belongs_to_its_truck(tmp_path, kind, is_named):
    """The lead is a tractor of 6 m with a trailer of 10 m behind it; the range ends at the trailer's rear."""

    def lorry(time, own=is_named):
        rear = 200 + CAR / 2 + GAP + 27 * time
        lane = 20 if time >= 0 else 10
        tractor = {"length": 6.0, "kind": "SEMITRACTOR", "trailer": 3 if own else None}
        trailer = boxed(3, rear + 5, 20 if time >= 0.4 else 10, speed=27.0, length=10.0, kind=kind)
        return [pair(time)[0], boxed(2, rear + 10.5 + 3, lane, speed=27.0, **tractor), trailer]

    found = osi(write_trace(tmp_path, lorry))
    assert found[["vehicle", "host"]].to_numpy().tolist() == [[2, 1]]
    assert found["range"].tolist() == pytest.approx([GAP])
    read = found.attrs["account"][0]["rows_in"]
    assert read == 2 * 150  # the trailer is no vehicle of its own


def test_the_host_may_have_a_trailer_and_a_trailer_may_be_alone(tmp_path):
    def caravan(time):
        host, lead = pair(time)
        host.vehicle_classification.has_trailer = True
        host.vehicle_classification.trailer_id = osi_trace.number(9)
        trailer = boxed(9, 200 + 30 * time - 6, 20, speed=30.0, length=5.0, kind="TRAILER")
        parked = boxed(8, 0.0, 30, speed=0.0, length=5.0, kind="TRAILER")
        return [trailer, host, lead, parked]

    found = osi(write_trace(tmp_path, caravan))
    assert found[["vehicle", "host"]].to_numpy().tolist() == [[2, 1]]
    assert found["range"].tolist() == pytest.approx([GAP])


def test_an_identifier_that_is_used_again_is_another_vehicle(tmp_path):
    """Number 2 drives in the other lane, is gone for two seconds, and appears in the lane of the host."""

    def reused(time):
        host, lead = pair(time)
        if time < -1:
            lead = boxed(2, 5000 + 27 * time, 10, speed=27.0)
        return [host] if -1 <= time < 1 else [host, lead]

    with_jump = osi(write_trace(tmp_path, reused))
    assert with_jump.empty
    seconds = 149 / RATE + 48 / RATE + 48 / RATE + 1 / RATE
    assert with_jump.attrs["exposure"]["hours"] * 3600 == pytest.approx(seconds, abs=0.1)
    assert with_jump.attrs["exposure"]["kilometres"] < 0.3

    def at_once(time):  # without an absence, far away, in the lane of the host
        host, lead = pair(time)
        return [host, lead if time >= 0 else boxed(2, 5000 + 27 * time, 10, speed=27.0)]

    assert osi(write_trace(tmp_path, at_once)).empty


def test_what_is_missing_is_named(tmp_path):
    boundary = betterosi.LaneBoundary(id=osi_trace.number(1))

    def without(time):
        return [boxed(1, 30 * time, None, speed=30.0, base={"velocity": None})]

    folder = write_trace(tmp_path, without, 20, lane_boundary=[boundary])
    expected = (
        r"none is complete: velocity is missing in 20, a lane is missing in 20 \(the lanes have boundaries"
    )
    with pytest.raises(InputError, match=expected):
        osi(folder)


def test_lengths_and_classes_that_cannot_be_used_are_refused(tmp_path):
    flat = {"dimension": betterosi.Dimension3d(length=0.0, width=2.0, height=1.5)}
    with pytest.raises(
        InputError, match=r"a\.mcap, dimension\.length of the vehicles: seen 1 vehicles with a l"
    ):
        osi(write_trace(tmp_path, lambda time: pair(time, base=flat)))

    def others(time):
        return [
            boxed(k, 30 * time + 50 * k, 1, speed=30.0, kind=kind) for k, kind in ((1, "OTHER"), (2, "BUS"))
        ]

    folder = write_trace(tmp_path, others)
    with pytest.raises(
        InputError, match=r"host_classes: seen vehicles of the classes BUS \(1\), OTHER \(1\)"
    ):
        osi(folder)


def test_two_recordings_in_one_file_are_refused_or_reported(tmp_path):
    """The numbers of their vehicles are equal, so that half of the rows would be left out silently."""
    tracks = pd.read_csv(recording(tmp_path) / "01_tracks.csv")
    both = pd.concat([tracks.assign(recordingId=1), tracks.assign(x=tracks["x"] + 200, recordingId=2)])
    both.drop(columns="recordingId").to_csv(tmp_path / "01_tracks.csv", index=False)
    (warning,) = highd(tmp_path).attrs["warnings"]
    assert warning.startswith(
        f"{len(tracks)} of {2 * len(tracks)} rows of the recordings have the number and"
    )
    both.to_csv(tmp_path / "01_tracks.csv", index=False)
    with pytest.raises(
        InputError, match=r"01_tracks\.csv, column recordingId: seen 2 recordings in one file"
    ):
        highd(tmp_path)
    tracks.assign(recordingId=1).to_csv(tmp_path / "01_tracks.csv", index=False)
    assert highd(tmp_path).attrs["warnings"] == []
