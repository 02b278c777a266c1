"""Lead motion: constant as before, the statistics of the recorded profiles, and bad input."""

import itertools

import numpy as np
import pytest
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.laws.motion import MOTIONS, STATES, STEP, draw_lead_speeds
from accelerated_evaluation.vehicles.loading import load_vehicle

VEHICLES = ["acc_aeb", "acc_only", "cc_human", "fsm", "reg157", "rss"]


def encounters(size, seed=1):
    generator = np.random.default_rng(seed)
    return generator.uniform(5, 35, size), generator.uniform(2, 75, size), generator.uniform(0, 20, size)


@pytest.mark.parametrize("name", VEHICLES)
def test_a_constant_lead_gives_the_same_bits(name):
    vehicle, cut_ins = load_vehicle(name), encounters(3000)
    speeds = MOTIONS["constant"]().lead_speeds(np.stack(cut_ins), np.empty((3000, 0)))
    moving, still = vehicle.simulate_moving(*cut_ins, speeds), vehicle.simulate(*cut_ins)
    assert 100 < still.crash.sum() < 2900
    np.testing.assert_array_equal(moving.crash, still.crash)
    np.testing.assert_allclose(moving.impact_speed, still.impact_speed, atol=1e-9)
    if name in ("acc_aeb", "acc_only"):
        np.testing.assert_array_equal(moving.min_range, still.min_range)
        np.testing.assert_array_equal(moving.min_ttc, still.min_ttc)
    np.testing.assert_allclose(moving.min_range, still.min_range, atol=1e-9)


@pytest.mark.parametrize("name", VEHICLES)
def test_a_lead_that_brakes_causes_crashes_and_one_that_accelerates_prevents_them(name):
    vehicle, cut_ins = load_vehicle(name), encounters(3000, 2)
    times = STEP * np.arange(STATES)
    still = vehicle.simulate(*cut_ins).crash
    braking = vehicle.simulate_moving(*cut_ins, np.maximum(cut_ins[0][:, None] - 4 * times, 0)).crash
    faster = vehicle.simulate_moving(*cut_ins, cut_ins[0][:, None] + 2 * times).crash
    assert faster.sum() < still.sum() < braking.sum()


def test_an_opening_gap_may_end_in_a_crash():
    vehicle, times = load_vehicle("cc_human"), STEP * np.arange(STATES)
    stops = np.maximum(20 - 8 * times, 0)[None]
    assert vehicle.simulate_moving([20.0], [10.0], [-1.0], stops).crash[0]
    assert not vehicle.simulate([20.0], [10.0], [-1.0]).crash[0]


def test_profiles_have_the_statistics_of_the_recorded_ones():
    speeds = draw_lead_speeds(MOTIONS["ngsim"](), np.full((3, 50_000), 30.0), np.random.default_rng(3))
    change = speeds - 30
    assert (speeds[:, 0] == 30).all()
    # Of 13,602 recorded profiles: after 5 s -0.27 and 1.85 m/s; 7.7 % fall by more than 3 m/s, 1.1 % by 5.
    assert change[:, 50].mean() == pytest.approx(-0.27, abs=0.05)
    assert change[:, 50].std() == pytest.approx(1.85, rel=0.04)
    assert (change[:, :51].min(axis=1) < -3).mean() == pytest.approx(0.077, abs=0.01)
    assert (change[:, :51].min(axis=1) < -5).mean() == pytest.approx(0.0114, abs=0.004)
    # Smooth: the acceleration is bounded, and does not jump.
    acceleration = np.diff(speeds, axis=1) / STEP
    assert np.abs(acceleration).max() < 12
    assert np.quantile(np.abs(np.diff(acceleration, axis=1)), 0.999) < 1.5


def test_no_speed_is_negative():
    speeds = draw_lead_speeds(MOTIONS["ngsim"](), np.full((3, 20_000), 1.0), np.random.default_rng(4))
    assert speeds.min() == 0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda speeds: speeds[:, :-1], r"seen an array of shape \(2, 80\); expected 2 rows of 81 speeds"),
        (lambda speeds: speeds[:1], "expected 2 rows"),
        (
            lambda speeds: speeds - 21 * (np.arange(81) == 30),
            r"encounter 0, at 3 s: seen -1.0; expected a speed",
        ),
        (
            lambda speeds: np.where(np.arange(81) == 7, np.nan, speeds),
            "at 0.7 s: seen nan; expected a finite",
        ),
        (lambda speeds: speeds + 1, "at 0 s: seen 21.0; expected the lead speed"),
    ],
)
@pytest.mark.parametrize("name", ["acc_aeb", "rss"])
def test_bad_lead_speeds_end_with_one_message(name, change, message):
    speeds = np.full((2, 81), 20.0)
    with pytest.raises(InputError, match=message):
        load_vehicle(name).simulate_moving([20.0, 20.0], [10.0, 10.0], [5.0, 5.0], change(speeds))


def test_strata_contain_every_closing_speed_once():
    from accelerated_evaluation.answer.lead_motion import DISTANCES, SIZES, strata
    from accelerated_evaluation.crash_map.mapping import map_crashes
    from accelerated_evaluation.crash_map.maps import Grid
    from accelerated_evaluation.vehicles.events import CRASH

    crash_map = map_crashes(
        load_vehicle("acc_aeb"), Grid(5, 35, 75, 4, 8, 1, 45.0, 60), [], np.random.default_rng(5)
    )
    parts = [part.intervals(CRASH) for part in strata(crash_map)]
    assert len(parts) == len(DISTANCES) + 1 == len(SIZES)
    for line in range(crash_map.lead_speed.size):
        own = sorted((p.start[p.line == line][0], p.end[p.line == line][0]) for p in parts if line in p.line)
        assert own[0][0] == 0
        assert own[-1][1] == np.inf
        assert all(end == start for (_, end), (start, _) in itertools.pairwise(own))
    crashes = crash_map.intervals(CRASH)
    first = dict(zip(crashes.line[::-1], crashes.start[::-1], strict=True))
    assert dict(zip(parts[0].line, parts[0].start, strict=True)) == first
