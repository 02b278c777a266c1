"""Lead motion: constant as before, the statistics of the recorded profiles, and bad input."""

import numpy as np
import pytest
from accelerated_evaluation import InputError, load_vehicle
from accelerated_evaluation.laws.motion import MOTIONS, STATES, STEP, draw_lead_speeds

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


def human_encounters(size=2000):
    """Cut-ins with drivers, whose approach ends before the horizon if the lead vehicle keeps its speed."""
    generator = np.random.default_rng(6)
    cut_ins = generator.uniform(5, 35, size), generator.uniform(2, 75, size), generator.uniform(5, 20, size)
    return load_vehicle("human"), cut_ins, load_vehicle("human").draw_inner(size, generator)


def test_a_constant_lead_gives_the_same_outcomes_of_human_drivers():
    human, cut_ins, drivers = human_encounters()
    speeds = np.repeat(cut_ins[0][:, None], STATES, axis=1)
    moving = human.simulate_moving_given(*cut_ins, speeds, drivers)
    still = human.simulate_given(*cut_ins, drivers)
    assert 200 < still.crash.sum() < 1800
    np.testing.assert_array_equal(moving.crash, still.crash)
    np.testing.assert_allclose(moving.min_range, still.min_range, atol=1e-6)
    np.testing.assert_allclose(moving.impact_speed, still.impact_speed, atol=1e-6)
    # Without steps the smallest time to collision is exact, with steps it is that of one of the states.
    safe = ~still.crash
    assert np.all(moving.min_ttc[safe] > still.min_ttc[safe] - 1e-9)
    np.testing.assert_allclose(moving.min_ttc[safe], still.min_ttc[safe], rtol=0.05)


def test_a_lead_that_changes_its_speed_changes_the_crashes_of_human_drivers():
    human, cut_ins, drivers = human_encounters()
    times = STEP * np.arange(STATES)
    still = human.simulate_given(*cut_ins, drivers).crash
    slower, faster = (
        human.simulate_moving_given(
            *cut_ins, np.maximum(cut_ins[0][:, None] + each * times, 0), drivers
        ).crash
        for each in (-4, 2)
    )
    assert faster.sum() < still.sum() < slower.sum()
    late = load_vehicle("human", delay=0.7)
    braking = np.maximum(cut_ins[0][:, None] - times, 0)
    crashes = [each.simulate_moving_given(*cut_ins, braking, drivers).crash.sum() for each in (human, late)]
    assert crashes[0] < crashes[1]


def test_a_driver_behind_a_lead_that_stops_by_hand():
    """The lead vehicle brakes with 8 m/s^2 from the start, and the driver with 4 from the first step later.

    The driver needs no time to respond, and brakes fully as soon as the gap closes.
    """
    driver = np.array([[1e-9, 1.0, 5.0, 4.0, 1e9, 0.0, 1.0]])  # the traits of human_kernel
    human = load_vehicle("human", margin=0.0, hard_braking=1e-9)
    times = STEP * np.arange(STATES)
    stops = np.maximum(20 - 8 * times, 0)[None]
    outcomes = human.simulate_moving_given(
        [20.0, 20.0], [10.0, 80.0], [0.0, 0.0], stops[[0, 0]], driver[[0, 0]]
    )
    assert outcomes.crash.tolist() == [True, False]
    for start, impact, least in zip([10.0, 80.0], outcomes.impact_speed, outcomes.min_range, strict=True):
        speed, gap, ends = 20.0, start, None
        braking = False
        for k in range(STATES - 1):
            closing = speed - stops[0, k]
            braking = braking or closing > 0
            slower = max(speed - 4 * STEP * braking, 0.0)
            closer = (speed + slower - stops[0, k] - stops[0, k + 1]) / 2 * STEP
            if closer >= gap:
                ends = closing + (slower - stops[0, k + 1] - closing) * gap / closer
                break
            speed, gap = slower, gap - closer
        assert impact == pytest.approx(ends or 0.0, abs=1e-6)
        assert least == pytest.approx(0.0 if ends else gap, abs=1e-6)


def test_an_opening_gap_may_end_in_a_crash():
    vehicle, times = load_vehicle("cc_human"), STEP * np.arange(STATES)
    stops = np.maximum(20 - 8 * times, 0)[None]
    assert vehicle.simulate_moving([20.0], [10.0], [-1.0], stops).crash[0]
    assert not vehicle.simulate([20.0], [10.0], [-1.0]).crash[0]


def test_profiles_have_the_statistics_of_the_recorded_ones():
    speeds = draw_lead_speeds(MOTIONS["ngsim"](), np.full((3, 20_000), 30.0), np.random.default_rng(3))
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
@pytest.mark.parametrize("name", ["acc_aeb", "rss", "human"])
def test_bad_lead_speeds_end_with_one_message(name, change, message):
    speeds = np.full((2, 81), 20.0)
    with pytest.raises(InputError, match=message):
        load_vehicle(name).simulate_moving([20.0, 20.0], [10.0, 10.0], [5.0, 5.0], change(speeds))
