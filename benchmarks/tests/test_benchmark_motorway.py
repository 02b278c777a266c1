"""The motorway whose crashes are counted: hosts behind known courses, settings, and a few minutes of SUMO."""

import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.base.errors import InputError, StudyError
from accelerated_evaluation.laws.motion import MOTIONS
from accelerated_evaluation.laws.motion.recorded import recorded_courses
from accelerated_evaluation.records.sources import SOURCES
from accelerated_evaluation.study.configuration import load
from accelerated_evaluation.vehicles import load_vehicle

pytestmark = pytest.mark.studies
ROOT = Path(__file__).resolve().parents[2]
sys.path += [str(ROOT / "benchmarks"), str(ROOT / "benchmarks" / "motorway")]

import chain  # noqa: E402
from count import counted, crashes, summed  # noqa: E402
from hosts import HOSTS, encounters_of  # noqa: E402
from recording import RULES, compared, in_minutes, write_recordings  # noqa: E402
from settings import Motorway, read_settings  # noqa: E402
from traffic import CAR, LENGTH, LORRY, NAMES, PATIENCE, RATE, WARM_UP, Part, Trajectories, run_sumo, simulate  # noqa: E402

TIMES = np.arange(1, 41) / RATE
CONSTANT = {"constant": MOTIONS["constant"]()}


def cut_ins(size: int, seed: int = 5) -> pd.DataFrame:
    generator = np.random.default_rng(seed)
    table = pd.DataFrame(generator.uniform((5, 1, -5), (35, 60, 20), (size, 3)), columns=list(NAMES))
    return table[table["lead_speed"] + table["closing_speed"] > 0].reset_index(drop=True)


def with_courses(table: pd.DataFrame, acceleration: float) -> pd.DataFrame:
    """Add courses of other cars that keep an acceleration [m/s^2] until they stop."""
    courses = np.maximum(table[["lead_speed"]].to_numpy() + acceleration * TIMES, 0)
    return table.join(
        pd.DataFrame(courses, columns=[f"speed_{time:.1f}" for time in TIMES], index=table.index)
    )


def test_behind_a_constant_speed_hosts_crash_as_the_snapshot_predicts():
    generator = np.random.default_rng(1)
    found = crashes(with_courses(cut_ins(4000), 0), CONSTANT, generator)
    assert set(found["host"]) == set(HOSTS)
    assert (found.groupby("host")["counted"].sum() > 100).all()
    humans = found[found["host"] == "human"]  # each time another driver
    assert humans["counted"].mean() == pytest.approx(humans["snapshot"].mean(), abs=0.03)
    found = found[found["host"] != "human"]
    np.testing.assert_array_equal(found["counted"], found["snapshot"])
    np.testing.assert_array_equal(found["constant"], found["snapshot"])
    other = crashes(with_courses(cut_ins(1000), -3), {"ngsim": MOTIONS["ngsim"]()}, generator)
    assert (other["counted"] != other["snapshot"]).sum() > 50
    assert other["ngsim"].between(0.1, 0.9).any()


def test_behind_a_braking_car_a_host_that_does_nothing_crashes_where_the_formula_says_so():
    """Both keep an acceleration, so the gap is a parabola, smallest at the end as the lead brakes."""
    car, table = load_vehicle("acc_only", kp=0.0, ki=0.0), cut_ins(4000)
    table = table[(table["lead_speed"] > 20) & (table["lead_speed"] + table["closing_speed"] < 35)]
    brake, end = 2.0, 8.0
    gap = table["range"] - table["closing_speed"] * end - brake * end**2 / 2
    expected = (gap <= 0).to_numpy()
    assert 50 < expected.sum() < len(table) - 5
    courses = recorded_courses(with_courses(table, -brake))
    np.testing.assert_array_equal(car.simulate_moving(*encounters_of(table), courses).crash, expected)


def test_a_car_that_has_left_the_lane_is_not_hit():
    car = load_vehicle("acc_only", kp=0.0, ki=0.0)
    table = pd.DataFrame({"lead_speed": [20.0] * 2, "range": [20.0] * 2, "closing_speed": [10.0] * 2})
    table = with_courses(table, 0)
    table.loc[0, [f"speed_{time:.1f}" for time in TIMES if time > 1.6]] = np.nan
    found = car.simulate_moving(*encounters_of(table), recorded_courses(table)).crash
    np.testing.assert_array_equal(found, [False, True])  # the hosts would arrive after 2 s


def test_counts_of_cells_add_up():
    table = with_courses(cut_ins(3000), -4)
    generator = np.random.default_rng(2)
    whole = summed([counted(table, CONSTANT, generator)])
    both = summed([counted(part, CONSTANT, generator) for part in (table.iloc[:1500], table.iloc[1500:])])
    keys = ["host", "gap", "range_from"]
    one, two = (each.sort_values(keys).reset_index(drop=True) for each in (whole, both))
    assert (one.groupby("host")["cut_ins"].sum() == len(table)).all()
    one, two = (each[each["host"] != "human"].reset_index(drop=True) for each in (one, two))
    pd.testing.assert_frame_equal(one, two)
    enough = one[one["counted"] >= 10]
    assert len(enough) > 3
    expected = enough["snapshot"] / enough["counted"]
    np.testing.assert_allclose(enough["snapshot_to_counted"], expected, atol=5e-4)


def test_the_chain_predicts_the_crashes_of_a_known_world(monkeypatch):
    """All cut-ins are of one population, so that the interval should contain a count of thousands of them."""
    monkeypatch.setattr(chain, "DRAWS", 20)
    monkeypatch.setattr(chain, "CUT_INS", 1000)
    monkeypatch.setattr(chain, "MEMBERS", chain.members_at(()))
    monkeypatch.setattr(chain.SmoothFamily, "of", partial(chain.SmoothFamily.of, blocks=2))
    generator = np.random.default_rng(4)
    size = 4000
    range_ = generator.uniform(10, 70, size)
    columns = {"lead_speed": generator.uniform(10, 30, size), "range": range_}
    table = pd.DataFrame(columns | {"closing_speed": generator.exponential(0.06 * range_)})
    table = with_courses(table, -1.5).assign(time=np.arange(size) * 1.2)
    found = chain.chain(table.iloc[:500], table.iloc[500:], generator).set_index(["host", "prediction"])
    moving = found.xs("recorded", level="prediction")
    assert (moving["counted"] > 20).sum() >= 2
    often = moving[moving["counted"] > 20]
    assert often["counted"].between(0.8 * often["low95"], 1.2 * often["high95"]).all()
    # A constant lead speed would be the wrong chain.
    still = found.xs("snapshot", level="prediction").loc[often.index]
    assert (still["median"] < 0.8 * often["counted"]).any()


def test_resampled_minutes_vary_as_much_as_traffic_that_changes_from_minute_to_minute():
    """All 20 cut-ins of a minute are alike, so that the mean of 50 minutes has the variance of 50 values."""
    generator = np.random.default_rng(8)
    minutes = generator.normal(size=50)
    table = pd.DataFrame({"time": np.arange(1000) * 3.0, "value": np.repeat(minutes, 20)})
    means = [chain.resampled(table, generator)["value"].mean() for _ in range(400)]
    expected = minutes.std() / np.sqrt(50)
    assert np.std(means) == pytest.approx(expected, rel=0.15)
    singles = [table["value"].sample(frac=1, replace=True, random_state=generator).mean() for _ in range(400)]
    assert np.std(singles) < 0.5 * expected


@pytest.mark.parametrize("step", [6.0, 1.0])  # [s] between two of 90 records, and of 200 in 3.3 minutes
def test_a_recording_that_is_too_short_gives_counts_without_a_prediction(step):
    table = with_courses(cut_ins(4000), -4)
    table = table[table["closing_speed"] > 0].reset_index(drop=True)
    records = table.iloc[: 90 if step == 6 else 200]
    records = records.assign(time=step * np.arange(len(records)))
    found = chain.chain(records, table, np.random.default_rng(9))
    assert (found["counted"] > 0).any()
    assert found[list(chain.LEVELS)].isna().all(axis=None)


def test_worlds_in_which_nothing_happens_have_tables():
    """Ten cut-ins without a crash, a recording without a cut-in, and a chain without a prediction."""
    still = pd.DataFrame({"lead_speed": [20.0] * 10, "range": [50.0] * 10, "closing_speed": [0.5] * 10})
    table = with_courses(still, 0)
    counts = summed([counted(table, CONSTANT, np.random.default_rng(3))])
    assert (counts["counted"] == 0).all()
    assert counts["snapshot_to_counted"].isna().all()
    known = trajectories().cut_ins().iloc[:0]
    _, row = compared(known, known)
    assert (row["known"], row["found"]) == (0, 0)
    assert np.isnan([row["recall"], row["false"]]).all()
    predicted = chain.chain(table.assign(time=0.0), table, np.random.default_rng(4))
    assert predicted["median"].isna().all()


def trajectories() -> Trajectories:
    """Return a lorry, two cars that cut in, one of them for 2 s, and cars that they cut in on; at 20 m/s."""
    frames = np.arange(100)
    cars = [  # begin [m], lane in each frame, speed [m/s], length [m]
        (100, np.zeros(100), 20, CAR),
        (150, np.where(frames < 20, 1, 0), 20, CAR),
        (100, np.full(100, 2), 25, CAR),
        (160, np.where((frames >= 20) & (frames < 30), 2, 1), 20, CAR),
        (60, np.full(100, 1), 20, LORRY),
    ]
    parts = [
        (np.full(100, number), frames, lane, begin + speed * frames / RATE, np.full(100, speed), length)
        for number, (begin, lane, speed, length) in enumerate(cars)
    ]
    columns = [np.concatenate([np.broadcast_to(part[k], 100) for part in parts]) for k in range(6)]
    whole = [column.astype(np.int64) for column in columns[:3]]
    return Trajectories(*whole, *(column.astype(float) for column in columns[3:]))


def test_cut_ins_of_known_trajectories():
    table = trajectories().cut_ins()
    assert table[["time", "vehicle", "host"]].to_numpy().tolist() == [[4, 1, 0], [4, 3, 2]]
    np.testing.assert_allclose(table["range"], [50 - CAR, 60 - 5 * 4 - CAR])
    np.testing.assert_allclose(table["closing_speed"], [0, 5])
    assert table["counts"].all()
    courses = table.filter(like="speed_").drop(columns=["lead_speed", "closing_speed"], errors="ignore")
    assert courses.notna().sum(axis=1).tolist() == [40, 9]


@pytest.mark.parametrize(
    ("later", "minutes", "count"),
    [
        (0, [0], 2),
        (420, [7], 2),
        (420, [0, 6], 0),  # the cut-ins begin after 4 s, so that the recording of minute 6 has them, too
        (420, [6, 7], 2),
        (417, [6, 7], 2),  # one second after the beginning of a minute
        (416, [7], 2),  # at its beginning
    ],
)
def test_extract_finds_the_cut_ins_of_recorded_minutes(tmp_path, later, minutes, count):
    found = trajectories()
    found = replace(found, frame=found.frame + round(later * RATE))
    write_recordings(tmp_path / "recording", found, minutes)
    known = in_minutes(found.cut_ins(), minutes)
    for rule in RULES:
        data = load([tmp_path / "recording" / f"{rule}.yaml"])["data"]
        extracted = in_minutes(SOURCES["highd"].read(data["highd"]), minutes)
        records, row = compared(known, extracted)
        assert (len(known), row["both"], len(records)) == (count, count, count)
        if count:
            assert (row["recall"], row["false"]) == (1, 0)
            assert row["difference"] < 1e-3
    if count:
        _, row = compared(known.iloc[:1], extracted)
        assert row["false"] == 0.5


@pytest.mark.parametrize(
    ("text", "seen"),
    [
        ("flow: -1", "mine.yaml, flow: seen -1; expected number >= 1 and <= 30,000"),
        ("headway: [0.5]", r"headway: seen \[0.5\]; expected list of 2, each number >= 0.1 and <= 10"),
        ("worlds: 2.5", "worlds: seen 2.5; expected integer >= 1 and <= 1,000"),
        ("road: 2", "'road'; expected settings of a motorway: worlds, hours"),
    ],
)
def test_settings_that_no_motorway_has(tmp_path, text, seen):
    (tmp_path / "mine.yaml").write_text(text)
    with pytest.raises(InputError, match=seen):
        read_settings(str(tmp_path / "mine.yaml"))


def test_settings_are_read(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("flow: 5000\nheadway: [0.5, 1.1]\n")
    expected = Motorway(flow=5000, headway=(0.5, 1.1), hours=0.5)
    assert read_settings(str(path), {"hours": 0.5}) == expected
    assert read_settings(str(ROOT / "benchmarks/motorway/settings.yaml")) == Motorway()


@pytest.mark.parametrize(
    ("script", "message"),
    [
        ("kill -9 $$", "sumo of Eclipse SUMO ended with status -9. .*Run the same command again"),
        ("echo Error: no road >&2; exit 1", "ended with status 1: Error: no road"),
    ],
)
def test_a_simulation_that_is_killed_ends_with_one_message(tmp_path, monkeypatch, script, message):
    (tmp_path / "bin").mkdir()
    program = tmp_path / "bin" / "sumo"
    program.write_text(f"#!/bin/sh\n{script}\n")
    program.chmod(0o755)
    monkeypatch.setitem(sys.modules, "sumo", SimpleNamespace(SUMO_HOME=tmp_path))
    with pytest.raises(StudyError, match=message):
        run_sumo("sumo")


def test_without_sumo_the_message_says_how_to_install_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "sumo", None)
    with pytest.raises(InputError, match="no Eclipse SUMO; expected the package eclipse-sumo"):
        simulate(Motorway(), Part(1, 0, 0, 0.01))


def test_a_motorway_of_sumo_has_cut_ins():
    pytest.importorskip("sumo", reason="Eclipse SUMO is not installed; see benchmarks/README.md")
    found = simulate(Motorway(), Part(1, 0, 0, 0.02))
    table = found.cut_ins()
    assert len(table) > 50
    assert (table["range"] > 0).all()
    assert found.front.max() < LENGTH + 50
    assert recorded_courses(table.query("counts")).min() >= 0


def test_a_motorway_without_vehicles_ends_with_one_message():
    pytest.importorskip("sumo", reason="Eclipse SUMO is not installed; see benchmarks/README.md")
    with pytest.raises(InputError, match=r"flow: seen 1 vehicles an hour, none of them .* Set a larger flow"):
        simulate(Motorway(flow=1), Part(1, 0, 0, 0.01))


def test_no_queue_grows_at_the_entry_of_a_crowded_motorway():
    """Vehicles are numbered by arrival. Without a limit they would have waited for 450 s here."""
    pytest.importorskip("sumo", reason="Eclipse SUMO is not installed; see benchmarks/README.md")
    found = simulate(Motorway(flow=8_000), Part(1, 0, 0, 0.01))
    _, first = np.unique(found.vehicle, return_index=True)
    enters = first[found.frame[first] > 0]
    waited = WARM_UP + found.frame[enters] / RATE - found.vehicle[enters] / 8_000 * 3600
    assert 0 < waited.max() < 2 * PATIENCE
