"""Cut-ins in trajectories in the format of highD: each choice of the rule, planted cut-ins, bad input."""

import re
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.base.errors import InputError
from drone_checks import FRAMES, LENGTH, MOMENT, RATE, adds_up, damage, is_driving_of, stays, write_shuffled
from drone_checks import agree as agree_within
from drone_checks import extract as extract_from

ROOT = Path(__file__).resolve().parents[3]
sys.path.append(str(ROOT / "benchmarks" / "recordings"))

import trajectories  # noqa: E402

extract = partial(extract_from, "highd")
HOST, LEAD = 1, 2
LANE, BESIDE = 3, 2


def frames(of, *, front, speed, lane, follower=0, direction=2, kept=range(FRAMES)):
    """The rows of one vehicle; `front` is how far along the road its front is at the moment."""
    rows = []
    for frame in kept:
        along = front + speed * (frame - MOMENT) / RATE
        x = along - LENGTH if direction == 2 else 420 - along
        sign = 1 if direction == 2 else -1
        rows.append((frame + 1, of, x, LENGTH, sign * speed, follower, lane(frame)))
    return rows


def pair(
    gap=30.0, host_lane=lambda f: LANE, lane=lambda f: LANE if f >= MOMENT else BESIDE, host=HOST, **values
):
    """A host at 30 m/s, and a vehicle at 27 m/s that comes into its lane."""
    return [
        *frames(HOST, front=200.0, speed=30.0, lane=host_lane, **values),
        *frames(LEAD, front=200.0 + gap + LENGTH, speed=27.0, lane=lane, follower=host, **values),
    ]


CARS = {HOST: "Car", LEAD: "Car"}
# Rows and classes of a recording, and how many cut-ins it has with the settings of config.yaml
CASES = {
    "cut-in": (pair(), CARS, 1),
    "to the left": (pair(direction=1), CARS, 1),
    "keeps its lane": (pair(lane=lambda f: LANE), CARS, 0),
    "stays 12 frames": (pair(lane=stays((0, BESIDE), (MOMENT, LANE), (MOMENT + 12, BESIDE))), CARS, 0),
    "stays 14 frames": (pair(lane=stays((0, BESIDE), (MOMENT, LANE), (MOMENT + 14, BESIDE))), CARS, 1),
    "out of view after 12 frames": (pair(kept=range(MOMENT + 12)), CARS, 0),
    "lost for 0.48 s": (pair(kept=[*range(MOMENT - 6), *range(MOMENT + 5, FRAMES)]), CARS, 1),
    "lost for 0.56 s": (pair(kept=[*range(MOMENT - 6), *range(MOMENT + 7, FRAMES)]), CARS, 0),
    "lost before": (pair(kept=[*range(MOMENT - 40), *range(MOMENT - 10, FRAMES)]), CARS, 1),
    "back after 1 s": (pair(lane=stays((0, LANE), (MOMENT - 24, BESIDE), (MOMENT, LANE))), CARS, 0),
    "back after 1.2 s": (pair(lane=stays((0, LANE), (MOMENT - 30, BESIDE), (MOMENT, LANE))), CARS, 1),
    "nobody behind": (pair(host=0), CARS, 0),
    "behind, but in another lane": (pair(host_lane=lambda f: BESIDE), CARS, 0),
    "host came 0.96 s before": (pair(host_lane=stays((0, 4), (MOMENT - 24, LANE))), CARS, 0),
    "host came 1 s before": (pair(host_lane=stays((0, 4), (MOMENT - 25, LANE))), CARS, 1),
    "host came into view": (pair(kept=range(MOMENT - 10, FRAMES)), CARS, 1),
    "truck before a car": (pair(), {HOST: "Car", LEAD: "Truck"}, 1),
    "car before a truck": (pair(), {HOST: "Truck", LEAD: "Car"}, 0),
    "beside each other": (pair(gap=-1.0), CARS, 0),
    "every row twice": (2 * pair(), CARS, 1),
}
NAMES = {f"{number:02d}": name for number, name in enumerate(CASES, start=1)}


def write(folder, cases=CASES, **tracks):
    """Write one recording for each case; ``tracks`` replaces its columns."""
    folder.mkdir(parents=True, exist_ok=True)
    for number, name in NAMES.items():
        if name not in cases:
            continue
        rows, classes, _ = CASES[name]
        columns = ["frame", "id", "x", "width", "xVelocity", "followingId", "laneId"]
        table = pd.DataFrame(rows, columns=columns)
        table.assign(y=0.0, **tracks).to_csv(folder / f"{number}_tracks.csv", index=False)
        direction = 1 if name == "to the left" else 2
        meta = [(of, kind, direction) for of, kind in classes.items()]
        meta = pd.DataFrame(meta, columns=["id", "class", "drivingDirection"])
        meta.to_csv(folder / f"{number}_tracksMeta.csv", index=False)
        recording = pd.DataFrame({"id": [int(number)], "frameRate": [RATE]})
        recording.to_csv(folder / f"{number}_recordingMeta.csv", index=False)
    return folder


@pytest.mark.parametrize("name", ["a[1]", "a*", "a?", "[!b]", "{a,b}"])
def test_a_name_is_no_pattern(tmp_path, name):
    write(tmp_path / "a1", ["keeps its lane"])
    assert len(extract(write(tmp_path / name, ["cut-in"]))) == 1


def counts(cut_ins):
    found = cut_ins["recording"].value_counts()
    return {name: int(found.get(number, 0)) for number, name in NAMES.items()}


@pytest.fixture(scope="module")
def cut_ins(tmp_path_factory):
    return extract(write(tmp_path_factory.mktemp("recordings")))


@pytest.mark.parametrize("name", CASES)
def test_each_case_is_as_many_cut_ins_as_it_should_be(cut_ins, name):
    assert counts(cut_ins)[name] == CASES[name][2]


@pytest.mark.parametrize("name", ["cut-in", "to the left"])
def test_a_cut_in_has_the_values_of_its_first_frame_in_the_lane(cut_ins, name):
    number = {of: number for number, of in NAMES.items()}[name]
    row = cut_ins[cut_ins["recording"] == number].iloc[0]
    assert row[["vehicle", "host"]].tolist() == [LEAD, HOST]
    expected = {
        "lead_speed": 27,
        "range": 30,
        "closing_speed": 3,
        "host_speed": 30,
        "time": (MOMENT + 1) / RATE,
    }
    assert row[list(expected)].astype(float).to_dict() == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    ("changes", "differences"),
    [
        ({"rule__stay": 0.4}, {"stays 12 frames": 1, "out of view after 12 frames": 1}),
        ({"rule__absence": 0.9}, {"back after 1 s": 1}),
        ({"rule__absence": 1.3}, {"back after 1.2 s": 0}),
        ({"rule__gap": 0.6}, {"lost for 0.56 s": 1}),
        ({"rule__gap": 0.4}, {"lost for 0.48 s": 0}),
        ({"settled": 0.9}, {"host came 0.96 s before": 1}),
        ({"settled": 1.1}, {"host came 1 s before": 0}),
        ({"lead_classes": ["Car"]}, {"truck before a car": 0}),
        ({"host_classes": ["Car", "Truck"]}, {"car before a truck": 1}),
    ],
)
def test_each_setting_changes_just_the_cases_that_it_is_about(tmp_path, changes, differences):
    related = {"cut-in", *differences}
    found = counts(extract(write(tmp_path, related), **changes))
    expected = {name: CASES[name][2] for name in related} | differences
    assert {name: found[name] for name in related} == expected


def test_the_account_adds_up_from_rows_to_cut_ins(cut_ins):
    assert adds_up(cut_ins, CASES)
    by_reason = {line["reason"]: line for line in cut_ins.attrs["account"]}
    number = {of: number for number, of in NAMES.items()}["beside each other"]
    assert by_reason["range not above 0"]["example_rows"] == f"recording {number} vehicle 2 at 3.04 s"


def test_exposure_is_the_driving_of_all_vehicles_of_the_host_classes(tmp_path):
    exposure = extract(write(tmp_path, ["cut-in", "truck before a car"])).attrs["exposure"]
    assert is_driving_of(exposure, 30, 27, 30)


# ---------------------------------------------------------------- planted cut-ins


@pytest.fixture(scope="module")
def generated(tmp_path_factory):
    folder = tmp_path_factory.mktemp("generated")
    return folder, trajectories.write_recordings(folder, 2, 80, np.random.default_rng(3))


VALUES = ["time", "lead_speed", "range", "closing_speed"]
agree = partial(agree_within, tolerances=dict.fromkeys(VALUES, (0, 2e-4)))


def test_all_planted_cut_ins_are_found_in_both_directions_and_none_is_invented(generated):
    folder, planted = generated
    assert len(planted) > 60
    assert set(planted["vehicle"] % 4) == {0, 2}  # of both directions
    assert agree(extract(folder), planted)


@pytest.mark.parametrize(
    "wrong",
    [{"rule__stay": 0}, {"settled": 0}, {"host_classes": ["Car", "Truck"]}, {"lead_classes": ["Car"]}],
    ids=str,
)
def test_a_rule_without_one_of_its_parts_misses_or_invents_cut_ins(generated, wrong):
    folder, planted = generated
    assert not agree(extract(folder, **wrong), planted)


def test_the_order_of_rows_does_not_count(generated, tmp_path):
    folder, _ = generated
    write_shuffled(folder, tmp_path)
    again, first = extract(tmp_path), extract(folder)
    pd.testing.assert_frame_equal(again, first, check_exact=True)
    assert again.attrs == first.attrs


def changed(folder, target, end, **columns):
    """Copy a folder of recordings, and replace columns of the files whose names end in ``end``."""
    for file in folder.glob("*.csv"):
        changes = columns if end in file.name else {}
        pd.read_csv(file).assign(**changes).to_csv(target / file.name, index=False)
    return target


@pytest.mark.parametrize("numbers", [(2, 1), (2, 2), (1, 1), (0, 1), (-1, 1)])
def test_directions_may_have_any_numbers(generated, tmp_path, numbers):
    """Half or all of the cut-ins were left out, because their ranges seemed to be negative."""
    folder, planted = generated
    renumbered = {
        "drivingDirection": lambda meta: meta["drivingDirection"].map(dict(zip((1, 2), numbers, strict=True)))
    }
    assert agree(extract(changed(folder, tmp_path, "tracksMeta", **renumbered)), planted)


@pytest.mark.parametrize(
    ("end", "columns", "reported"),
    [
        ("_tracks.csv", {"x": lambda table: table["x"] / 0.9144}, r"in the ratio 1\.09"),  # yards
        ("recordingMeta", {"frameRate": lambda table: 30}, r"in the ratio 1\.2"),
        (
            "_tracks.csv",
            {"x": lambda table: np.where(table["id"] < 9, 3.28, 1) * table["x"]},
            "in 8 of 160 vehicles",
        ),
        ("_tracks.csv", {"followingId": lambda table: 0}, "no row is a cut-in; .* no vehicle behind"),
    ],
)
def test_quantities_that_nearly_agree_are_warned_of(generated, tmp_path, end, columns, reported):
    warnings = extract(changed(generated[0], tmp_path, end, **columns)).attrs["warnings"]
    assert re.search(reported, "\n".join(warnings))


# ---------------------------------------------------------------- bad input


def test_frames_in_milliseconds_are_refused(generated, tmp_path):
    with pytest.raises(InputError, match="no host with two frames"):
        extract(changed(generated[0], tmp_path, "_tracks.csv", frame=lambda table: 40 * table["frame"]))


def test_a_missing_file_beside_the_tracks_is_told(tmp_path):
    write(tmp_path, ["cut-in"])
    (tmp_path / "01_recordingMeta.csv").unlink()
    with pytest.raises(InputError, match=r"01_recordingMeta\.csv: seen no such file"):
        extract(tmp_path)


@pytest.mark.parametrize(
    ("name", "old", "new", "reported"),
    [
        ("01_tracks.csv", "laneId", "laneletId", r"01_tracks\.csv, row 1: seen no column laneId"),
        ("01_tracks.csv", "\n1,1,", "\n1,one,", r'01_tracks\.csv, row 2: .*"one"'),
        ("01_tracksMeta.csv", "class", "kind", r"01_tracksMeta\.csv, row 1: seen no column class"),
        ("01_tracksMeta.csv", "Car", "Car,1", r"01_tracksMeta\.csv, row 2: .*Columns"),
        ("01_tracksMeta.csv", "\n2,Car,2", "", r"01_tracksMeta\.csv: seen no row .* class for vehicle 2"),
        ("01_tracksMeta.csv", "2,Car,", "2,,", r"01_tracksMeta\.csv: seen no row .* class for vehicle 2"),
        ("01_recordingMeta.csv", ",25", ",0", r"frameRate: seen 0\.0"),
        ("01_recordingMeta.csv", "\n1,25", "", "frameRate: seen no row"),
        ("01_recordingMeta.csv", ",25", ",5", r"ratio 0\.2;.*frameRate"),
    ],
)
def test_damaged_files_are_refused_with_file_and_row(tmp_path, name, old, new, reported):
    write(tmp_path, ["cut-in"])
    damage(tmp_path / name, old, new)
    with pytest.raises(InputError, match=reported):
        extract(tmp_path)


def test_classes_may_have_any_name(tmp_path):
    folder = write(tmp_path, ["cut-in"])
    assert len(extract(folder, host_classes=['it\'s a "car"', "Car"])) == 1


def test_a_folder_without_recordings_is_told(tmp_path):
    with pytest.raises(InputError, match=r"no file called \*_tracks\.csv"):
        extract(tmp_path)


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"width": -LENGTH}, "column width: seen .* vehicles with a length of 0 or less"),
        ({"width": LENGTH / 0.3048}, r"a median length of cars of 13\.1 m"),
        ({"width": 2.5}, r"a median length of trucks of 2\.5 m"),
        ({"id": 2.0**53}, "column id"),
        ({"xVelocity": 100.0}, r"ratio 0\.\d+;.*xVelocity"),
        ({"id": 1.5}, r"column id: seen 1\.5; expected whole numbers"),
        ({"x": 1e300}, ": seen "),
    ],
)
def test_lengths_and_identifiers_that_cannot_be_are_errors(changed, told, tmp_path):
    with pytest.raises(InputError, match=told):
        extract(write(tmp_path / "r", ["truck before a car"], **changed))


@pytest.mark.parametrize("rate", [np.inf, 0, -25, 1e9])
def test_a_frame_rate_that_cannot_be_is_an_error(rate, tmp_path):
    folder = write(tmp_path / "r", ["cut-in"])
    for file in folder.glob("*_recordingMeta.csv"):
        pd.read_csv(file).assign(frameRate=rate).to_csv(file, index=False)
    with pytest.raises(InputError, match="column frameRate: seen"):
        extract(folder)


def test_times_to_collision_of_highd_follow_from_positions_on_both_carriageways(tmp_path):
    """highD-dataset issues 8 and 9: velocities are negative on the upper one, and so is the published TTC."""
    speeds, gap, moment = (32.06, 38.53), 112.62, 100
    rows = []
    for frame in range(1, 201):
        time = (frame - moment) / 25
        fronts = (150 + speeds[0] * time, 150 + gap + 4 + speeds[1] * time)
        for number, (front, speed) in enumerate(zip(fronts, speeds, strict=True), 1):
            lane = 2 if number == 1 or frame >= moment else 3
            row = {"frame": frame, "id": number, "x": 420 - front, "y": 10.0, "width": 4.0, "height": 2.0}
            row |= {"xVelocity": -speed, "laneId": lane, "followingId": int(number == 2), "ttc": -17.38}
            rows.append(row | {"dhw": 0.0})
    tracks = pd.DataFrame(rows).reindex(columns=trajectories.TRACKS.split(","), fill_value=0)
    tracks.to_csv(tmp_path / "01_tracks.csv", index=False)
    meta = pd.DataFrame({"id": [1, 2], "class": "Car", "drivingDirection": 1, "width": 4.0})
    meta = meta.reindex(columns=trajectories.TRACKS_META.split(","), fill_value=0)
    meta.to_csv(tmp_path / "01_tracksMeta.csv", index=False)
    recording = pd.DataFrame([dict.fromkeys(trajectories.RECORDING_META.split(","), 0) | {"frameRate": 25}])
    recording.to_csv(tmp_path / "01_recordingMeta.csv", index=False)
    (found,) = extract(tmp_path).to_dict("records")
    assert found["range"] == pytest.approx(gap)
    assert found["closing_speed"] == pytest.approx(speeds[0] - speeds[1])  # the gap opens
    assert found["range"] / found["closing_speed"] == pytest.approx(-17.4, abs=0.05)
