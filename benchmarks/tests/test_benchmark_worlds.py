"""The synthetic worlds: crash probabilities against draws, records, and the tables by hand."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.crash_map.mapping import map_crashes
from accelerated_evaluation.laws.smooth.family import Fitter, members_at
from builders import coarse_grid

pytestmark = pytest.mark.studies
ROOT = Path(__file__).resolve().parents[2]
sys.path += [str(ROOT / "benchmarks" / "worlds"), str(ROOT / "tests" / "unit")]

import beyond  # noqa: E402
import kinds  # noqa: E402
from rate_car import RateCar, exponential_records  # noqa: E402
from setting import WorldSettings, runs_of, simulate_records  # noqa: E402
from summarise_worlds import tabulate  # noqa: E402

SIZE = 8_000
DRAWN = 400_000
SMOOTH = ("exponential", "heavy", "light", "two kinds")
BEYOND = pd.read_csv(ROOT / "benchmarks" / "results" / "worlds.csv").query("beyond")["kind"]


@pytest.fixture(scope="module")
def events():
    return exponential_records(SIZE, 2.0)


@pytest.fixture(scope="module")
def family(events):
    return Fitter(events, members_at((kinds.LEVEL,))).fit()


@pytest.fixture(scope="module")
def lines(events):
    crash_map = map_crashes(
        RateCar(),
        coarse_grid(speeds=(5, 35, 8), ranges=(75, 60), closing=(45.0, 240), refinement=4),
        [],
        np.random.default_rng(2),
    )
    return CrashLines.of(crash_map, events.lead_speed)


def crash_share(world, events, seed, size=DRAWN):
    generator = np.random.default_rng(seed)
    drawn = world.draw(generator.choice(events.lead_speed, size), generator)
    return np.mean(RateCar().simulate(drawn.lead_speed, drawn.range_, drawn.closing_speed).crash)


@pytest.mark.parametrize("kind", SMOOTH)
def test_the_known_probability_is_that_of_the_draws(kind, events, family, lines):
    of = kinds.worlds(family, None)
    exact = of[kind].masses(lines).sum()
    error = np.sqrt(exact / DRAWN)
    # Beside the error of the draws, a line stands for its cell of the map.
    assert crash_share(of[kind], events, 3) == pytest.approx(exact, abs=4 * error + 0.01 * exact)


@pytest.mark.parametrize("kind", BEYOND)
def test_the_known_probability_beyond_the_family_is_that_of_the_draws(kind, events, family, lines):
    world = beyond.worlds_beyond(family)[kind]
    if kind == "few drivers":
        world = replace(world, cut_ins=1)  # independent draws, with the error below
    exact, size = world.masses(lines).sum(), DRAWN // 4
    error = np.sqrt(exact / size)
    assert crash_share(world, events, 5, size) == pytest.approx(exact, abs=4 * error + 0.01 * exact)


def test_no_host_exceeds_the_limit(events, family):
    drawn = beyond.worlds_beyond(family)["host speed limit"].draw(events.lead_speed, np.random.default_rng(6))
    fastest = np.maximum(beyond.HOST_MAX - drawn.lead_speed, beyond.LEAST_CLOSING)
    assert np.all(drawn.closing_speed <= fastest)
    assert np.any(events.closing_speed > beyond.HOST_MAX - events.lead_speed)


def test_each_driver_of_few_makes_many_cut_ins(family):
    """Runs of cut-ins by one driver are faster or slower as a whole, which independent ones are not."""
    lead_speed = np.full(20_000, 20.0)
    world = beyond.worlds_beyond(family)["few drivers"]
    spreads = []
    for own in (world, replace(world, cut_ins=1)):
        speeds = own.draw(lead_speed, np.random.default_rng(7)).closing_speed
        spreads.append(speeds.reshape(-1, beyond.CUT_INS).mean(axis=1).std())
    assert spreads[0] > 1.2 * spreads[1]


def test_a_world_without_its_second_kind_of_drivers_is_told_apart(events, family, lines):
    of = kinds.worlds(family, None)
    exact = of["two kinds"].masses(lines).sum()
    error = np.sqrt(exact / DRAWN)
    assert abs(crash_share(of["exponential"], events, 3) - exact) > 4 * error + 0.01 * exact


def test_records_of_a_world_have_the_size_and_the_repeats_of_the_recorded_ones(events, family, lines):
    lengths = np.r_[np.full(40, 3), np.ones(SIZE - 40, int)]
    setting = WorldSettings(events.lead_speed, lengths, family, None, None, lines)
    world = kinds.worlds(family, None)["exponential"]
    records = simulate_records(world, setting, np.random.default_rng(4))
    distinct, found = runs_of(records)
    assert len(records) == lengths.sum()
    assert len(distinct) == SIZE
    np.testing.assert_array_equal(np.sort(found), np.sort(lengths))


def test_the_table_by_hand():
    ends = {
        f"{end}{level:g}": value for level in (0.5, 0.8, 0.95) for end, value in (("low", 1.0), ("high", 5.0))
    }
    one = {"kind": "bent tail", "procedure": "this project", "beyond": True, "truth": 4.0, **ends}
    one |= {"probability": 2.0, "mean": 6.0}
    row = tabulate(pd.DataFrame([one, one | {"probability": 8.0, "high0.5": 3.0, "low0.8": 4.5}])).loc[0]
    assert row[["kind", "procedure", "beyond", "worlds"]].tolist() == ["bent tail", "this project", True, 2]
    assert row[["coverage50", "coverage80", "coverage95"]].tolist() == [0.5, 0.5, 1.0]
    expected = [1.25, 1.5, 0.65, 1.85, (5 + 5 / 4.5) / 2]
    names = ["median_ratio", "mean_ratio", "ratio_10", "ratio_90", "width80"]
    np.testing.assert_allclose(row[names].astype(float), expected)
    assert row[["truth_above80", "truth_below80"]].tolist() == [0, 0.5]
    assert row["coverage50_low"] == pytest.approx(1 - 0.975**0.5, rel=1e-6)  # one hit of two
