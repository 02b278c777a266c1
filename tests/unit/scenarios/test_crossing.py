"""The car in the left turn and the pedestrian crossing, against stored verdicts and plain integration."""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import plain_crossing
import pytest
from accelerated_evaluation import SCENARIOS, InputError
from accelerated_evaluation.scenarios.crossing import kernel
from accelerated_evaluation.scenarios.left_turn.vehicle import LeftTurnCar
from accelerated_evaluation.scenarios.pedestrian import CREEPING
from accelerated_evaluation.scenarios.pedestrian.vehicle import PedestrianCar
from accelerated_evaluation.vehicles import AccAeb
from accelerated_evaluation.vehicles.builtin import kernel as cut_in_kernel
from accelerated_evaluation.vehicles.protocol import checked_outcomes

ROOT = Path(__file__).parents[3]
CARS = {"left_turn": LeftTurnCar, "pedestrian": PedestrianCar}
# Slower targets make the host creep for minutes, where the last bits of the arithmetic decide.
SLOW = 0.2  # [m/s]


@cache
def verdicts(name):
    """Return the columns of the firm encounters, their verdicts, and which of their targets are slow."""
    table = pd.read_csv(ROOT / f"data/{name}/verdicts.csv.gz", dtype=str)  # as text, to keep all digits
    table = table[table["fragile"] == "0"]
    columns = table[list(SCENARIOS[name].names)].to_numpy(float).T
    return columns, table["crash"].to_numpy() == "1", np.abs(columns[1]) < SLOW


@pytest.mark.parametrize("name", CARS)
def test_the_car_agrees_with_the_stored_verdicts(name):
    columns, crash, slow = verdicts(name)
    outcomes = CARS[name]().simulate(*columns)
    assert outcomes.ended.all()
    assert (outcomes.crash == crash)[~slow].all()
    assert (outcomes.crash == crash)[slow].mean() > 0.95


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("left_turn", {"headway": 2.0}),
        ("left_turn", {"acc_limit": 5.0}),
        ("left_turn", {"actuator_jerk": 2e3}),
        ("left_turn", {"aeb": False}),
        ("pedestrian", {"headway": 2.0}),
        ("pedestrian", {"acc_limit": 5.0}),
        ("pedestrian", {"actuator_jerk": 2e3}),
        ("pedestrian", {"ki": 0.0}),
        ("pedestrian", {"aeb_ttc": 0.955}),
        ("pedestrian", {"aeb_deceleration": 10.0}),
    ],
)
def test_another_car_does_not_agree(name, change):
    columns, crash, _ = verdicts(name)
    ours = (CARS[name]().simulate(*columns).crash != crash).sum()
    assert (CARS[name](**change).simulate(*columns).crash != crash).sum() > ours


def sample(name, generator):
    """Return some encounters with fast targets: crashes, and encounters of all kinds."""
    columns, crash, slow = verdicts(name)
    fast = [np.flatnonzero(~slow & (np.abs(columns[1]) > 0.8) & (crash == kind)) for kind in (True, False)]
    return columns[:, np.concatenate([generator.choice(rows, min(12, rows.size), False) for rows in fast])]


@pytest.mark.parametrize("name", CARS)
def test_outcomes_agree_with_plain_integration(name):
    columns = sample(name, np.random.default_rng(1))
    outcomes = CARS[name]().simulate(*columns)
    plain = np.array([getattr(plain_crossing, name)(*column) for column in columns.T])
    crash = plain[:, 1] > 0
    assert 8 < crash.sum() < 16
    assert outcomes.crash.tolist() == crash.tolist()
    # Points of the plain run are 0.0005 s apart, at speeds to 45 m/s, and up to 70 m/s^2 in the turn.
    assert outcomes.min_distance == pytest.approx(plain[:, 0], abs=0.02)
    assert outcomes.impact_speed == pytest.approx(plain[:, 1], abs=0.04)


def test_the_wrong_sign_of_the_turning_car_belongs_to_the_model():
    columns, crash, slow = verdicts("left_turn")
    rows = np.flatnonzero(crash & ~slow)[::25]
    found = [plain_crossing.left_turn(*column, true_sign=True)[1] > 0 for column in columns[:, rows].T]
    assert not all(found)


@pytest.mark.parametrize("name", CARS)
def test_runs_repeat_to_the_bit_in_any_batch(name):
    columns = verdicts(name)[0][:, :200]
    batch = CARS[name]().simulate(*columns)
    alone = CARS[name]().simulate(*columns[:, 150:151])
    for column in ("crash", "ended", "min_distance", "clearance", "impact_speed", "run_time"):
        assert getattr(alone, column)[0] == getattr(batch, column)[150]


CAR = LeftTurnCar().compiled()


def control(range_, rate, speed, command=0.0, error=0.0, timer=0.0, onset=0.0, car=CAR):
    return kernel.control(car, range_, rate, speed, (command, error, timer, onset))


def commands(car, drives):
    """Return the commands of the car of cut-ins with the parameters of another car, shape (ticks, drives)."""
    own = {name: value for name, value in car._asdict().items() if name in cut_in_kernel.Car._fields}
    numbers = AccAeb().compiled()._replace(**own, step=kernel.TICK, per_decision=1.0)
    state, found = np.zeros((cut_in_kernel.FIELDS, drives.shape[2])), []
    for ranges, rates, speeds in drives:
        state[cut_in_kernel.RANGE], state[cut_in_kernel.SPEED] = ranges, speeds
        state[cut_in_kernel.LEAD] = speeds + rates
        cut_in_kernel.watch(state, state.shape[1], numbers)
        cut_in_kernel.command(state, state.shape[1], numbers)
        found.append(state[cut_in_kernel.COMMAND].copy())
    return np.array(found)


@pytest.mark.parametrize("change", [{"aeb_ttc": 0.955}, {"aeb_ttc": 2.0, "headway": 2.0}, {"aeb": False}])
def test_the_controller_is_that_of_the_car_in_cut_ins_but_for_the_threshold(change):
    """Two kernels compute ACC and AEB, one for many cut-ins at a time: neither can change alone.

    The time to collision at which the AEB brakes depends on the speed in different ways, so it is constant
    here.
    """
    car, generator = LeftTurnCar(**change).compiled(), np.random.default_rng(4)
    low, high = [[1.0], [-15.0], [1.0]], [[30.0], [5.0], [40.0]]
    drives, found = generator.uniform(low, high, (40, 3, 500)), np.zeros((40, 500))
    for k in range(drives.shape[2]):
        memory = (0.0, 0.0, 0.0, 0.0)
        for tick, (range_, rate, speed) in enumerate(drives[:, :, k]):
            memory = kernel.control(car, range_, rate, speed, memory)
            found[tick, k] = memory[0]
    np.testing.assert_allclose(commands(car, drives), found, rtol=1e-9, atol=1e-9)
    assert not np.allclose(commands(car._replace(kp=1.01 * car.kp), drives), found)


def test_the_smallest_distance_is_exact():
    generator = np.random.default_rng(3)
    times = np.linspace(0, 0.1, 2001)
    for numbers in generator.normal(0, [1, 30, 300, 1, 30, 300], (300, 6)):
        path = kernel.Path(*numbers)
        t = kernel.closest(path, 0.0, 0.1)
        ahead, aside = (np.polynomial.Polynomial(numbers[k : k + 3]) for k in (0, 3))
        square = ahead**2 + aside**2
        roots = square.deriv().roots()
        inside = roots.real[(np.abs(roots.imag) < 1e-9) & (roots.real > 0) & (roots.real < 0.1)]
        best = min(square(np.concatenate([[0, 0.1], inside])))
        assert np.sqrt(kernel.squared(path, t)) == pytest.approx(np.sqrt(best), rel=1e-7, abs=1e-7)
        assert kernel.squared(path, t) <= square(times).min() + 1e-12


def test_contact_in_the_sector_to_the_side_is_exact():
    generator = np.random.default_rng(4)
    car, times = PedestrianCar().compiled(), np.linspace(0, 0.1, 4001)
    found = 0
    for numbers in generator.normal([0, 0, 0, -1.5, 0, 0], [0.5, 10, 100, 0.5, 10, 100], (400, 6)):
        t = kernel.closest_to_the_side(car, kernel.Path(*numbers), 0.1)
        ahead, aside = (np.polynomial.Polynomial(numbers[k : k + 3])(times) for k in (0, 3))
        inside = np.abs(np.arctan2(ahead, -aside)) < np.pi / 8
        if inside.any():
            found += 1
            best = np.hypot(ahead, aside)[inside].min()
            assert np.sqrt(kernel.squared(kernel.Path(*numbers), t)) == pytest.approx(best, abs=0.02)
            assert np.sqrt(kernel.squared(kernel.Path(*numbers), t)) <= best + 1e-9
    assert found > 100


def test_a_car_that_creeps_behind_a_pedestrian_sometimes_touches_slowly():
    """The event of a harder impact and the parameter `filled` of the crash follow from this."""
    draws = np.random.default_rng(3).uniform((0, 0.3, 5), (2, 0.5, 16), (20_000, 3))
    outcomes = PedestrianCar().simulate(*draws.T)
    assert 0.01 < outcomes.crash.mean() < 0.05
    assert outcomes.impact_speed.max() < CREEPING
    near = draws[outcomes.crash] * (1 + 0.01 * np.random.default_rng(4).standard_normal((1, 3)))
    assert PedestrianCar().simulate(*near.T).crash.mean() < 0.3


def test_a_run_that_does_not_end_has_no_verdict():
    car = PedestrianCar(longest_run=5.0)
    outcomes = car.simulate([10.0, 10.0, 0.0, 10.0], [0.3, -3.0, 1.0, 0.0], [20.0, 6.0, 20.0, 20.0])
    assert outcomes.ended.tolist() == [False, True, True, False]
    assert not outcomes.crash.any()
    assert outcomes.run_time[0] == pytest.approx(5)
    still = LeftTurnCar(longest_run=5.0).simulate([10.0, 0.0], [0.0, 0.0], [50.0, 50.0])
    assert still.ended.tolist() == [False, True]
    assert not still.crash.any()


@pytest.mark.parametrize("name", CARS)
def test_a_trace_ends_as_the_simulation_does(name):
    for column in sample(name, np.random.default_rng(5)).T:
        outcomes, trace = CARS[name]().simulate(*column[:, None]), CARS[name]().trace(*column)
        assert trace["time_s"].to_numpy()[-1] == outcomes.run_time[0]
        assert trace["time_s"].diff().iloc[1:-1].to_numpy() == pytest.approx(0.1)
        speed = trace["host_speed_m_per_s"].to_numpy()
        assert speed[0] == column[0]
        steps = trace["host_acceleration_m_per_s2"].to_numpy()[1:] * np.diff(trace["time_s"])
        assert np.diff(speed) == pytest.approx(steps, abs=1e-9)
        assert np.hypot(trace["ahead_m"], trace["aside_m"]).min() >= outcomes.min_distance[0] - 1e-9


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"headway": -1}, "vehicle parameter headway: seen -1; expected a positive number"),
        ({"aeb": 1}, "vehicle parameter aeb: seen 1; expected True or False"),
    ],
)
def test_a_parameter_out_of_its_range_is_named(change, message):
    with pytest.raises(InputError, match=message):
        replace(LeftTurnCar(), **change)


@pytest.mark.parametrize("name", CARS)
@pytest.mark.parametrize(
    ("outcome", "crash", "value", "expected"),
    [
        ("impact_speed", True, -3.0, "a finite speed of 0 m/s or more"),
        ("impact_speed", True, np.inf, "a finite speed of 0 m/s or more"),
        ("impact_speed", False, 3.0, "0 m/s where crash is false"),
        ("clearance", True, 0.5, "0 m or less where crash is true"),
        ("clearance", False, -0.5, "0 m or more where crash is false"),
        ("min_distance", False, -0.5, "0 m or more"),
        ("run_time", False, -1.0, "0 s or more"),
    ],
)
def test_impossible_outcomes_of_a_user_s_vehicle_are_refused(name, outcome, crash, value, expected):
    """Otherwise a negative impact speed would silently be no impact, and an impact without a crash one."""
    columns, _, slow = verdicts(name)
    x = columns[:, ~slow][:, :2000]
    found = CARS[name]().simulate(*x)
    assert (
        checked_outcomes(found, x, vehicle="own", scenario=SCENARIOS[name]).crash.sum()
        == found.crash.sum()
        > 0
    )
    values = getattr(found, outcome).copy()
    values[np.flatnonzero(found.crash == crash)[0]] = value
    with pytest.raises(InputError, match=re.escape(expected)):
        checked_outcomes(replace(found, **{outcome: values}), x, vehicle="own", scenario=SCENARIOS[name])
