"""The drivers CC, Reg157, RSS and FSM: against the published outcomes, plain Python, and closed formulas."""

import inspect
from dataclasses import fields, replace
from types import ModuleType

import numpy as np
import plain_drivers
import pytest
from accelerated_evaluation import InputError, load_vehicle
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.vehicles.builtin.driver_kernel import LANES
from accelerated_evaluation.vehicles.protocol import checked_outcomes

DRIVERS = ["cc_human", "fsm", "reg157", "rss"]


@pytest.fixture
def published(stored):
    """Return the function that gives the outcomes of the original code: a table, and its encounters."""

    def of(motion, driver):
        table = stored("driver_outcomes.parquet").query("motion == @motion and driver == @driver")
        assert len(table) == 1000
        return table, np.array([table.lead_speed, table.range, table.host_speed - table.lead_speed])

    return of


def one_by_one(driver, encounters, lateral_speeds, **parameters):
    """Outcomes of encounters that each have a lateral speed of their own, shape (4, n)."""
    vehicles = (load_vehicle(driver, lateral_speed=speed, **parameters) for speed in lateral_speeds)
    pairs = zip(vehicles, encounters.T, strict=True)
    outcomes = [vehicle.simulate(*encounter[:, None]) for vehicle, encounter in pairs]
    return np.array([[getattr(each, name)[0] for name in CUT_IN.outcome_names] for each in outcomes]).T


def stacked(outcomes):
    return np.array([getattr(outcomes, name) * 1.0 for name in CUT_IN.outcome_names])


def random_encounters(seed, n=200):
    """Encounters near the limit of what the drivers can avoid, some without closing in, shape (3, n)."""
    generator = np.random.default_rng(seed)
    closing_speed = generator.uniform(-2, 30, n)
    range_ = generator.uniform(0.2, 2.0, n) * (closing_speed**2 / 12 + np.abs(closing_speed)) + 0.5
    return np.array([generator.uniform(2, 35, n), range_, closing_speed])


def plain(driver, encounters, lateral_speeds, module=plain_drivers, **parameters):
    """Outcomes by the plain reference, shape (4, n)."""
    reaction = module.REACTION[driver]
    return np.array(
        [
            module.simulate(
                module.DECIDE[driver], *encounter, reaction=reaction, lateral_speed=speed, **parameters
            )
            for encounter, speed in zip(encounters.T.tolist(), lateral_speeds, strict=True)
        ]
    ).T


def share_of_differences(got, wanted):
    """Share of encounters in which an outcome differs by more than 1e-9."""
    with np.errstate(invalid="ignore"):
        return np.mean(~((got == wanted) | (np.abs(got - wanted) < 1e-9)).all(axis=0))


def assert_as_published(outcomes, table):
    crash, min_range, _, impact_speed = outcomes
    np.testing.assert_array_equal(crash, table.crash)
    np.testing.assert_allclose(impact_speed, table.impact_speed.fillna(0), rtol=0, atol=1e-3)
    safe = (table.crash == 0).to_numpy()
    smallest = np.fmin(table.min_range.fillna(np.inf), table.range)
    np.testing.assert_allclose(min_range[safe], smallest[safe], rtol=0, atol=1e-3)


@pytest.mark.parametrize("driver", DRIVERS)
def test_every_published_outcome_in_the_lane(driver, published):
    table, encounters = published("in lane", driver)
    assert_as_published(stacked(load_vehicle(driver).simulate(*encounters)), table)


@pytest.mark.parametrize("driver", DRIVERS)
def test_every_published_outcome_with_lateral_motion(driver, published):
    table, encounters = published("lateral", driver)
    assert_as_published(one_by_one(driver, encounters, table.lateral_speed.tolist()), table)


@pytest.mark.parametrize("driver", DRIVERS)
def test_compiled_drivers_equal_plain_python(driver):
    encounters = random_encounters(1)
    zeros = np.zeros(encounters.shape[1]).tolist()
    got, wanted = stacked(load_vehicle(driver).simulate(*encounters)), plain(driver, encounters, zeros)
    assert share_of_differences(got, wanted) == 0
    assert 0.2 < wanted[0].mean() < 0.9

    lateral = np.random.default_rng(2).uniform(0.2, 2.5, encounters.shape[1]).tolist()
    for offset in (3.5, 1.75):
        got = one_by_one(driver, encounters, lateral, entry_offset=offset)
        wanted = plain(driver, encounters, lateral, crossing=offset)
        assert share_of_differences(got, wanted) == 0
        assert 0.02 < wanted[0].mean() < 0.9


@pytest.mark.parametrize(
    ("driver", "line", "wrong"),
    [
        ("cc_human", "<= 2\n", "<= 1.9\n"),
        ("cc_human", "-decide.coasting", "0.0"),
        ("cc_human", "s.e <= 0 and critical", "s.e <= 0.505 and critical"),  # UN R157 on the perception
        ("reg157", "+ 0.45", "+ 0.35"),
        ("reg157", "s.e <= 0.5", "s.e <= 0.4"),
        ("rss", "s.g < along and s.e < across", "s.g < along"),
        ("rss", "0.3 + (2", "0.2 + (2"),
        ("rss", "- s.u**2 / 12\n", "- s.u**2 / 14\n"),
        ("rss", "if s.ramp is None", "if s.acc == 0"),  # the ramp starts anew after a release
        ("fsm", "s.g - 2", "s.g"),
        ("fsm", "-s.acc + 1.265", "6.0"),
        ("fsm", "slowing = max(s.acc, -4)", "slowing = 0.0"),
        ("fsm", "time_to_pass + 0.1", "time_to_pass"),
        ("fsm", "abs(2 * s.acc)", "8"),
        ("fsm", "s.dx -= (s.v - s.u) * DT", "s.dx -= (s.v - s.acc * DT / 2 - s.u) * DT"),
    ],
)
def test_another_line_is_another_driver(driver, line, wrong):
    source = inspect.getsource(plain_drivers)
    assert source.count(line) == 1
    mutant = ModuleType("mutant")
    exec(source.replace(line, wrong), vars(mutant))
    encounters, lateral = random_encounters(1), np.random.default_rng(2).uniform(0.2, 2.5, 200).tolist()
    differences = [
        share_of_differences(
            one_by_one(driver, encounters, speeds), plain(driver, encounters, speeds, mutant)
        )
        for speeds in ([0.0] * len(lateral), lateral)
    ]
    assert max(differences) > 0


@pytest.mark.parametrize("driver", DRIVERS)
def test_every_parameter_has_an_effect(driver):
    encounters = random_encounters(3, 3000)
    # Slow enough for RSS to wait for the other car, and fast enough for contacts from the side.
    vehicles = [load_vehicle(driver, lateral_speed=speed, entry_offset=3.0) for speed in (0.3, 0.7)]
    for field in fields(vehicles[0]):
        differences = []
        for vehicle in vehicles:
            value = getattr(vehicle, field.name)
            factor = 1.1 if "offset" in field.name else 0.6
            changed = replace(
                vehicle, **{field.name: not value if isinstance(value, bool) else factor * value}
            )
            outcomes = [stacked(each.simulate(*encounters)) for each in (vehicle, changed)]
            differences.append(share_of_differences(*outcomes))
        assert max(differences) > 0, field.name


def test_the_careful_human_who_does_not_watch_beyond_the_critical_ttc(published):
    _, encounters = published("in lane", "cc_human")
    watching = load_vehicle("cc_human").simulate(*encounters)
    outside = load_vehicle("cc_human", keeps_watching=False).simulate(*encounters)
    far = encounters[1] > 2 * encounters[2]
    assert not outside.crash[far].any()
    assert watching.crash[far].any()
    np.testing.assert_array_equal(outside.crash[~far], watching.crash[~far])
    # Shares of larger sets of random cut-ins, by the authors of the description.
    for outcomes, share in ((watching, 0.418), (outside, 0.277)):
        assert outcomes.crash.mean() == pytest.approx(share, abs=4 * np.sqrt(share * (1 - share) / far.size))


@pytest.mark.parametrize("driver", DRIVERS)
@pytest.mark.parametrize("lateral_speed", [0.0, 0.8])
def test_outcomes_keep_the_protocol_and_depend_on_their_own_encounter_alone(driver, lateral_speed):
    vehicle = load_vehicle(driver, lateral_speed=lateral_speed)
    encounters = random_encounters(4, 40_000)
    outcomes = vehicle.simulate(*encounters)
    side = outcomes.impact_speed < 0
    assert not (side & ~outcomes.crash).any()
    assert lateral_speed or not side.any()
    kept = replace(outcomes, impact_speed=np.maximum(outcomes.impact_speed, 0))
    checked_outcomes(kept, encounters, vehicle=driver, scenario=CUT_IN)
    assert np.isfinite(outcomes.min_ttc[outcomes.crash]).all()

    some = np.random.default_rng(5).permutation(encounters.shape[1])[: LANES + 7]
    alone = vehicle.simulate(*encounters[:, some])
    parts = vehicle.outcomes(encounters, threads=2)
    for name in CUT_IN.outcome_names:
        assert getattr(alone, name).tobytes() == getattr(outcomes, name)[some].tobytes()
        assert getattr(parts, name).tobytes() == getattr(outcomes, name).tobytes()


@pytest.mark.parametrize("driver", DRIVERS)
@pytest.mark.parametrize("lateral_speed", [0.0, 1e-9, 0.8])
def test_extreme_encounters_end(driver, lateral_speed):
    extremes = np.array([5e-324, 1e-300, 1e-9, 1.0, 1e8])
    cut_ins = np.array(np.meshgrid([0.0, 1e-9, 1.0, 1e8], [*extremes, 1e308], [-0.0, *extremes]))
    cut_ins = cut_ins.reshape(3, -1)
    outcomes = load_vehicle(driver, lateral_speed=lateral_speed).simulate(*cut_ins)
    assert not np.isnan(stacked(outcomes)).any()
    assert (outcomes.min_ttc > 0).all()
    assert ((outcomes.min_range <= 0) == outcomes.crash).all()
    assert load_vehicle(driver).simulate([], [], []).crash.shape == (0,)


@pytest.mark.parametrize(
    ("driver", "parameters", "message"),
    [
        ("cc_human", {"keeps_watching": 1}, "keeps_watching: seen 1; expected True or False"),
        ("cc_human", {"reaction_time": -0.1}, "reaction_time: seen -0.1; expected a number of 0 or more"),
        ("reg157", {"deceleration": 0}, "deceleration: seen 0; expected a positive number"),
        ("rss", {"lateral_speed": 30.0}, "lateral_speed: seen 30.0; expected less than 19 m/s"),
        ("fsm", {"entry_offset": 4.0}, "entry_offset: seen 4.0; expected at most start_offset = 3.5 m"),
        ("fsm", {"jerk": "fast"}, "jerk: seen 'fast'; expected a positive number"),
        (
            "fsm",
            {"criticl_ttc": 2},
            "vehicle fsm: seen parameter 'criticl_ttc'; expected one of lateral_speed,",
        ),
    ],
)
def test_bad_parameters(driver, parameters, message):
    with pytest.raises(InputError, match=message):
        load_vehicle(driver, **parameters)
