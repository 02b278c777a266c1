"""The human driver by hand, its map against crude simulation, and what is not known of it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from accelerated_evaluation import InputError, load_vehicle, map_crashes
from accelerated_evaluation.crash_map.exact import exact_probabilities
from accelerated_evaluation.crash_map.maps import read_crash_map, write_crash_map
from accelerated_evaluation.laws.distributions import BoundedExponential, Empirical
from accelerated_evaluation.laws.paper.models import IndependentLaw
from accelerated_evaluation.vehicles.builtin.human import Human
from accelerated_evaluation.vehicles.builtin.human_kernel import (
    BRAKING,
    DURATION,
    JERK,
    NOTICE,
    RESPONSE,
    SWERVE,
    SWERVE_WIDTH,
    TRAITS,
)
from accelerated_evaluation.vehicles.builtin.human_population import G, Population
from accelerated_evaluation.vehicles.protocol import RandomVehicle, repeats_itself
from builders import coarse_grid

GRID = coarse_grid(speeds=(5, 35, 10), ranges=(75, 30), closing=(45.0, 60), refinement=4)
LAW = IndependentLaw(
    description="an example",
    counts={"all": 1},
    inverse_range=BoundedExponential(rate=50, lower=1 / 75),
    inverse_ttc={"all": BoundedExponential(rate=6)},
    lead_speeds={"all": Empirical(np.linspace(5, 15, 1000))},
    closing_speed_max=45.0,
)


def driver(**traits):
    """Return one driver who responds in the mean time at the crossing, and does not swerve."""
    usual = {
        "response": 1.0,
        "notice": 1.0,
        "duration": 5.0,
        "braking": 6.0,
        "jerk": 1e9,
        "swerve": 0.0,
        "swerve_width": 1.83,
    }
    values = usual | traits
    row = np.empty(len(TRAITS))
    row[[RESPONSE, NOTICE, DURATION, BRAKING, JERK, SWERVE, SWERVE_WIDTH]] = list(values.values())
    return row[None]


def response(inverse_ttc):
    """Return the mean response time, by its three published values."""
    slope = 4 * np.log(0.65 / 0.425)
    return 0.725 + 0.65 * np.exp(-slope * inverse_ttc)


def crash_of(range_, closing_speed, row, **parameters):
    human = Human(**parameters)
    return bool(human.simulate_given([20.0], [range_], [closing_speed], row).crash[0])


@pytest.mark.parametrize("closing_speed", [6.0, 10.0, 15.0])
def test_a_driver_who_brakes_at_once_stops_in_the_distance_of_the_textbook(closing_speed):
    # 6 m/s^2 at once after the response: R = c T + c^2 / (2 a), where T depends on R.
    ranges = np.linspace(1, 70, 6901)
    stops = ranges > closing_speed * response(closing_speed / ranges) + closing_speed**2 / 12
    limit = ranges[np.argmax(stops)]
    crashes = [crash_of(range_, closing_speed, driver()) for range_ in (limit - 0.05, limit + 0.05)]
    assert crashes == [True, False]
    # A driver who noticed the lane change earlier, or responds faster, does not crash just below the limit.
    assert not crash_of(limit - 0.05, closing_speed, driver(notice=0.0))
    assert not crash_of(limit - 0.05, closing_speed, driver(response=0.9))
    assert crash_of(limit + 0.05, closing_speed, driver(jerk=10.0))


def test_the_largest_deceleration_is_the_needed_one_or_that_of_the_driver():
    human, row = Human(hard_braking=4.0), driver(braking=8.0)
    _, calm = human.braking_given([20.0], [60.0], [8.0], row)
    left = 60.0 - 8.0 * response(8 / 60) - human.margin
    assert calm[0] == pytest.approx(64 / (2 * left))
    _, hard = human.braking_given([20.0], [25.0], [10.0], row)
    assert hard[0] == pytest.approx(8.0)
    _, only_needed = replace(human, hard_braking=100.0).braking_given([20.0], [25.0], [10.0], row)
    assert 3 < only_needed[0] < 8


def test_a_swerve_avoids_the_crash_of_a_driver_who_cannot_stop():
    assert crash_of(12.0, 10.0, driver(braking=2.0))
    # A swerve that begins late is not enough.
    assert crash_of(9.0, 10.0, driver(braking=2.0, swerve=5.0))
    assert not crash_of(25.0, 10.0, driver(braking=2.0, swerve=5.0, swerve_width=3.0))
    assert crash_of(25.0, 10.0, driver(braking=2.0, swerve=5.0, swerve_width=0.1))


def test_a_gap_that_opens_needs_nothing():
    outcomes, braking = Human().braking_given(
        [20.0, 20.0], [5.0, 5.0], [0.0, -3.0], np.repeat(driver(), 2, 0)
    )
    assert not outcomes.crash.any()
    assert (outcomes.min_range == 5.0).all()
    assert np.isinf(outcomes.min_ttc).all()
    assert (braking == 0).all()


def test_the_drivers_have_the_published_distributions():
    population = Population.central(200_000)
    traits = population.drivers(np.random.default_rng(1))
    assert traits[:, RESPONSE].mean() == pytest.approx(1.0, abs=0.005)
    quarters = np.quantile(traits[:, RESPONSE], [0.5, 0.75])
    assert quarters[1] / quarters[0] == pytest.approx(1.2 / 0.9, rel=0.01)
    assert traits[:, DURATION].std() / traits[:, DURATION].mean() == pytest.approx(2.0 / 6.28, rel=0.02)
    for level, share in ((0.5, 0.01), (0.6, 0.10), (0.7, 0.42), (0.8, 0.70)):
        assert np.mean(traits[:, BRAKING] < level * G) == pytest.approx(share, abs=0.005)
    swerves = traits[:, SWERVE] > 0
    assert swerves.mean() == pytest.approx(23 / 70, abs=0.005)
    assert traits[swerves, SWERVE].mean() / G == pytest.approx(0.44, abs=0.005)
    assert (traits[:, JERK].min(), traits[:, JERK].max()) == pytest.approx((6.24, 13.46), rel=0.01)


def test_weights_of_drivers_reproduce_every_population():
    human, generator = Human(), np.random.default_rng(2)
    drivers = human.draw_inner(100_000, generator)
    populations = Population.draw(8, np.random.default_rng(3))
    weights = human.inner_weights(drivers, 8, np.random.default_rng(3))
    np.testing.assert_allclose(weights.mean(axis=0), 1.0)
    # Importance weights of drivers from the mean of these eight populations: the first moments of each agree.
    each = np.repeat(np.arange(8), 40_000)
    mixed = Population(**{name: values[each] for name, values in vars(populations).items()})
    sample = mixed.drivers(generator)
    density = populations.density(sample)
    weights = density / density.mean(axis=0)
    for place, trait in ((0, RESPONSE), (1, NOTICE), (2, BRAKING)):
        own = sample[each == place, trait].mean()
        estimate = np.average(sample[:, trait], weights=weights[place])
        deviation = sample[:, trait].std() * np.sqrt((weights[place] ** 2).sum()) / weights[place].sum()
        assert abs(estimate - own) < 5 * deviation
        # Weights of another population do not pass.
        assert abs(np.average(sample[:, trait], weights=weights[place + 4]) - own) > deviation


def test_the_map_agrees_with_crude_simulation_of_new_drivers():
    human = Human()
    assert isinstance(human, RandomVehicle)
    assert repeats_itself(human) is False
    generator = np.random.default_rng(4)
    crash_map = map_crashes(human, GRID, [], generator)
    exact = exact_probabilities(crash_map, LAW)["all"]
    stratum, size = LAW.strata["all"], 400_000
    x = stratum.points(stratum.lead_speed.rvs(generator, size), *stratum.factors.rvs(generator, size))
    cut_ins = LAW.with_cap(x).T
    crash = human.simulate(*cut_ins).crash
    error = np.hypot(np.sqrt(crash.mean() / size), exact.standard_error)
    assert abs(crash.mean() - exact.probability) < 4 * error
    assert error < 0.1 * exact.probability
    # Of rare crashes, the error is .09 to .13 if each line has any driver.
    rare = replace(LAW, inverse_ttc={"all": BoundedExponential(rate=20)})
    found = exact_probabilities(crash_map, rare)["all"]
    assert found.standard_error < 0.06 * found.probability
    # Drivers who were chosen because they crash, without their weights, crash too often.
    unweighted = exact_probabilities(replace(crash_map, inner_weight=None), LAW)["all"]
    assert abs(crash.mean() - unweighted.probability) > 4 * error
    # A single driver for all, the one of the medians, is the wrong way to average over drivers.
    typical = np.repeat(np.median(crash_map.inner, axis=0)[None], size, axis=0)
    single = human.simulate_given(*cut_ins, typical).crash
    assert abs(single.mean() - exact.probability) > 4 * error


def test_a_map_with_drivers_is_what_was_written(tmp_path):
    crash_map = map_crashes(Human(), replace(GRID, refinement=1), [], np.random.default_rng(5))
    write_crash_map(tmp_path / "map.npz", crash_map)
    again = read_crash_map(tmp_path / "map.npz")
    for name in ("inner", "inner_weight"):
        np.testing.assert_array_equal(getattr(again, name), getattr(crash_map, name))


def test_vehicles_with_unknown_randomness_still_have_no_map():
    vehicle = SimpleNamespace(simulate=Human().simulate, deterministic=False)
    with pytest.raises(InputError, match="whose outcomes are random"):
        map_crashes(vehicle, GRID, [], np.random.default_rng(6))


def test_encounters_differ_from_time_to_time_and_are_the_same_from_the_same_seed():
    cut_ins = np.full(300, 20.0), np.full(300, 25.0), np.full(300, 12.0)
    human = load_vehicle("human")
    first, second = (human.simulate(*cut_ins).min_range for _ in range(2))
    assert (first != second).mean() > 0.5
    np.testing.assert_array_equal(load_vehicle("human").simulate(*cut_ins).min_range, first)
    assert (load_vehicle("human", seed=1).simulate(*cut_ins).min_range != first).mean() > 0.5


def test_a_trace_ends_as_the_simulation_does():
    human = Human()
    row = driver(braking=4.0, jerk=10.0)
    for range_ in (12.0, 40.0):
        outcomes = human.simulate_given([20.0], [range_], [10.0], row)
        same = Human()
        object.__setattr__(same, "draw_next", lambda _: row)
        trace = same.trace(20.0, range_, 10.0)
        assert (trace["range_m"].iloc[-1] == 0) == outcomes.crash[0]
        if outcomes.crash[0]:
            assert trace["host_speed_m_per_s"].iloc[-1] - 20 == pytest.approx(outcomes.impact_speed[0])
        assert trace["host_acceleration_m_per_s2"].min() >= -4.0


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"critical_response": 0.5}, "critical_response: seen 0.5; expected between 0.725 and 1.375 s"),
        ({"latest_drift": 2.0}, "latest_drift: seen 2.0; expected from earliest_drift, 0.375 m"),
        ({"certain": 1}, "certain: seen 1; expected True or False"),
        ({"seed": -1}, "seed: seen -1; expected a whole number of 0 or more"),
        ({"margin": float("nan")}, "margin: seen nan; expected a number of 0 or more"),
    ],
)
def test_wrong_parameters_are_refused(parameters, message):
    with pytest.raises(InputError, match=message):
        load_vehicle("human", **parameters)
