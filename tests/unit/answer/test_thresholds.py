"""No probability depends on the last digits of a threshold, for all built-in vehicles and default events."""

import numpy as np
import pytest
from accelerated_evaluation import SCENARIOS, load_vehicle
from accelerated_evaluation.answer.settings import SECTION as ANSWER
from accelerated_evaluation.crash_map.section import crash_map_section
from accelerated_evaluation.scenarios.parameters import required_names
from accelerated_evaluation.vehicles.protocol import events_of
from scipy.stats import binom

# Cut-ins far and near, slow and fast; the other scenarios have limits of their own.
CUT_INS = np.array([(2, 35), (1, 75), (0, 25)])
SIZE = 100_000
WIDE, NARROW = 0.1, 0.001  # around a threshold, in its unit
VEHICLES = [
    (scenario, name)
    for scenario in SCENARIOS
    for name, kind in SCENARIOS[scenario].vehicles.items()
    if not required_names(kind)
]


def default_events(scenario):
    sections = [each["properties"]["events"]["properties"] for each in (ANSWER, crash_map_section())]
    defaults = [{name: key["default"] for name, key in each.items()} for each in sections]
    events = {event for each in defaults for event in events_of(scenario, each)}
    return {*scenario.events} - {scenario.event("crash")} | events


def sticks(outcome, threshold):
    """Return whether more outcomes are within a millimetre of a threshold than a smooth density allows.

    A smooth density has about 1 % of the outcomes that are within 0.1 m of the threshold within a millimetre
    of it; 5 % are allowed. Other quantities are judged in the same way in their own units.
    """
    away = np.abs(outcome - threshold)
    near, around = np.sum(away <= NARROW), np.sum(away <= WIDE)
    return binom.sf(near - 1, around, 5 * NARROW / WIDE) < 1e-6


@pytest.mark.parametrize(("scenario", "name"), VEHICLES)
def test_no_probability_jumps_at_a_default_threshold(scenario, name):
    known = SCENARIOS[scenario]
    limits = CUT_INS if scenario == "cut_in" else known.limits
    encounters = np.random.default_rng(1).uniform(*limits.T, (SIZE, known.dimension))
    outcomes = load_vehicle(name, known).simulate(*encounters.T)
    events = default_events(known)
    assert len(events) > 1
    # Impacts above 0 m/s leave out on purpose the crashes in which the host is no longer faster at contact.
    for event in events - {event for event in events if event.threshold == 0}:
        values = getattr(outcomes, event.quantity)
        values = values[outcomes.crash if event.is_above else np.isfinite(values)]
        assert not sticks(values, event.threshold), event


def test_a_driver_who_stops_at_a_threshold_is_seen():
    encounters = np.random.default_rng(1).uniform(*CUT_INS.T, (SIZE, 3))
    ranges = load_vehicle("human", margin=2.0).simulate(*encounters.T).min_range
    assert sticks(ranges, 2.0)
    assert not sticks(ranges, 1.0)
