import inspect
from types import ModuleType

import numba.core.caching
import numpy as np
import pandas as pd
import pytest
import reference_car
from accelerated_evaluation import VEHICLES, InputError, Vehicle, load_vehicle
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.scenarios.parameters import available_threads, required_names
from accelerated_evaluation.vehicles import AccAeb
from accelerated_evaluation.vehicles.builtin import kernel
from accelerated_evaluation.vehicles.named import NamedVehicle

OUTCOMES = CUT_IN.outcome_names
CARS = {
    "acc_aeb": AccAeb(),
    "acc_only": AccAeb(aeb=False),
    "weak": AccAeb(aeb_deceleration=5.8, aeb_jerk=12.0, aeb_ttc=0.7),
}


def inputs(table):
    return [table[name].to_numpy() for name in CUT_IN.names]


# lead_speed, range, closing_speed; crash, min_range, min_ttc, impact_speed
BY_HAND = pd.DataFrame.from_dict(
    {
        # AEB at once: a = -1.6, v = 35 - 0.16, R = 1 + (20 - 34.92) 0.1.
        "crash in the first step": (20, 1, 15, 1, -0.492, 1 / 15, 14.84),
        # Three steps of AEB: v = 0.84, 0.52, 0.04 and R = 0.408, 0.34, 0.312; TTC = 7.8 releases it, the ACC
        # commands 5, the actuator comes from -4.8 to -2.8, and the host stands: R = 0.312 - (0.04 + 0) 0.05.
        "stop": (0, 0.5, 1, 0, 0.310, 0.408 / 0.84, 0),
        # e = 0 and equal speeds: nothing ever changes.
        "at the desired headway": (35, 70, 0, 0, 70, np.inf, 0),
        # By a scalar transcription of the model page. The ACC stops accelerating at 90 / 2.236 = 40.25 m/s.
        "top speed of the ACC": (35, 400, 0, 0, 372.015355363376, 70.2073749803905, 0),
        # AEB in steps 13 and 14; on again in 19, from the command 5 it asks for 3.4, 1.8, 0.2, -1.4.
        "second onset": (0, 0.9, 0.7, 1, -0.062219425130046, 0.016937467253038, 0.693341132769373),
    },
    orient="index",
    columns=[*CUT_IN.names, *OUTCOMES],
)


def random_encounters(n=100_000):
    """Plausible ones, then ones of any magnitude, and ones that do not close."""
    generator = np.random.default_rng(20)
    lead_speed = generator.uniform(0, 40, n)
    yield lead_speed, np.exp(generator.uniform(-3, 5, n)), generator.exponential(8, n)
    some = generator.random((2, n)) < 0.9
    yield (
        10 ** generator.uniform(-320, 8, n) * some[0],
        10 ** generator.uniform(-320, 308, n) + 5e-324,
        10 ** generator.uniform(-320, 8, n) * some[1],
    )
    yield (
        lead_speed,
        np.exp(generator.uniform(-3, 5, n)),
        -lead_speed * generator.choice([0, 0.3, 0.99, 1.0], n),
    )


def assert_same_bits(got, wanted):
    for name in OUTCOMES:
        assert getattr(got, name).dtype == getattr(wanted, name).dtype
        assert getattr(got, name).tobytes() == getattr(wanted, name).tobytes(), name


def largest_difference(outcomes, table):
    """Largest difference over the four outcomes, infinite where only one side is."""
    with np.errstate(invalid="ignore"):
        differences = [
            np.where(got == wanted, 0, np.abs(got - wanted))
            for got, wanted in ((getattr(outcomes, name) * 1.0, table[name].to_numpy()) for name in OUTCOMES)
        ]
    return np.max(differences)


def test_every_published_verdict(stored):
    table = stored("verdicts.parquet")
    assert len(table) == 4695
    np.testing.assert_array_equal(AccAeb().simulate(*inputs(table)).crash, table.crash == 1)


def test_reference_outcomes(stored):
    table = stored("reference_outcomes.parquet")
    assert len(table) == 749
    assert largest_difference(AccAeb().simulate(*inputs(table)), table) <= 1e-9


@pytest.mark.parametrize(
    "parameters",
    [
        {"aeb": False},
        {"aeb_ttc": 0.91},  # constant T(v)
        {"aeb_release_ttc": 0.91},  # no hysteresis from 40 km/h up
        {"ki": 0},
        {"aeb_deceleration": 9.0},
        {"aeb_jerk": 15.9},
        {"headway": 1.99},
        {"acc_limit": 4.9},
        {"acc_top_speed": 40.7},
        {"friction_limit": 10.0},
        {"actuator_jerk": 19.0},
        {"top_start_speed": 36.0},
    ],
    ids=str,
)
def test_another_parameter_is_not_the_published_car(parameters, stored):
    table = pd.concat([stored("reference_outcomes.parquet"), BY_HAND])
    assert largest_difference(AccAeb(**parameters).simulate(*inputs(table)), table) > 1e-6


@pytest.mark.parametrize(
    ("line", "wrong"),
    [
        ("np.where(was_on, 0, error)", "error"),  # the error before the AEB counts after it
        (
            "np.where(was_on, timer, 0) + step",
            "np.where(on, timer + step, timer) + 0 * step",
        ),  # the timer goes on
        ("on & ~was_on, command, onset", "on & (onset == 0), command, onset"),  # the first onset's command
        ("np.where(on & ~was_on, command, onset)", "np.zeros_like(command)"),
        ("on, aeb_command", "on, -5 + 0 * aeb_command"),
        ("stays_on = was_on &", "stays_on = False &"),
        ("running & (ttc > 0) & (ttc < min_ttc)", "(ttc > 0) & (ttc < min_ttc)"),
        ("(speed + new_speed) / 2", "speed"),
        ("(speed + new_speed) / 2", "new_speed"),
        ("np.maximum(speed - lead_speed, 0), 0)", "speed, 0)"),
        ("+ acceleration * step, 0)", "+ acceleration * step, -9)"),
        ("car.ki * car.decision_step / 2 * (error + last_error)", "car.ki * car.decision_step * error"),
    ],
)
def test_another_line_is_not_the_published_model(line, wrong, stored):
    table = pd.concat([stored("reference_outcomes.parquet"), BY_HAND])
    source = inspect.getsource(reference_car)
    assert source.count(line) == 1
    mutant = ModuleType("mutant")
    exec(source.replace(line, wrong), vars(mutant))
    assert largest_difference(mutant.simulate(AccAeb(), *inputs(table)), table) > 1e-6


@pytest.mark.parametrize("car", CARS.values(), ids=CARS)
def test_compiled_equals_reference_to_the_bit(car):
    for encounters in random_encounters():
        assert_same_bits(car.simulate(*encounters), reference_car.simulate(car, *encounters))


@pytest.mark.parametrize("steps", [(0.02, 0.1), (0.02, 0.02), (0.05, 0.1)])
def test_other_steps_equal_the_reference_to_the_bit(steps):
    car = AccAeb().at_steps(*steps)
    for encounters in random_encounters(20_000):
        assert_same_bits(car.simulate(*encounters), reference_car.simulate(car, *encounters))


def test_small_steps_converge():
    """In motion without decisions, every step agrees with the parabola; with AEB, small steps agree."""
    still = AccAeb(aeb=False, kp=1e-12, ki=0.0, acc_limit=1e-9)
    lead, range_, closing = np.full(3, 10.0), np.array([30.0, 35.0, 50.0]), np.array([5.0, 4.0, 6.3])
    for steps in ((0.1, 0.1), (0.02, 0.1)):
        found = still.at_steps(*steps).simulate(lead, range_, closing)
        np.testing.assert_allclose(
            found.min_range[~found.crash], (range_ - 8 * closing)[~found.crash], atol=1e-6
        )
    x = lead, np.array([12.0, 20.0, 30.0]), np.array([9.0, 12.0, 14.0])
    coarse, fine, finer = (
        AccAeb().at_steps(step, step).simulate(*x).min_range for step in (0.1, 0.01, 0.005)
    )
    assert np.abs(fine - finer).max() < np.abs(coarse - finer).max() / 4


@pytest.mark.parametrize("steps", [{"time_step": 0.03}, {"decision_step": 0.04}, {"time_step": 0.2}])
def test_steps_that_do_not_fit_are_refused(steps):
    with pytest.raises(InputError, match="divided by a whole number"):
        AccAeb(**steps)


def test_compiled_equals_reference_on_published_inputs(stored):
    for name in ("verdicts.parquet", "reference_outcomes.parquet"):
        encounters = inputs(stored(name))
        assert_same_bits(AccAeb().simulate(*encounters), reference_car.simulate(AccAeb(), *encounters))


@pytest.mark.parametrize("case", BY_HAND.index)
def test_by_hand(case):
    table = BY_HAND.loc[[case]]
    assert largest_difference(AccAeb().simulate(*inputs(table)), table) < 1e-9


def test_same_bits_on_any_threads_in_any_batch():
    encounters = np.array(next(random_encounters()))
    wanted = AccAeb().outcomes(encounters, threads=1)
    for threads in (2, 3, 6):
        assert_same_bits(AccAeb().outcomes(encounters, threads=threads), wanted)
    some = np.random.default_rng(4).permutation(encounters.shape[1])[: kernel.LANES + 7]
    alone = AccAeb().simulate(*encounters[:, some])
    for name in OUTCOMES:
        np.testing.assert_array_equal(getattr(alone, name), getattr(wanted, name)[some])


def test_threads_follow_the_environment(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    assert available_threads() == 3
    monkeypatch.setenv("OMP_NUM_THREADS", "all")
    assert available_threads() == numba.config.NUMBA_NUM_THREADS


def test_compiles_without_a_place_for_the_cache(monkeypatch):
    monkeypatch.setattr(numba.core.caching.CompileResultCacheImpl, "_locator_classes", [])
    assert kernel.compiled(lambda x: x + 1)(2) == 3


def test_empty_batch():
    assert AccAeb().simulate([], [], []).crash.shape == (0,)


@pytest.mark.parametrize(
    ("encounters", "message"),
    [
        (([1, 2], [3, 4], [5]), r"shapes \(2,\), \(2,\), \(1,\)"),
        ((1, 2, 3), "one dimension"),
        ((["a"], [1], [1]), "expected numbers"),
        (([1, np.nan, 1], [1, 1, 0], [1, 1, 1]), "row 1, column lead_speed: seen nan; expected a finite"),
        (([1, 1], [2, np.inf], [1, 1]), "row 1, column range: seen inf"),
        (([1, 1], [2, 2], [1, -np.inf]), "row 1, column closing_speed: seen -inf"),
        (([1, 1, -1], [2, 0.0, 2], [1, 1, 1]), "row 1, column range: seen 0.0; expected a range above 0 m"),
        (([-0.5], [2], [1]), "row 0, column lead_speed: seen -0.5"),
        (([1e308], [2], [1]), "row 0, column lead_speed: seen 1e.308; expected at most 299792458 m/s"),
        (([1, 1], [2, 2], [1, 1e9]), "row 1, column closing_speed: seen 1000000000.0; expected at most"),
        (([3.0], [2], [-3.5]), "row 0, column closing_speed: seen -3.5; expected at least minus the lead"),
    ],
)
def test_bad_encounters(encounters, message):
    with pytest.raises(InputError, match=message):
        AccAeb().simulate(*encounters)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"aeb": 1}, "parameter aeb: seen 1; expected True or False"),
        ({"aeb_jerk": -1}, "parameter aeb_jerk: seen -1; expected a positive"),
        ({"aeb_ttc": "0.7"}, "parameter aeb_ttc: seen '0.7'; expected a positive number"),
        ({"kp": np.nan}, "parameter kp: seen nan"),
        ({"aeb_ttc": 1.2}, "aeb_ttc: seen 1.2; expected at most aeb_release_ttc = 1 s"),
    ],
)
def test_bad_parameters(parameters, message):
    with pytest.raises(InputError, match=message):
        AccAeb(**parameters)


def test_built_in_vehicles():
    assert load_vehicle("acc_aeb") == CARS["acc_aeb"]
    assert load_vehicle("acc_only").compiled() == CARS["acc_only"].compiled()
    assert load_vehicle("acc_only", headway=1.5).compiled() == AccAeb(aeb=False, headway=1.5).compiled()
    assert load_vehicle("acc_aeb", aeb_deceleration=5.8, aeb_jerk=12.0, aeb_ttc=0.7) == CARS["weak"]
    assert {"acc_aeb", "acc_only", "cc_human", "fsm", "reg157", "rss"} <= set(VEHICLES)
    whole = [name for name in VEHICLES if not required_names(VEHICLES[name])]
    assert set(VEHICLES) - set(whole) == {"command", "fmu"}
    assert all(isinstance(load_vehicle(name), Vehicle) for name in whole)


def test_a_file_of_a_vehicle_has_to_exist():
    with pytest.raises(InputError, match=r"nowhere\.py: seen no such file"):
        NamedVehicle.of({"name": "acc_aeb", "parameters": {}, "files": ["nowhere.py"]}, {}, CUT_IN).files  # noqa: B018


@pytest.mark.parametrize("name", [name for name in VEHICLES if name not in ("command", "fmu")])
def test_behind_a_faster_lead_there_is_no_time_to_collision(name):
    """esmini issue 569: a follower that falls back reports a positive time to collision."""
    outcomes = load_vehicle(name).simulate([30.0, 20.0], [20.0, 20.0], [-5.0, 0.0])
    assert np.isinf(outcomes.min_ttc).all()
    closing = load_vehicle(name).simulate([20.0], [40.0], [5.0])
    assert 0 < closing.min_ttc[0] <= 8
