"""The synthetic worlds: crash probabilities against draws, records, and the table of causes by hand."""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.crash_map.mapping import map_crashes
from accelerated_evaluation.crash_map.maps import Grid
from accelerated_evaluation.laws.smooth.family import DistinctRecords, Fitter, members_at
from accelerated_evaluation.laws.smooth.support import SUPPORT
from rate_car import RateCar

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "benchmarks" / "worlds"))

import causes  # noqa: E402
import kinds  # noqa: E402
from setting import WorldSettings, runs_of, simulate_records  # noqa: E402

SIZE = 8_000
DRAWN = 400_000
SMOOTH = ("exponential", "heavy", "light", "two kinds")


@pytest.fixture(scope="module")
def events():
    generator = np.random.default_rng(1)
    lead_speed = generator.uniform(5, 34.9, SIZE)
    range_ = SUPPORT.range_max * generator.uniform(0, 1, SIZE) ** 0.5
    return DistinctRecords(lead_speed, range_, 2.0 * generator.standard_exponential(SIZE))


@pytest.fixture(scope="module")
def family(events):
    return Fitter(events, members_at((kinds.LEVEL,))).fit()


@pytest.fixture(scope="module")
def lines(events):
    crash_map = map_crashes(RateCar(), Grid(5, 35, 75, 8, 60, 4, 45.0, 240), [], np.random.default_rng(2))
    return CrashLines.of(crash_map, events.lead_speed)


def crash_share(world, events, seed):
    generator = np.random.default_rng(seed)
    drawn = world.draw(generator.choice(events.lead_speed, DRAWN), generator)
    return np.mean(RateCar().simulate(drawn.lead_speed, drawn.range_, drawn.closing_speed).crash)


@pytest.mark.parametrize("kind", SMOOTH)
def test_the_known_probability_is_that_of_the_draws(kind, events, family, lines):
    of = kinds.worlds(family, None)
    exact = of[kind].masses(lines).sum()
    error = np.sqrt(exact / DRAWN)
    # Beside the error of the draws, a line stands for its cell of the map.
    assert crash_share(of[kind], events, 3) == pytest.approx(exact, abs=4 * error + 0.01 * exact)


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


def test_causes_by_hand():
    rows = pd.DataFrame(
        {
            "kind": ["heavy"] * 3,
            "threshold_ratio": [1.0, 2.0, 3.0],
            "held": [True, True, False],
            "width": [2.0, 4.0, 9.0],
            "true_law_held": [True, False, False],
            "true_law_width": [1.5, 1.0, 3.0],
        }
    )
    (row,) = causes.tabulate(rows).to_dict("records")
    assert [row[name] for name in ("kind", "worlds", "width80", "true_law_width80")] == ["heavy", 3, 4, 1.5]
    assert [row[f"ratio_{level}"] for level in (10, 50, 90)] == pytest.approx([1.2, 2.0, 2.8])
    assert [row["coverage80"], row["true_law_coverage80"]] == pytest.approx([2 / 3, 1 / 3])
