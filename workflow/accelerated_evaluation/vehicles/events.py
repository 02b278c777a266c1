"""Events by name: for the command line, and for crash maps of cut-ins."""

import math
from collections.abc import Mapping

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.scenarios.protocol import Event, Scenario

CRASH = CUT_IN.event("crash")


def event_named(text: str, scenario: Scenario = CUT_IN, where: str = "--event") -> Event:
    """Return the event that a text such as ``crash`` or ``impact_speed=5`` names.

    Parameters
    ----------
    text
        ``crash``, or a quantity and a threshold in its unit, separated by an equals sign.
    scenario
        The scenario, whose events determine the possible quantities.
    where
        Name of the option or key of the configuration, for the error.

    Raises
    ------
    InputError
        If the scenario has no such event, or the threshold is missing, negative or not a number.
    """
    quantity, _, threshold = text.partition("=")
    try:
        value = float(threshold or "nan")
    except ValueError:
        value = math.nan
    if text == CRASH.quantity:
        return scenario.event(text)
    names = [each.quantity for each in scenario.events if each.quantity != CRASH.quantity]
    if quantity in names and math.isfinite(value) and value >= 0:
        return scenario.event(quantity, value)
    others = f", or {' or '.join(names)} with a threshold, such as {names[0]}=1" if names else ""
    raise InputError(where, seen=repr(text), expected=f"crash{others}", change="Correct the event.")


def events_of(scenario: Scenario, thresholds: Mapping[str, list[float]]) -> list[Event]:
    """Return the events of a scenario in addition to the crash, with thresholds by the name of the outcome.

    Outcomes that the scenario does not have are left out.
    """
    names = [each.quantity for each in scenario.events[1:]]
    return [
        scenario.event(name, float(value))
        for name, values in thresholds.items()
        if name in names
        for value in values
    ]


def events_from(thresholds: Mapping[str, list[float]]) -> list[Event]:
    """Return the crash, followed by events with thresholds of quantities such as ``impact_speed`` [m/s]."""
    return [
        CRASH,
        *(CUT_IN.event(name, float(value)) for name, values in thresholds.items() for value in values),
    ]
