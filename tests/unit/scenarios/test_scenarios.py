"""The noun scenario: its registry, its limits and its events."""

import math
import pickle
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import CUT_IN, SCENARIOS, Event, InputError, load_vehicle
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.scenarios.outcomes import FLAG, outcome
from accelerated_evaluation.vehicles.external.store import Store
from accelerated_evaluation.vehicles.protocol import checked_outcomes, event_named, events_of

LEFT_TURN = SCENARIOS["left_turn"]
ROOT = Path(__file__).parents[3]


@dataclass(frozen=True)
class OlderOutcomes:
    """Outcomes of a scenario in an earlier version."""

    crash: Array = outcome(FLAG, "whether")
    clearance: Array = outcome("m", "how near")
    run_time: Array = outcome("s", "how long")


@dataclass(frozen=True)
class NewerOutcomes(OlderOutcomes):
    """The same scenario with a further outcome."""

    gap_time: Array = outcome("s", "how close", optional=True)


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_scenario_describes_itself(name):
    scenario = SCENARIOS[name]
    assert scenario.name == name
    assert scenario.outcomes[0].name == "crash"
    assert scenario.outcomes[0].is_flag
    assert scenario.events[0].quantity == "crash"
    outcomes = {each.name for each in scenario.outcomes}
    assert {event.quantity for event in scenario.events} | {
        event.scored_by for event in scenario.events
    } <= outcomes
    assert (scenario.limits[:, 0] < scenario.limits[:, 1]).all()


@pytest.mark.parametrize("name", sorted(set(SCENARIOS) - {"cut_in"}))
def test_an_encounter_outside_the_limits_is_named(name):
    scenario = SCENARIOS[name]
    inside = scenario.limits.mean(axis=1)
    encounters = np.tile(inside[:, None], 3)
    assert scenario.checked(*encounters) == pytest.approx(encounters)
    for k, variable in enumerate(scenario.variables):
        for value in (variable.low - 0.1, variable.high + 0.1, np.nan, np.inf):
            wrong = encounters.copy()
            wrong[k, 1] = value
            with pytest.raises(
                InputError, match=f"^table, row 8, column {variable.name}: seen {value!r}"
            ) as error:
                scenario.checked(*wrong, source="table", rows=[7, 8, 9])
            assert error.value.expected == (variable.in_words if np.isfinite(value) else "a finite number")


def test_events_order_the_outcomes_by_their_nearness():
    outcomes = CUT_IN.outcomes_of([[0, 1, 1], [5, 0, -1], [3, 0.1, 0.2], [0, 2, 9]])
    crash, impact, near, _ = CUT_IN.events
    assert outcomes.crash.dtype == bool
    assert crash.happens(outcomes).tolist() == [False, True, True]
    assert crash.score(outcomes).tolist() == [3, 0.1, 0.2]
    assert impact.happens(outcomes).tolist() == [False, False, True]
    assert impact.score(outcomes).tolist() == [3, -2, -9]
    assert near.happens(outcomes).tolist() == [False, True, True]


@pytest.mark.parametrize(
    ("scenario", "quantity", "words"),
    [
        ("cut_in", "crash", "crash"),
        ("cut_in", "impact_speed", "impact above 2 m/s"),
        ("cut_in", "min_ttc", "TTC at most 2 s"),
        ("left_turn", "impact_speed", "impact speed above 2 m/s"),
    ],
)
def test_events_are_named_with_their_units(scenario, quantity, words):
    known = SCENARIOS[scenario]
    assert known.event_in_words(known.event(quantity, 2.0)) == words


def outcomes_of_two(**more):
    """Return the outcomes of a left turn with a crash, and of one without."""
    values = {
        "crash": np.array([True, False]),
        "ended": np.array([True, True]),
        "min_distance": np.array([1.0, 9.0]),
        "clearance": np.array([-1.1, 6.9]),
        "impact_speed": np.array([7.0, 0.0]),
        "run_time": np.array([3.0, 4.0]),
    }
    return SimpleNamespace(**values | more)


def test_an_event_is_two_functions_of_the_outcomes():
    outcomes = outcomes_of_two()
    slow = Event(
        "slow",
        happens=lambda given: given.run_time > 3.5,
        score=lambda given: given.clearance + given.run_time,
    )
    assert slow.happens(outcomes).tolist() == [False, True]
    assert slow.score(outcomes).tolist() == pytest.approx([1.9, 10.9])
    severe = LEFT_TURN.event("impact_speed", 6.0)
    assert severe.happens(outcomes).tolist() == [True, False]
    assert severe.score(outcomes).tolist() == [-7.0, 6.9]
    assert pickle.loads(pickle.dumps(severe)).happens(outcomes).tolist() == [True, False]
    scenario = replace(LEFT_TURN, events=[*LEFT_TURN.events, slow])
    assert event_named("slow", scenario) is slow
    assert scenario.event_in_words(slow) == "slow"
    assert events_of(scenario, {"slow": [0], "impact_speed": [1, 2]}) == [
        slow,
        LEFT_TURN.event("impact_speed", 1.0),
        LEFT_TURN.event("impact_speed", 2.0),
    ]


def test_an_event_without_a_threshold_is_in_the_answer_although_no_configuration_names_it():
    slow = Event("slow", happens=lambda given: given.run_time > 3.5, score=lambda given: given.clearance)
    scenario = replace(LEFT_TURN, events=[*LEFT_TURN.events, slow])
    assert events_of(scenario, {}) == [slow]
    assert events_of(scenario, {"slow": [0]}) == [slow]


def test_a_vehicle_without_an_optional_outcome_remains_valid():
    """An outcome that is added to a scenario later is NaN for older vehicles; its events are refused."""
    encounters = np.tile(LEFT_TURN.limits.mean(axis=1)[:, None], 2)
    outcomes = checked_outcomes(outcomes_of_two(), encounters, vehicle="theirs", scenario=LEFT_TURN)
    assert np.isnan(outcomes.post_encroachment_time).all()
    near = LEFT_TURN.event("post_encroachment_time", 1.0)
    assert LEFT_TURN.events[0].happens(outcomes).tolist() == [True, False]
    for part in (near.happens, near.score):
        with pytest.raises(InputError, match="without post_encroachment_time; expected the optional outcome"):
            part(outcomes)
    given = outcomes_of_two(post_encroachment_time=np.array([0.0, 0.8]))
    outcomes = checked_outcomes(given, encounters, vehicle="theirs", scenario=LEFT_TURN)
    assert near.happens(outcomes).tolist() == [True, True]
    assert near.score(outcomes).tolist() == [0.0, 0.8]
    wrong = outcomes_of_two(post_encroachment_time=np.array([0.0, -0.8]))
    with pytest.raises(InputError, match="0 s or more"):
        checked_outcomes(wrong, encounters, vehicle="theirs", scenario=LEFT_TURN)
    without = outcomes_of_two()
    del without.run_time
    with pytest.raises(InputError, match="expected Outcomes with crash, ended, min_distance, clearance, imp"):
        checked_outcomes(without, encounters, vehicle="theirs", scenario=LEFT_TURN)


def test_a_store_keeps_an_outcome_that_is_missing_and_takes_an_older_file(tmp_path):
    older = replace(LEFT_TURN, outcome_type=OlderOutcomes)
    first, second = ((1.0, 2.0, 3.0), 0), ((1.0, 2.0, 4.0), 0)
    store = Store(tmp_path / "store.sqlite", older)
    store.add([first], [(0.0, 1.0, 2.0)])
    store = Store(tmp_path / "store.sqlite", replace(older, outcome_type=NewerOutcomes))
    store.add([second], [(0.0, 1.0, 2.0, math.nan)])
    known = store.known([first, second])
    for request in (first, second):
        assert known[request][:3] == (0.0, 1.0, 2.0)
        assert math.isnan(known[request][3])
    store.add([((1.0, 2.0, 5.0), 0)], [(0.0, 1.0, 2.0, 0.5)])
    assert store.known([((1.0, 2.0, 5.0), 0)])[(1.0, 2.0, 5.0), 0] == (0.0, 1.0, 2.0, 0.5)


def test_post_encroachment_time_of_constant_speeds():
    """The host is far away and keeps its speed in a short run, so both pass the point at known times."""
    car = load_vehicle("acc_aeb", LEFT_TURN, aeb=False)
    speed, turning, distance = 20.0, 6.0, 150.0
    encounter = [np.array([value]) for value in (speed, turning, distance)]
    found, trace = car.simulate(*encounter), car.trace(speed, turning, distance)
    time, ahead, aside, host = (
        trace[name].to_numpy() for name in ("time_s", "ahead_m", "aside_m", "host_speed_m_per_s")
    )
    row = int(np.argmax(aside <= 0))
    share = aside[row - 1] / (aside[row - 1] - aside[row])
    crossed = time[row - 1] + share * (time[row] - time[row - 1])
    place = ahead[row - 1] + share * (ahead[row] - ahead[row - 1])
    driven = np.trapezoid(host[row:], time[row:]) + host[row] * (time[row] - crossed)
    expected = time[-1] + (place - driven) / host[-1] - crossed
    assert found.post_encroachment_time.item() == pytest.approx(expected, abs=0.01)
    assert found.post_encroachment_time.item() > 3
    records = pd.read_parquet(ROOT / LEFT_TURN.records.file)[list(LEFT_TURN.names)].to_numpy()
    recorded = load_vehicle("acc_aeb", LEFT_TURN).simulate(*records.T)
    assert recorded.crash.any()
    assert np.array_equal(recorded.post_encroachment_time == 0, recorded.crash)
