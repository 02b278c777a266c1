"""The motorway whose crashes are counted: hosts behind known courses, settings, and a few minutes of SUMO."""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.laws.motion import MOTIONS
from accelerated_evaluation.vehicles import load_vehicle

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "benchmarks" / "motorway"))

from count import HOSTS, counted, crashes, lead_speeds, summed  # noqa: E402
from traffic import NAMES, SAMPLED, Motorway, drive, settings  # noqa: E402

TIMES = np.arange(51) * SAMPLED


def cut_ins(size: int, seed: int = 5) -> pd.DataFrame:
    generator = np.random.default_rng(seed)
    columns = generator.uniform((5, 1, -5), (35, 60, 20), (size, 3))
    table = pd.DataFrame(columns, columns=list(NAMES)).assign(seen=10.0)
    return table[table["lead_speed"] + table["closing_speed"] > 0]


def with_courses(table: pd.DataFrame, courses: np.ndarray) -> pd.DataFrame:
    names = [f"speed_{index:03d}" for index in range(courses.shape[1])]
    return table.reset_index(drop=True).join(pd.DataFrame(courses, columns=names))


@pytest.mark.parametrize("host", HOSTS)
def test_behind_a_constant_speed_a_host_crashes_as_the_snapshot_predicts(host):
    name, parameters = HOSTS[host]
    car, table = load_vehicle(name, **parameters), cut_ins(4000)
    courses = np.tile(table[["lead_speed"]].to_numpy(), TIMES.size)
    generator = np.random.default_rng(1)
    found = crashes(car, with_courses(table, courses), MOTIONS["constant"](), generator)
    assert 100 < found["counted"].sum() < 3900
    np.testing.assert_array_equal(found["counted"], found["snapshot"])
    np.testing.assert_array_equal(found["motion"], found["snapshot"])
    braking = with_courses(table, np.maximum(courses - 3 * TIMES, 0))
    other = crashes(car, braking, MOTIONS["ngsim"](), generator)
    assert (other["counted"] != other["snapshot"]).sum() > 50
    assert np.any((other["motion"] > 0) & (other["motion"] < 1))


def test_behind_a_braking_car_a_host_that_does_nothing_crashes_where_the_formula_says_so():
    """Both keep an acceleration, so the gap is a parabola, smallest at the end as the lead brakes."""
    car, table = load_vehicle("acc_only", kp=0.0, ki=0.0), cut_ins(4000)
    table = table[(table["lead_speed"] > 20) & (table["lead_speed"] + table["closing_speed"] < 35)]
    brake, end = 2.0, 8.0
    gap = table["range"] - table["closing_speed"] * end - brake * end**2 / 2
    expected = (gap <= 0).to_numpy()
    assert 50 < expected.sum() < len(table) - 5
    braking = with_courses(table, table[["lead_speed"]].to_numpy() - brake * TIMES)
    found = car.simulate_moving(*(table[name] for name in NAMES), lead_speeds(braking)).crash
    np.testing.assert_array_equal(found, expected)


def test_a_car_that_has_left_the_lane_is_not_hit():
    car = load_vehicle("acc_only", kp=0.0, ki=0.0)
    table = pd.DataFrame({"lead_speed": [20.0] * 2, "range": [20.0] * 2, "closing_speed": [10.0] * 2})
    table = with_courses(table.assign(seen=[1.6, 2.4]), np.full((2, TIMES.size), 20.0))
    found = car.simulate_moving(*(table[name] for name in NAMES), lead_speeds(table)).crash
    np.testing.assert_array_equal(found, [False, True])  # the hosts would arrive after 2 s


def test_counts_of_cells_add_up():
    table = cut_ins(3000)
    table = with_courses(table, np.maximum(table[["lead_speed"]].to_numpy() - 4 * TIMES, 0))
    generator = np.random.default_rng(2)
    one = counted(table, generator).drop(columns="motion")
    both = summed([counted(part, generator) for part in (table.iloc[:1500], table.iloc[1500:])])
    keys = ["host", "gap", "range_from"]
    one, both = (each.sort_values(keys).reset_index(drop=True) for each in (one, both))
    pd.testing.assert_frame_equal(both[list(one.columns)], one)
    assert (one.groupby("host")["cut_ins"].sum() == len(table)).all()
    enough = both[both["counted"] >= 10]
    assert len(enough) > 3
    expected = enough["snapshot"] / enough["counted"]
    np.testing.assert_allclose(enough["snapshot_to_counted"], expected, atol=5e-4)


@pytest.mark.parametrize(
    ("text", "seen"),
    [
        ("flow: -1", "-1"),
        ("headway: [0.5]", r"\[0.5\]"),
        ("lanes: 2", "'lanes'"),
        ("[1, 2]", r"\[1, 2\]"),
        ("a: [", "while parsing"),
    ],
)
def test_settings_that_no_motorway_has(tmp_path, text, seen):
    (tmp_path / "mine.yaml").write_text(text)
    with pytest.raises(InputError, match=seen):
        settings(str(tmp_path / "mine.yaml"))


def test_settings_are_read(tmp_path):
    (tmp_path / "mine.yaml").write_text("flow: 5000\nheadway: [0.5, 1.1]\n")
    assert settings(str(tmp_path / "mine.yaml")) == Motorway(flow=5000, headway=(0.5, 1.1))


def test_a_motorway_of_sumo_has_cut_ins(tmp_path):
    pytest.importorskip("libsumo", reason="Eclipse SUMO is not installed; see benchmarks/README.md")
    table, traffic = drive(Motorway(), tmp_path, seed=1, hours=0.02)
    assert len(table) > 50
    assert traffic["kilometres"].item() > 100
    assert (table["range"] > 0).all()
    assert table["seen"].between(0, 10).all()
    np.testing.assert_allclose(table["speed_000"], table["lead_speed"], rtol=1e-6)
