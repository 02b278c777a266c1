"""Events by name: those of a command line, and those of a crash map of cut-ins."""

import math
from collections.abc import Mapping

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.scenarios.protocol import Event, Scenario

CRASH = CUT_IN.event("crash")


def event_named(text: str, scenario: Scenario = CUT_IN) -> Event:
    """Return the event that the option ``--event`` names: ``crash``, or a quantity and a threshold.

    Parameters
    ----------
    text
        Text such as ``crash`` or ``impact_speed=5``.
    scenario
        The scenario, whose events say which quantities there are.

    Raises
    ------
    InputError
        If there is no such event.
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
    raise InputError("--event", seen=repr(text), expected=f"crash{others}", change="Correct it.")


def events_from(thresholds: Mapping[str, list[float]]) -> list[Event]:
    """Return the events given by thresholds of quantities, crashes first."""
    return [
        CRASH,
        *(CUT_IN.event(name, float(value)) for name, values in thresholds.items() for value in values),
    ]
