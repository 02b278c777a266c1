"""Cut-ins in traces of ASAM OSI: planted ones are found, lanes change their numbers, bad input is told."""

import copy
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import cli
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.records.recordings.osi_lanes import joined_lanes
from accelerated_evaluation.records.sources import SOURCES, record_files
from accelerated_evaluation.study.configuration import load

betterosi = pytest.importorskip("betterosi", reason="betterosi, the extra 'osi', is not installed")
ROOT = Path(__file__).resolve().parents[2]
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
    osi_trace.write_trace(short[0], tmp_path / "01_gt.osi", older=True, angle=-2.0)
    assert agree(extract(tmp_path), short[1])


def test_lanes_that_are_not_joined_lose_cut_ins_or_invent_them(short, tmp_path):
    osi_trace.write_trace(short[0], tmp_path / "01.mcap", joined=False)
    reasons = {line["reason"]: line["rows_in"] for line in extract(tmp_path).attrs["account"]}
    osi_trace.write_trace(short[0], tmp_path / "01.mcap")
    joined = {line["reason"]: line["rows_in"] for line in extract(tmp_path).attrs["account"]}
    assert reasons["in the lane when first seen"] > joined["in the lane when first seen"]


def test_pieces_are_one_lane_where_nothing_splits_or_merges():
    def piece(number, before=(), after=()):
        pairing = betterosi.Lane.Classification.LanePairing
        ends = [pairing(antecessor_lane_id=osi_trace.number(each)) for each in before]
        ends += [pairing(successor_lane_id=osi_trace.number(each)) for each in after]
        classification = betterosi.Lane.Classification(lane_pairing=ends)
        return betterosi.Lane(id=osi_trace.number(number), classification=classification)

    chain = [piece(3, after=[1]), piece(1, before=[3], after=[2]), piece(2, before=[1], after=[5, 6])]
    split = [piece(5, before=[2], after=[7]), piece(6, before=[2])]
    turned = [piece(7, after=[5])]  # drawn against the direction of its neighbour
    assert joined_lanes([*chain, *split, *turned]) == {1: 1, 2: 1, 3: 1, 5: 5, 7: 5, 6: 6}
    assert joined_lanes([betterosi.Lane(id=osi_trace.number(4))]) == {}


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
            row = pd.Series(
                {"id": 1, "x": 1.2 * frame, "y": 0.0, "width": 4.0, "xVelocity": 30.0, "laneId": 1}
                | {"drivingDirection": 2, "class_": "Car"}
                | changes
            )
            moving = osi_trace.vehicle(row, 0.0)
            if changes.get("laneId") == 0:
                moving.moving_object_classification = betterosi.MovingObject.MovingObjectClassification()
            if "without" in changes:
                setattr(moving.base, changes["without"], None)
            stamp = betterosi.Timestamp(seconds=frame // 25, nanos=40_000_000 * (frame % 25))
            writer.add(betterosi.GroundTruth(timestamp=stamp, moving_object=[moving]))


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
        ({"laneId": 0}, r"a\.mcap: seen 50 positions of vehicles, of which none is complete"),
        ({"without": "orientation"}, r"of which none is complete; .*orientation and assigned_lane_id"),
        ({"without": "velocity"}, "of which none is complete"),
        ({"xVelocity": 108.0}, r"a\.mcap: seen changes of position .* in the ratio 0\.278"),
    ],
)
def test_traces_that_contradict_themselves_or_have_no_lanes_are_refused(tmp_path, changes, message):
    one_message(tmp_path, **changes)
    with pytest.raises(InputError, match=message):
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


def test_a_missing_library_is_told(tmp_path, monkeypatch):
    one_message(tmp_path)
    monkeypatch.setitem(sys.modules, "betterosi", None)
    with pytest.raises(Exception, match=r"install it with `pip install 'accelerated-evaluation\[osi\]'`"):
        extract(tmp_path)
