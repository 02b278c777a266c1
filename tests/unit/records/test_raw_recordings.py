"""Cut-ins in raw Safety Pilot recordings: each choice of the rule with a case, planted cut-ins, bad input."""

import copy
import json
import sys
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import InputError
from accelerated_evaluation.cli import main
from accelerated_evaluation.records.ingest import Account
from accelerated_evaluation.records.sources import UNKNOWN, read_source, spmd_raw, table
from accelerated_evaluation.study.configuration import load
from drone_checks import extract as extract_from
from drone_checks import settings as settings_of

ROOT = Path(__file__).resolve().parents[3]
HEADS = ROOT / "tests" / "data" / "safety_pilot"  # the first rows of the real files
sys.path.append(str(ROOT / "benchmarks" / "recordings"))

import safety_pilot  # noqa: E402

settings, extract = partial(settings_of, "spmd_raw"), partial(extract_from, "spmd_raw")
MOMENT = 4000  # [ms], of the change into the path
HOST = 25.0  # [m/s]
SECONDS = 8
FRONT = [
    "Device",
    "Trip",
    "Time",
    "TargetId",
    "ObstacleId",
    "Range",
    "RangeRate",
    "Transversal",
    "TargetType",
]
FRONT += ["Status", "CIPV"]


def vehicle(times=range(0, 8000, 100), *, path=lambda t: t >= MOMENT, side=None, obstacle=1, **values):
    """One vehicle as rows: it comes from 3.5 m aside, and is in the path from MOMENT on by default."""
    of = {"range": 40.0, "rate": -2.0, "type": 0} | values
    side = side or (lambda t: 3.5 * np.clip((MOMENT + 1500 - t) / 3000, 0, 1))
    return [
        (
            t,
            obstacle,
            of["range"] + of["rate"] * (t - MOMENT) / 1000,
            of["rate"],
            side(t),
            of["type"],
            int(path(t)),
        )
        for t in times
    ]


def without(low, high):
    """Return the times of a trip without those from low to below high."""
    return [t for t in range(0, 8000, 100) if not low <= t < high]


def far_aside(until):
    """Return a lateral position that is 3.5 m up to a time, and straight ahead from then on."""
    return lambda t: 3.5 if t <= until else 0.2


def between(*intervals):
    """Return the condition to be in the path in any of some intervals [ms], ends included."""
    return lambda t: any(low <= t <= high for low, high in intervals)


def then(number, after, **values):
    """Return a vehicle whose number changes once, when it has not been seen for a while [ms]."""
    first = vehicle([t for t in range(0, MOMENT, 100) if t <= MOMENT - after])
    return first + vehicle(range(MOMENT, 8000, 100), obstacle=number, **values)


# Vehicles of a trip, and how many cut-ins they are with the settings of config.yaml
CASES = {
    "cut-in": (vehicle(), 1),
    "opening gap": (vehicle(rate=3.0), 1),
    "standing": (vehicle(rate=-HOST, range=60.0, times=range(2000, 5500, 100)), 1),
    "oncoming": (vehicle(rate=-HOST - 8, range=80.0, times=range(2500, 5500, 100)), 0),
    "beside": (vehicle(path=lambda t: False), 0),
    "in the path when first seen": (vehicle(path=lambda t: True), 0),
    "in the path for 0.4 s": (vehicle(path=between((MOMENT, 4400))), 0),
    "in the path for 0.5 s": (vehicle(path=between((MOMENT, 4500))), 1),
    "lost after 0.4 s": (vehicle(range(0, 4500, 100)), 0),
    "out for 1 s": (vehicle(path=between((MOMENT, 5000), (6000, 8000))), 1),
    "out for 1.1 s": (vehicle(path=between((MOMENT, 5000), (6100, 8000)), side=lambda t: 1.5), 2),
    "flickers at first": (vehicle(path=between((MOMENT, 4100), (4400, 8000))), 1),
    "unseen for 0.5 s": (vehicle(without(3600, MOMENT)), 1),
    "unseen for 0.6 s": (vehicle(without(3500, MOMENT)), 0),
    "another number": (then(2, 500), 1),
    "another number after 0.6 s": (then(2, 600), 0),
    "another number, 4 m off": (then(2, 100, range=44.0), 0),
    "another number, 1.1 m beside": (then(2, 100, side=lambda t: 0.6), 0),
    "three numbers": (
        vehicle(range(0, 2000, 100))
        + vehicle(range(2200, 3900, 100), obstacle=2)
        + vehicle(range(4000, 8000, 100), obstacle=3),
        1,
    ),
    "uncovered": (
        vehicle(side=lambda t: 1.5) + vehicle(path=lambda t: t < MOMENT, range=20.0, rate=-1.0, obstacle=2),
        0,
    ),
    "before a farther one": (
        vehicle() + vehicle(path=lambda t: t < MOMENT, range=70.0, rate=-1.0, side=lambda t: 0.0, obstacle=2),
        1,
    ),
    "0.9 m aside": (vehicle(side=lambda t: 0.9), 0),
    "1 m aside": (vehicle(side=lambda t: -1.0), 1),
    "aside 3 s before": (vehicle(side=far_aside(MOMENT - 3000)), 1),
    "aside 3.1 s before": (vehicle(side=far_aside(MOMENT - 3100)), 0),
    "truck": (vehicle(type=1), 0),
    "every row twice": (2 * vehicle(), 1),
    "no range": (vehicle(range=0.0, rate=0.0), 0),
}
HOSTS = {  # what is peculiar about the host, and how many cut-ins an ordinary vehicle is then
    "host speed 0.2 s old": ({"recorded": lambda t: not 3900 <= t <= 4200}, 1),
    "host speed 0.3 s old": ({"recorded": lambda t: not 3800 <= t <= 4200}, 0),
    "host speed invalid": ({"valid": lambda t: not 3800 <= t <= 4200}, 0),
    "signal 3 s before": ({"signal": lambda t: t == MOMENT - 3000}, 0),
    "signal 3.1 s before": ({"signal": lambda t: t == MOMENT - 3100}, 1),
    "signal afterwards": ({"signal": lambda t: t > MOMENT}, 1),
}
EXPECTED = {name: count for name, (_, count) in (CASES | HOSTS).items()}
TRIPS = {name: number for number, name in enumerate(EXPECTED, start=200)}


def host_rows(trip, recorded=lambda t: True, valid=lambda t: True, signal=lambda t: False):
    """The host of a trip, which drives 90 km/h."""
    names = ["Device", "Trip", "Time", "SpeedWsu", "GpsSpeedWsu", "TurnSngRWsu", "TurnSngLWsu", "ValidCanWsu"]
    rows = [
        (10106, trip, t // 10, 3.6 * HOST, HOST, int(signal(t)), 0, int(valid(t)))
        for t in range(0, 1000 * SECONDS, 100)
        if recorded(t)
    ]
    return pd.DataFrame(rows, columns=names)


def write(folder, cases=None):
    """Write one trip for each case."""
    folder.mkdir(parents=True, exist_ok=True)
    targets, hosts = [], []
    for name in cases or EXPECTED:
        rows = CASES[name][0] if name in CASES else vehicle()
        targets += [
            (10106, TRIPS[name], t // 10, 1, of, range_, rate, side, type_, 3, path)
            for t, of, range_, rate, side, type_, path in rows
        ]
        hosts.append(host_rows(TRIPS[name], **(HOSTS[name][0] if name in HOSTS else {})))
    front = pd.DataFrame(targets, columns=FRONT)
    front.to_csv(folder / "DataFrontTargets_1.csv", index=False)
    pd.concat(hosts).to_csv(folder / "DataWsu_1.csv", index=False)
    return folder


def counts(cut_ins):
    """Return how many cut-ins there are in the trip of each case."""
    found = cut_ins["trip"].value_counts()
    return {name: int(found.get(trip, 0)) for name, trip in TRIPS.items()}


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    return write(tmp_path_factory.mktemp("recordings"))


@pytest.fixture(scope="module")
def cut_ins(recordings):
    return extract(recordings)


@pytest.fixture(scope="module")
def generated(tmp_path_factory):
    """Return 200 slots of generated recordings, and the cut-ins that are planted in them."""
    folder = tmp_path_factory.mktemp("generated")
    rows, planted = safety_pilot.write_recordings(folder, 200, np.random.default_rng(1))
    assert rows > 100_000
    return folder, planted


# ---------------------------------------------------------------- the rule


@pytest.mark.parametrize("name", EXPECTED)
def test_each_case_is_as_many_cut_ins_as_it_should_be(cut_ins, name):
    assert counts(cut_ins)[name] == EXPECTED[name]


def test_a_cut_in_has_the_values_of_its_first_frame_in_the_path(cut_ins):
    row = cut_ins[cut_ins["trip"] == TRIPS["cut-in"]].iloc[0]
    assert row[["device", "time", "vehicle"]].tolist() == [10106, MOMENT / 1000, 1]
    expected = {"lead_speed": HOST - 2, "range": 40, "closing_speed": 2, "host_speed": HOST}
    assert row[list(expected)].astype(float).to_dict() == pytest.approx(expected, abs=1e-12)


def test_a_flicker_does_not_delay_the_moment(cut_ins):
    assert cut_ins.loc[cut_ins["trip"] == TRIPS["flickers at first"], "time"].tolist() == [MOMENT / 1000]


def test_a_vehicle_that_is_followed_on_keeps_its_first_number(cut_ins):
    assert cut_ins.loc[cut_ins["trip"] == TRIPS["three numbers"], "vehicle"].tolist() == [1]


@pytest.mark.parametrize(
    ("changes", "differences"),
    [
        ({"rule__stay": 0.4}, {"in the path for 0.4 s": 1, "lost after 0.4 s": 1}),
        ({"rule__absence": 0.9}, {"out for 1 s": 2}),
        ({"rule__absence": 1.1}, {"out for 1.1 s": 1}),
        ({"rule__gap": 0.6}, {"unseen for 0.6 s": 1}),
        ({"link__time": 0.6}, {"another number after 0.6 s": 1}),
        ({"link__time": 0}, {"another number": 0, "three numbers": 0}),
        ({"link__range": 4.1}, {"another number, 4 m off": 1}),
        ({"link__transversal": 1.4}, {"another number, 1.1 m beside": 1}),
        ({"uncovered": "keep"}, {"uncovered": 1}),
        ({"aside__transversal": 0.9}, {"0.9 m aside": 1}),
        ({"aside__time": 3.1}, {"aside 3.1 s before": 1}),
        ({"target_types": [0, 1]}, {"truck": 1}),
        ({"host_gap": 0.3}, {"host speed 0.3 s old": 1}),
        ({"turn_signal": 2.9}, {"signal 3 s before": 1}),
        ({"turn_signal": None}, {"signal 3 s before": 1}),
    ],
)
def test_each_setting_changes_just_the_cases_that_it_is_about(tmp_path, changes, differences):
    related = {"cut-in", *differences}
    folder = write(tmp_path, sorted(related))
    expected = {name: EXPECTED[name] for name in related} | differences
    found = counts(extract(folder, **changes))
    assert {name: found[name] for name in related} == expected


def traffic_net(folder):
    """Return the cut-ins by the rule of TrafficNet: a car, not CIPV in a frame and CIPV in the next."""
    rows = pd.read_csv(folder / "DataFrontTargets.csv")
    rows = rows[(rows["TargetType"] == 0) & rows["Range"].notna()]
    key = ["Device", "Trip", "ObstacleId", "Time"]
    rows = rows.drop_duplicates(key).sort_values(key)
    before = rows.groupby(key[:3])[["Time", "CIPV"]].shift()
    return rows[(rows["CIPV"] == 1) & (before["CIPV"] == 0) & (rows["Time"] - before["Time"] == 10)]


def test_the_rule_of_trafficnet_is_one_of_the_settings(generated):
    folder, _ = generated
    found = extract(
        folder,
        rule__gap=0.1,
        rule__absence=0,
        rule__stay=0,
        link__time=0,
        uncovered="keep",
        aside__transversal=0,
        host_gap=10,
        turn_signal=None,
    )
    lines = pd.DataFrame(found.attrs["account"])
    oncoming = lines.loc[lines["reason"] == "comes towards the host", "rows_dropped"].item()
    expected = traffic_net(folder)
    assert len(found) + oncoming == len(expected)
    seen = set(zip(found["device"], found["trip"], (found["time"] * 100).round().astype(int), strict=True))
    assert seen <= set(expected[["Device", "Trip", "Time"]].itertuples(index=False, name=None))


# ---------------------------------------------------------------- planted cut-ins, in any order and parts


def agree(found, planted):
    """Whether the planted cut-ins were found, no others, and with their values."""
    key = ["device", "trip", "time"]
    both = planted.merge(found, on=key, suffixes=("", "_found"))
    values = ["lead_speed", "range", "closing_speed"]
    same = all(np.allclose(both[name], both[f"{name}_found"], atol=1e-4, rtol=0) for name in values)
    return same and len(both) == len(planted) == len(found)


def test_all_planted_cut_ins_are_found_and_none_is_invented(generated):
    folder, planted = generated
    assert agree(extract(folder), planted)


@pytest.mark.parametrize(
    "wrong",
    [
        {"rule__stay": 0},
        {"link__time": 0},
        {"uncovered": "keep"},
        {"aside__transversal": 0},
        {"target_types": [0, 1]},
        {"turn_signal": None},
        {"host_gap": 10},
    ],
    ids=str,
)
def test_a_rule_without_one_of_its_parts_misses_or_invents_cut_ins(generated, wrong):
    folder, planted = generated
    assert not agree(extract(folder, **wrong), planted)


def test_the_order_of_rows_and_their_files_and_parts_do_not_count(generated, tmp_path, monkeypatch):
    folder, _ = generated
    whole = extract(folder)
    for name in ("DataFrontTargets", "DataWsu"):
        rows = pd.read_csv(folder / f"{name}.csv", dtype=str).sample(frac=1, random_state=1)
        rows.iloc[:5000].to_csv(tmp_path / f"{name}_1.csv", index=False)
        rows.iloc[5000:].to_csv(tmp_path / f"{name}_2.csv", index=False)
    monkeypatch.setattr(spmd_raw, "PART", 1_000_000)
    pieces = extract(tmp_path)
    pd.testing.assert_frame_equal(pieces, whole, check_exact=True)
    assert pieces.attrs == whole.attrs


# ---------------------------------------------------------------- account and exposure


def test_the_account_adds_up_from_rows_to_cut_ins_and_names_examples(cut_ins):
    lines = cut_ins.attrs["account"]
    assert lines[0]["rows_in"] == sum(len(rows) for rows, _ in CASES.values()) + 80 * len(HOSTS)
    for before, line in pairwise(lines):
        assert line["rows_in"] == before["rows_kept"] == before["rows_in"] - before["rows_dropped"]
    assert lines[-1]["rows_kept"] == len(cut_ins) == sum(EXPECTED.values())
    by_reason = {line["reason"]: line for line in lines}
    oncoming = by_reason["comes towards the host"]
    assert oncoming["rows_dropped"] == 1
    assert oncoming["example_rows"] == f"device 10106 trip {TRIPS['oncoming']} at 4 s"
    assert by_reason["range not above 0"]["rows_dropped"] == 80
    assert by_reason["the same obstacle at the same time once more"]["rows_dropped"] == 80


def test_rows_with_a_missing_cell_are_counted(tmp_path):
    write(tmp_path, ["cut-in"])
    rows = pd.read_csv(tmp_path / "DataFrontTargets_1.csv", dtype=str)
    rows.loc[1, "Device"], rows.loc[2, "Range"], rows.loc[3, "RangeRate"] = "", "nan", "inf"
    rows.to_csv(tmp_path / "DataFrontTargets_1.csv", index=False)
    found = extract(tmp_path)
    assert found.attrs["account"][0]["rows_dropped"] == 3
    assert counts(found)["cut-in"] == 1


def test_exposure_is_the_driving_of_the_hosts_without_gaps(cut_ins):
    steps = 0
    for name in EXPECTED:
        host = host_rows(0, **(HOSTS[name][0] if name in HOSTS else {}))
        lasts = host.loc[host["ValidCanWsu"] == 1, "Time"].diff() / 100
        steps += lasts[lasts <= 0.5].sum()
    exposure = cut_ins.attrs["exposure"]
    assert exposure["hours"] == pytest.approx(steps / 3600, rel=1e-12)
    assert exposure["kilometres"] == pytest.approx(HOST * steps / 1000, rel=1e-9)


def test_line_ends_of_another_system_and_a_byte_order_mark_do_not_count(tmp_path):
    folder = write(tmp_path / "it's here", ["cut-in", "uncovered"])
    before = extract(folder)
    for file in folder.iterdir():
        file.write_bytes(b"\xef\xbb\xbf" + file.read_bytes().replace(b"\n", b"\r\n"))
    pd.testing.assert_frame_equal(extract(folder), before, check_exact=True)


def test_a_host_without_a_sensor_is_no_exposure(tmp_path):
    write(tmp_path, ["cut-in"])
    alone = extract(tmp_path).attrs["exposure"]
    host_rows(300).assign(Device=10107).to_csv(tmp_path / "DataWsu_2.csv", index=False)
    assert extract(tmp_path).attrs["exposure"] == alone


def test_a_sample_has_no_exposure_of_its_own(recordings):
    data = copy.deepcopy(load()["data"]) | {
        "source": "spmd_raw",
        "sample": 5,
        "spmd_raw": settings(recordings),
    }
    assert read_source(data, np.random.default_rng(1)).attrs["exposure"] == UNKNOWN


# ---------------------------------------------------------------- the real files, units, bad input


def test_the_first_rows_of_the_real_files_can_be_read():
    found = extract(HEADS)
    assert found.empty
    assert found.attrs["account"][0]["rows_in"] == 19
    assert found.attrs["account"][0]["rows_dropped"] == 0


@pytest.mark.parametrize(
    ("changes", "reported"),
    [({"speed_unit": "m/s"}, "ratio 3.6.*speed_unit"), ({"time_unit": 0.001}, "ratio 10.*time_unit")],
)
def test_units_that_contradict_the_recordings_are_refused(recordings, changes, reported):
    with pytest.raises(InputError, match=reported):
        extract(recordings, **changes)


GOOD = "10106,200,0,1,1,40,-2,3.5,0,3,0\n"
HEADER = ",".join(FRONT) + "\n"


@pytest.mark.parametrize(
    ("content", "reported"),
    [
        (b"", r"row 1: seen no column .* the file is empty"),
        (HEADER.encode(), "no row that can be used"),
        (HEADER.replace("Range,", "").encode(), "row 1: seen no column Range among"),
        (HEADER.replace(",", ";").encode(), "expected a comma-separated header"),
        (HEADER.replace("Status", "Range").encode(), "more than one column Range"),
        ((HEADER + GOOD + GOOD.replace("40", "far")).encode(), r'row 3: .*column "Range".*"far"'),
        ((HEADER + GOOD + "10106,200\n").encode(), "row 3: seen Expected Number of Columns: 11 Found: 2"),
        (
            (HEADER + GOOD + GOOD.strip() + ",7\n").encode(),
            "row 3: seen Expected Number of Columns: 11 Found",
        ),
        (HEADER.encode() + b"\xff\xfe,1\n", "row 2"),
        (b"\xff\xfe\x00", "UTF-8"),
    ],
)
def test_files_that_cannot_be_read_are_refused_with_file_and_row(tmp_path, content, reported):
    write(tmp_path, ["cut-in"])
    (tmp_path / "DataFrontTargets_1.csv").write_bytes(content)
    with pytest.raises(InputError, match=reported) as error:
        extract(tmp_path)
    assert "DataFrontTargets_1.csv" in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("missing", ["DataFrontTargets_1.csv", "DataWsu_1.csv"])
def test_a_missing_table_is_told(tmp_path, missing):
    write(tmp_path, ["cut-in"])
    (tmp_path / missing).unlink()
    with pytest.raises(InputError, match=missing.replace("_1", r"\*")):
        extract(tmp_path)


def test_a_missing_folder_is_told(tmp_path):
    with pytest.raises(InputError, match=r"no such folder.*data\.spmd_raw\.path"):
        extract(tmp_path / "nowhere")


# ---------------------------------------------------------------- the command


def study(tmp_path, folder):
    path = tmp_path / "study.yaml"
    path.write_text(f"data:\n  source: spmd_raw\n  spmd_raw: {{path: {folder}}}\n")
    return str(path)


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_the_command_writes_a_table_that_the_source_table_reads(
    recordings, cut_ins, tmp_path, capsys, ending
):
    target = tmp_path / f"found.{ending}"
    assert main(["extract", study(tmp_path, recordings), str(target)]) == 0
    assert f"{len(cut_ins):,} cut-ins in" in capsys.readouterr().out
    read = table.read(load()["data"]["table"] | {"path": str(target)})
    names = ["lead_speed", "range", "closing_speed"]
    pd.testing.assert_frame_equal(read, cut_ins[names], check_exact=True, check_names=False)
    account = pd.read_csv(tmp_path / "found_account.csv", keep_default_na=False)
    assert account.to_dict("records") == cut_ins.attrs["account"]
    assert json.loads((tmp_path / "found_exposure.json").read_text()) == cut_ins.attrs["exposure"]


@pytest.mark.parametrize(
    ("content", "target", "reported"),
    [
        ("data: {source: spmd}", "found.csv", "expected a source of recordings"),
        ("data: {source: spmd_raw}", "found.csv", "expected a path, as the source is spmd_raw"),
        ("data: {source: spmd_raw, spmd_raw: {path: nowhere}}", "found.csv", "no such folder"),
        ("data: {source: spmd_raw, spmd_raw: {path: nowhere}}", "found.xlsx", "expected .parquet or .csv"),
    ],
)
def test_the_command_ends_in_one_message_and_leaves_nothing(tmp_path, capsys, content, target, reported):
    (tmp_path / "study.yaml").write_text(content)
    assert main(["extract", str(tmp_path / "study.yaml"), str(tmp_path / target)]) == 2
    assert reported in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["study.yaml"]


def test_the_account_of_a_study_begins_with_that_of_the_extraction(cut_ins):
    account = Account.of(cut_ins)
    account.enter(1, step="closing", reason="range rate not negative")
    lines = account.table()
    assert lines["rows_in"].tolist()[1:] == lines["rows_kept"].tolist()[:-1]


def written(folder, change, kind="*"):
    """Write recordings of one cut-in, with some tables changed."""
    write(folder, ["signal 3.1 s before"])
    for file in folder.glob(f"Data{kind}_1.csv"):
        change(pd.read_csv(file)).to_csv(file, index=False)
    return folder


@pytest.mark.parametrize("column", ["Device", "Trip"])
@pytest.mark.parametrize("number", [2**31, 3_000_000_000, 2**53 - 1])
def test_large_identifiers_lose_no_cut_in(column, number, tmp_path):
    cut_ins = extract(written(tmp_path / column, lambda table: table.assign(**{column: number})))
    assert cut_ins[column.lower()].tolist() == [number]


@pytest.mark.parametrize(
    ("kind", "column", "change", "message"),
    [
        ("FrontTargets", "Device", lambda x: 2**53, "column Device: seen .*whole numbers below 2"),
        ("FrontTargets", "Trip", lambda x: 1e300, "column Trip: seen .*whole numbers below 2"),
        ("FrontTargets", "ObstacleId", lambda x: 1.5, "column ObstacleId: seen .*whole numbers below 2"),
        ("FrontTargets", "TargetType", lambda x: 0.5, "column TargetType: seen .*whole numbers below 2"),
        ("FrontTargets", "ObstacleId", lambda x: "car 1", "car 1"),
        ("FrontTargets", "RangeRate", lambda x: -x, r"ratio -1;.*RangeRate"),
        ("Wsu", "ValidCanWsu", lambda x: 0, "ValidCanWsu = 1"),
        ("Wsu", "SpeedWsu", lambda x: HOST / 0.44704, "SpeedWsu, as m/s, and GpsSpeedWsu"),
        ("Wsu", "SpeedWsu", lambda x: x.where(x.index != 3, 1e300), "seen"),
    ],
)
def test_a_column_that_cannot_be_is_an_error(kind, column, change, message, tmp_path):
    changed = written(tmp_path / "r", lambda table: table.assign(**{column: change(table[column])}), kind)
    with pytest.raises(InputError, match=message):
        extract(changed)


def test_missing_speeds_of_the_satellites_are_told(tmp_path):
    changed = written(tmp_path / "r", lambda table: table.assign(GpsSpeedWsu=0.0), "Wsu")
    (warning,) = extract(changed).attrs["warnings"]
    assert "the unit of SpeedWsu (km/h) could not be checked" in warning
