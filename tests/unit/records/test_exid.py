"""Cut-ins in trajectories in the format of exiD: each choice of the rule, planted cut-ins, bad input."""

import math
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.records.recordings.drone import read_recordings
from accelerated_evaluation.records.sources import exid
from drone_checks import FRAMES, LENGTH, MOMENT, RATE, adds_up, damage, settings, stays
from drone_checks import agree as agree_within
from drone_checks import extract as extract_from

ROOT = Path(__file__).resolve().parents[3]
sys.path.append(str(ROOT / "benchmarks" / "recordings"))

import exits  # noqa: E402
import trajectories  # noqa: E402

extract = partial(extract_from, "exid")
HOST, LEAD = 0, 1  # numbers begin at 0 in this format
LANE, BESIDE = 1, 2  # counted from the left
HEADING = 300.0  # [degrees], of a straight road
COLUMNS = ["trackId", "frame", "xCenter", "yCenter", "heading", "length", "lonVelocity", "laneChange"]
COLUMNS += ["leadId", "rearId", "laneletId", "latLaneCenterOffset"]


def frames(of, *, front, speed, lane, lead, rear, flag=1, overlap=False, kept=range(FRAMES)):
    """The rows of one vehicle; `front` is how far along the road its front is at the moment."""
    rows = []
    for frame in kept:
        along = front + speed * (frame - MOMENT) / RATE - LENGTH / 2
        x, y = along * math.cos(math.radians(HEADING)), along * math.sin(math.radians(HEADING))
        here, before, after = lane(frame), lane(frame - 1), lane(frame + 1)
        offset = 1.8 * (here - after) + 1.8 * (here - before)  # to the left of the middle of its lane
        changed = any(lane(frame - k) != lane(frame - k - 1) for k in range(min(flag, frame)))
        lanelet = f"{100 * here + int(along // 60)}"
        if overlap:
            lanelet, offset = f"777;{lanelet}", f"3.2;{offset}"
        row = (of, frame, x, y, HEADING, LENGTH, speed, int(changed), lead(frame), rear(frame))
        rows.append((*row, lanelet, offset))
    return rows


def comes(frame):
    return LANE if frame >= MOMENT else BESIDE


def pair(gap=30.0, host_lane=lambda f: LANE, lane=comes, host=HOST, lead=LEAD, **values):
    """A host at 30 m/s, and a vehicle at 27 m/s that comes into its lane."""

    def ahead(frame):
        return lead if host_lane(frame) == lane(frame) else -1

    def behind(frame):
        return host if host_lane(frame) == lane(frame) else -1

    def nobody(frame):
        return -1

    at = {HOST: 200.0, LEAD: 200.0 + gap + LENGTH}
    return [
        *frames(HOST, front=at[HOST], speed=30.0, lane=host_lane, lead=ahead, rear=nobody, **values),
        *frames(LEAD, front=at[LEAD], speed=27.0, lane=lane, lead=nobody, rear=behind, **values),
    ]


CARS = {HOST: "car", LEAD: "car"}
# Rows and classes of a recording, and how many cut-ins it has with the settings of config.yaml
CASES = {
    "cut-in": (pair(), CARS, 1),
    "to the right": (pair(lane=stays((0, LANE - 1), (MOMENT, LANE))), CARS, 1),
    "follows its lane through its lanelets": (pair(lane=lambda f: LANE), CARS, 0),
    "flag stays up for five frames": (pair(flag=5), CARS, 1),
    "lanelets that overlap": (pair(overlap=True), CARS, 1),
    "stays 12 frames": (pair(lane=stays((0, BESIDE), (MOMENT, LANE), (MOMENT + 12, BESIDE))), CARS, 0),
    "stays 14 frames": (pair(lane=stays((0, BESIDE), (MOMENT, LANE), (MOMENT + 14, BESIDE))), CARS, 1),
    "lost for 0.48 s": (pair(kept=[*range(MOMENT - 11), *range(MOMENT, FRAMES)]), CARS, 1),
    "lost for 0.56 s": (pair(kept=[*range(MOMENT - 13), *range(MOMENT, FRAMES)]), CARS, 0),
    "back after 1 s": (pair(lane=stays((0, LANE), (MOMENT - 24, BESIDE), (MOMENT, LANE))), CARS, 0),
    "back after 1.2 s": (pair(lane=stays((0, LANE), (MOMENT - 30, BESIDE), (MOMENT, LANE))), CARS, 1),
    "back after 1 s, lanelets overlap": (
        pair(lane=stays((0, LANE), (MOMENT - 24, BESIDE), (MOMENT, LANE)), overlap=True),
        CARS,
        0,
    ),
    "over two lanes": (pair(lane=stays((0, 3), (MOMENT - 15, BESIDE), (MOMENT, LANE))), CARS, 1),
    "nobody behind": (pair(host=-1), CARS, 0),
    "nobody behind, by an empty cell": (pair(host=None), CARS, 0),
    "the one behind follows another": (pair(lead=7), CARS, 0),
    "host came 0.96 s before": (pair(host_lane=stays((0, 0), (MOMENT - 24, LANE))), CARS, 0),
    "host came 1 s before": (pair(host_lane=stays((0, 0), (MOMENT - 25, LANE))), CARS, 1),
    "van before a car": (pair(), {HOST: "car", LEAD: "van"}, 1),
    "motorcycle before a car": (pair(), {HOST: "car", LEAD: "motorcycle"}, 0),
    "car before a van": (pair(), {HOST: "van", LEAD: "car"}, 0),
    "beside each other": (pair(gap=-1.0), CARS, 0),
    "every row twice": (2 * pair(), CARS, 1),
}
NAMES = {f"{number:02d}": name for number, name in enumerate(CASES)}


def write(folder, cases=CASES, **tracks):
    """Write one recording for each case; ``tracks`` replaces its columns."""
    folder.mkdir(parents=True, exist_ok=True)
    for number, name in NAMES.items():
        if name not in cases:
            continue
        rows, classes, _ = CASES[name]
        table = pd.DataFrame(rows, columns=COLUMNS)
        table.assign(recordingId=int(number), **tracks).to_csv(folder / f"{number}_tracks.csv", index=False)
        meta = pd.DataFrame(classes.items(), columns=["trackId", "class"])
        meta.to_csv(folder / f"{number}_tracksMeta.csv", index=False)
        recording = pd.DataFrame({"recordingId": [int(number)], "frameRate": [RATE]})
        recording.to_csv(folder / f"{number}_recordingMeta.csv", index=False)
    return folder


@pytest.fixture(scope="module")
def cut_ins(tmp_path_factory):
    return extract(write(tmp_path_factory.mktemp("recordings")))


@pytest.mark.parametrize("name", CASES)
def test_each_case_is_as_many_cut_ins_as_it_should_be(cut_ins, name):
    assert (cut_ins["recording"].map(NAMES) == name).sum() == CASES[name][2]


@pytest.mark.parametrize("name", ["cut-in", "to the right", "lanelets that overlap", "over two lanes"])
def test_a_cut_in_has_the_values_of_its_first_frame_in_the_lane(cut_ins, name):
    row = cut_ins[cut_ins["recording"].map(NAMES) == name].iloc[0]
    assert row[["vehicle", "host"]].tolist() == [LEAD, HOST]
    expected = {"lead_speed": 27, "range": 30, "closing_speed": 3, "host_speed": 30, "time": MOMENT / RATE}
    assert row[list(expected)].astype(float).to_dict() == pytest.approx(expected, abs=1e-9)


def test_the_account_adds_up_and_says_why_a_change_of_lane_is_no_cut_in(cut_ins):
    assert adds_up(cut_ins, CASES)
    dropped = {line["reason"]: line["rows_dropped"] for line in cut_ins.attrs["account"]}
    assert dropped["the vehicle that is named as behind is not behind in the same lane"] == 1
    assert dropped["no vehicle behind in the new lane"] >= 2


# ---------------------------------------------------------------- planted cut-ins


@pytest.fixture(scope="module")
def generated(tmp_path_factory):
    folder = tmp_path_factory.mktemp("generated")
    generator = np.random.default_rng(3)
    return folder, trajectories.write_recordings(folder, 2, 50, generator, exits.write_recording)


# A vehicle between two lanes drives on another radius than its host, and is turned by two degrees: that makes
# up to 0.7 % of the range, and 0.05 m/s.
TOLERANCES = {"time": (0, 1e-6), "range": (0.007, 0.05), "lead_speed": (0, 0.05), "closing_speed": (0, 0.05)}
agree = partial(agree_within, tolerances=TOLERANCES)


def test_all_planted_cut_ins_are_found_in_both_directions_and_none_is_invented(generated):
    folder, planted = generated
    assert len(planted) > 50
    assert set(planted["vehicle"] % 4) == {1, 3}  # of both directions
    tracks = pd.read_csv(folder / "01_tracks.csv", usecols=["heading", "laneletId"], dtype={"laneletId": str})
    assert tracks["heading"].min() < 1
    assert tracks["heading"].max() > 359
    assert tracks["laneletId"].str.contains(";").any()
    assert agree(extract(folder), planted)


@pytest.mark.parametrize(
    ("right", "wrong"),
    [
        (exid.HALF, "0"),  # along the heading of the host
        ("(f.length + h.length) / 2", "0"),  # from middle to middle
    ],
)
def test_a_range_that_is_measured_in_another_way_does_not_agree(generated, right, wrong):
    folder, planted = generated
    assert right in exid.RANGE
    form = replace(exid.FORMAT, readings={"wrong": exid.RANGE.replace(right, wrong)})
    assert not agree(read_recordings(settings("exid", folder), form), planted)


def test_to_count_every_change_of_lanelet_invents_cut_ins(generated):
    folder, planted = generated
    statement = exid.FRAMES.replace(exid.CHANGED, "laneletId <> lag(laneletId) OVER one")
    found = read_recordings(settings("exid", folder), replace(exid.FORMAT, frames=statement))
    assert not agree(found, planted)
    both = found.merge(planted, on=["recording", "vehicle"], suffixes=("", "_planted"), how="left")
    invented = ~(abs(both["time"] - both["time_planted"]) < 0.5 / RATE)
    assert invented.sum() > 0.2 * len(planted)


def test_every_second_frame_lacks_changes_of_lane_which_is_warned_of(generated, tmp_path):
    for file in generated[0].glob("*.csv"):
        table = pd.read_csv(file, dtype=str)
        keep = table["frame"].astype(int) % 2 == 0 if "_tracks.csv" in file.name else slice(None)
        table[keep].to_csv(tmp_path / file.name, index=False)
    assert "changes of lane are not marked as such" in extract(tmp_path).attrs["warnings"][0]
    assert not extract(generated[0]).attrs["warnings"]


# ---------------------------------------------------------------- bad input


@pytest.mark.parametrize(
    ("name", "old", "new", "reported"),
    [
        ("00_tracks.csv", "rearId", "behindId", r"00_tracks\.csv, row 1: seen no column rearId"),
        ("00_tracks.csv", "laneletId", "lanelet", r"00_tracks\.csv, row 1: seen no column laneletId"),
        ("00_tracks.csv", "\n0,1,", "\n0,one,", r'00_tracks\.csv, row 3: .*"one"'),
        ("00_tracks.csv", ",1.8,", ",left,", r"00_tracks\.csv: seen Could not convert string 'left'"),
        ("00_tracksMeta.csv", "class", "kind", r"00_tracksMeta\.csv, row 1: seen no column class"),
        ("00_tracksMeta.csv", "\n1,car", "", r"00_tracksMeta\.csv: seen no row .* vehicle 1; .*00_tracks"),
        ("00_recordingMeta.csv", ",25", ",0", r"frameRate: seen 0\.0"),
        ("00_recordingMeta.csv", ",25", ",5", r"ratio 0\.2;.*frameRate"),
    ],
)
def test_damaged_files_are_refused_with_file_and_row(tmp_path, name, old, new, reported):
    write(tmp_path, ["cut-in"])
    damage(tmp_path / name, old, new)
    with pytest.raises(InputError, match=reported):
        extract(tmp_path)


@pytest.mark.parametrize("wrong", [{"lonVelocity": 100.0}, {"heading": math.radians(HEADING)}], ids=str)
def test_speeds_and_headings_in_other_units_are_refused(tmp_path, wrong):
    with pytest.raises(InputError, match=r"ratio -?\d+.*heading \[degrees\] and lonVelocity"):
        extract(write(tmp_path, ["cut-in"], **wrong))


def test_a_cell_without_a_value_is_counted_and_left_out(tmp_path):
    account = extract(write(tmp_path, ["cut-in"], heading=None)).attrs["account"]
    assert account[0]["reason"] == "a missing or infinite value, or in no lane"
    assert account[0]["rows_dropped"] == 2 * FRAMES


def test_another_format_lacks_columns(tmp_path):
    write(tmp_path, ["cut-in"])
    with pytest.raises(InputError, match=r"no column id, .*state the source that fits"):
        extract_from("highd", tmp_path)
