"""The noun scenario: its registry, its limits and its events."""

import numpy as np
import pytest
from accelerated_evaluation import CUT_IN, SCENARIOS, InputError


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


def test_a_scenario_that_does_not_exist_is_named():
    with pytest.raises(
        InputError, match=r"scenario: seen 'left_trun'; expected one of .*Did you mean left_turn"
    ):
        SCENARIOS["left_trun"]


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
