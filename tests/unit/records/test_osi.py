"""Cut-ins in traces of ASAM OSI: planted ones are found, lanes change their numbers, bad input is told."""

import copy
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import SOURCES, InputError, cli
from accelerated_evaluation.records.sources import record_files
from accelerated_evaluation.study.configuration import load

betterosi = pytest.importorskip("betterosi", reason="betterosi, the extra 'osi', is not installed")
ROOT = Path(__file__).resolve().parents[3]
sys.path.append(str(ROOT / "benchmarks" / "recordings"))

import osi_trace  # noqa: E402
import trajectories  # noqa: E402


def extract(folder, source="osi", **changes):
    settings = copy.deepcopy(load([])["data"][source]) | {"path": str(folder)} | changes
    return SOURCES[source].read(settings)


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """Return the tracks of a recording in the format of highD, and its planted cut-ins."""
    folder = tmp_path_factory.mktemp("highd")
    planted = trajectories.write_recordings(folder, 1, 12, np.random.default_rng(3))
    return next(folder.glob("*_tracks.csv")), planted


@pytest.fixture(scope="module")
def traces(recording, tmp_path_factory):
    folder = tmp_path_factory.mktemp("osi")
    osi_trace.write_trace(recording[0], folder / "01.mcap")
    return folder


def agree(found, planted):
    both = planted.merge(found, on=["vehicle", "host"], suffixes=("", "_found"))
    values = ["time", "lead_speed", "range", "closing_speed"]
    same = all(np.allclose(both[name], both[f"{name}_found"], atol=2e-4, rtol=0) for name in values)
    return same and len(both) == len(planted) == len(found)


def test_planted_cut_ins_are_found_on_a_turned_road_whose_lanes_change_their_numbers(traces, recording):
    found = extract(traces)
    assert len(recording[1]) >= 5
    assert set(recording[1]["vehicle"] % 4) == {0, 2}  # of both directions
    assert agree(found, recording[1])
    assert set(found["recording"]) == {"01"}
    by_highd = extract(recording[0].parent, "highd")
    assert found.attrs["exposure"] == pytest.approx(by_highd.attrs["exposure"], rel=1e-6)
    assert found.attrs["account"][-1]["rows_kept"] == len(found)


@pytest.mark.parametrize("wrong", [{"settled": 0}, {"host_classes": ["CAR", "HEAVY_TRUCK"]}], ids=str)
def test_a_rule_without_one_of_its_parts_invents_cut_ins(traces, recording, wrong):
    assert not agree(extract(traces, **wrong), recording[1])


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """Return a recording of some pairs that is soon read."""
    folder = tmp_path_factory.mktemp("short")
    planted = trajectories.write_recordings(folder, 1, 2, np.random.default_rng(3))
    return next(folder.glob("*_tracks.csv")), planted


def test_the_binary_format_and_the_older_field_of_the_lane_are_read_too(short, tmp_path):
    osi_trace.write_trace(short[0], tmp_path / "01_gt.osi", lanes="older", angle=-2.0)
    assert agree(extract(tmp_path), short[1])


@pytest.mark.parametrize("lanes", ["centre lines", "map", "file"])
def test_lanes_follow_from_centre_lines_or_from_a_map(short, tmp_path, lanes):
    osi_trace.write_trace(short[0], tmp_path / "01.mcap", lanes=lanes, angle=2.5)
    assert agree(extract(tmp_path), short[1])


def test_lanes_that_only_one_side_names_are_joined_where_their_centre_lines_meet(short, tmp_path):
    osi_trace.write_trace(short[0], tmp_path / "01.mcap", lanes="centre lines", one_sided=True)
    assert agree(extract(tmp_path), short[1])
    osi_trace.write_trace(short[0], tmp_path / "01.mcap", one_sided=True)  # without centre lines
    assert not agree(extract(tmp_path), short[1])


def test_lanes_that_are_not_joined_lose_cut_ins_or_invent_them(short, tmp_path):
    osi_trace.write_trace(short[0], tmp_path / "01.mcap", joined=False)
    reasons = {line["reason"]: line["rows_in"] for line in extract(tmp_path).attrs["account"]}
    osi_trace.write_trace(short[0], tmp_path / "01.mcap")
    joined = {line["reason"]: line["rows_in"] for line in extract(tmp_path).attrs["account"]}
    assert reasons["in the lane when first seen"] > joined["in the lane when first seen"]


def test_a_study_counts_the_content_of_traces(traces):
    assert record_files({"path": str(traces)}) == [str(traces / "01.mcap")]


def test_the_command_extracts_a_table(traces, recording, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("osi.yaml").write_text(f"data: {{source: osi, osi: {{path: {traces}}}}}\n")
    assert cli.main(["extract", "osi.yaml", "cut_ins.csv"]) == 0
    assert agree(pd.read_csv("cut_ins.csv"), recording[1])


# ---------------------------------------------------------------- bad input


def one_message(folder, **changes):
    """Write a trace of one vehicle that drives on at 30 m/s."""
    with betterosi.Writer(str(folder / "a.mcap")) as writer:
        for frame in range(50):
            row = {"id": 1, "x": 1.2 * frame, "y": 0.0, "width": 4.0, "xVelocity": 30.0, "laneId": 1}
            row |= {"drivingDirection": 2, "class_": "Car"} | changes
            moving = osi_trace.vehicle(pd.Series(row), 0.0, changes.get("field", "newer"))
            moving.base.orientation.yaw += changes.get("yaw", 0.0)
            if "without" in changes:
                setattr(moving.base, changes["without"], None)
            stamp = betterosi.Timestamp(seconds=frame // 25, nanos=40_000_000 * (frame % 25))
            objects = [moving]
            if "parked" in changes:
                parked = row | {"id": 2, "xVelocity": 0.0, "x": changes["parked"]}
                objects.append(osi_trace.vehicle(pd.Series(parked), 0.0, None))
            writer.add(betterosi.GroundTruth(timestamp=stamp, moving_object=objects))


def test_a_vehicle_in_no_lane_is_counted_as_such(tmp_path):
    one_message(tmp_path, parked=100.0)
    account = extract(tmp_path).attrs["account"]
    assert [(line["rows_in"], line["rows_dropped"]) for line in account[:3]] == [(100, 50), (50, 0), (50, 49)]
    assert account[0]["reason"] == "a missing or infinite value, or in no lane"


def test_a_vehicle_alone_and_a_message_without_one_are_no_errors(tmp_path):
    one_message(tmp_path)
    with betterosi.Writer(str(tmp_path / "b_gt.osi")) as writer:
        writer.add(betterosi.GroundTruth(timestamp=betterosi.Timestamp(seconds=1)))
    with pytest.raises(InputError, match=r"b_gt\.osi: seen 0 positions of vehicles"):
        extract(tmp_path)
    (tmp_path / "b_gt.osi").unlink()
    assert extract(tmp_path).empty


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"field": None},
            r"a\.mcap: seen 50 positions of .*, of which none is complete: a lane is missing in 50;",
        ),
        (
            {"without": "orientation"},
            r"none is complete: orientation is missing in 50; .*and either assigned_lane_id, or",
        ),
        ({"without": "velocity"}, "of which none is complete: velocity is missing in 50;"),
        ({"yaw": 90.0}, r"a\.mcap: seen the velocities along orientation\.yaw .* in the ratio -0\.448"),
        ({"xVelocity": 108.0}, r"a\.mcap: seen changes of position .* in the ratio 0\.278"),
    ],
)
def test_traces_that_contradict_themselves_or_have_no_lanes_are_refused(tmp_path, changes, message):
    one_message(tmp_path, **changes)
    with pytest.raises(InputError, match=message):
        extract(tmp_path)


def test_objects_without_a_type_are_named_as_the_cause(tmp_path):
    unknown = betterosi.MovingObject(id=betterosi.Identifier(value=1), base=betterosi.BaseMoving())
    with betterosi.Writer(tmp_path / "b.mcap") as writer:
        stamp = betterosi.Timestamp(seconds=1)
        writer.add(betterosi.GroundTruth(timestamp=stamp, moving_object=[unknown]))
    with pytest.raises(InputError, match="1 are of objects whose type is not VEHICLE, or that have no base"):
        extract(tmp_path)


def test_files_that_cannot_be_read_are_told(tmp_path):
    with pytest.raises(InputError, match="seen no file"):
        extract(tmp_path)
    with pytest.raises(InputError, match="seen no such folder"):
        extract(tmp_path / "nowhere")
    (tmp_path / "a.mcap").write_bytes(b"no trace at all")
    with pytest.raises(InputError, match=r"a\.mcap: seen \w+: .*expected a complete OSI trace"):
        extract(tmp_path)
    one_message(tmp_path)
    whole = (tmp_path / "a.mcap").read_bytes()
    (tmp_path / "a.mcap").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match=r"a\.mcap: seen"):
        extract(tmp_path)


@pytest.mark.parametrize(("library", "extra"), [("betterosi", "osi"), ("duckdb", "recordings")])
def test_a_missing_library_is_told(tmp_path, monkeypatch, library, extra):
    """Both are optional; only recordings need a database."""
    one_message(tmp_path)
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(Exception, match=rf"pip install 'accelerated-evaluation\[{extra}\]'"):
        extract(tmp_path)


def write_trace(path, frames, rate=10, **lanes):
    """Write a trace; a frame is a list of vehicles, each a mapping of what differs from a car at 0 m."""
    car = {"y": 0.0, "width": 4.0, "xVelocity": 0.0, "laneId": 1, "drivingDirection": 2, "class_": "Car"}
    pieces = osi_trace.lane_pieces({1: 0.0, 2: 3.5}, 4, **lanes)
    with betterosi.Writer(str(path)) as writer:
        for number, rows in enumerate(frames):
            made = []
            for row in rows:
                one = osi_trace.vehicle(pd.Series(car | row), 0.0, row.get("field", "newer"))
                if "assigned" in row:
                    one.moving_object_classification = betterosi.MovingObject.MovingObjectClassification(
                        assigned_lane_id=[osi_trace.number(lane) for lane in row["assigned"]],
                        assigned_lane_percentage=row["shares"],
                    )
                made.append(one)
            stamp = betterosi.Timestamp(seconds=number // rate, nanos=10**9 // rate * (number % rate))
            writer.add(betterosi.GroundTruth(timestamp=stamp, moving_object=made, lane=pieces))


@pytest.mark.parametrize("turned", [False, True])
def test_of_two_assigned_lanes_the_one_with_the_larger_percentage_counts(tmp_path, turned):
    """OSI pull request 599: a car on the marking is assigned to both lanes, in either order."""

    def lead(frame):
        own = min(max((frame - 10) / 21, 0), 1)  # share in the lane of the host, above half from frame 21
        order = slice(None, None, -1 if turned else 1)
        lanes, shares = [200, 100][order], [100 - 100 * own, 100 * own][order]
        return {"id": 2, "x": 40.0 + 2.5 * frame, "xVelocity": 25.0, "assigned": lanes, "shares": shares}

    def host(frame):
        return {"id": 1, "x": 3.0 * frame, "xVelocity": 30.0, "assigned": [100], "shares": [100]}

    write_trace(tmp_path / "a.mcap", [[host(frame), lead(frame)] for frame in range(50)])
    (found,) = extract(tmp_path).to_dict("records")
    assert found["time"] == pytest.approx(2.1)
    assert found["range"] == pytest.approx(40 + 2.5 * 21 - 3 * 21 - 4)
    assert found["closing_speed"] == pytest.approx(5.0)


@pytest.mark.parametrize("size", [0.02, 0.2])
def test_a_standing_car_that_jitters_on_a_marking_does_not_cut_in(tmp_path, size):
    """SMARTS issue 1214: the lane of a standing car flips for 1 to 4 frames, 10 a second."""
    generator = np.random.default_rng(3)
    flips = np.repeat(np.arange(60) % 2, generator.integers(1, 5, 60))[:80]
    y = 1.75 + size * np.where(flips, 1.0, -1.0)
    host = {"id": 1, "width": 4.0, "xVelocity": 10.0, "field": None}
    car = {"id": 2, "x": 200.0, "field": None}
    frames = [[host | {"x": 1.0 * frame}, car | {"y": y[frame]}] for frame in range(80)]
    write_trace(tmp_path / "a.mcap", frames, angle=0.0)
    assert extract(tmp_path).empty
    rule = {"rule": {"gap": 0.1, "absence": 0.0, "stay": 0.0}}
    assert not extract(tmp_path, **rule).empty  # without the rule for stays, it cuts in again
