"""Scenarios: kinds of encounters, each with its variables, limits, outcomes, events, records and vehicles."""

from accelerated_evaluation.base.arguments import by_name
from accelerated_evaluation.base.registry import Registry
from accelerated_evaluation.scenarios.events import Event
from accelerated_evaluation.scenarios.outcomes import Outcome, outcome
from accelerated_evaluation.scenarios.protocol import Scenario
from accelerated_evaluation.scenarios.variables import Variable

SCENARIOS: Registry[Scenario] = Registry("scenario", __name__, __path__, contract=[Scenario])
DEFAULT = "cut_in"  # name of the scenario that is used if none is named
A_SCENARIO = by_name(SCENARIOS, Scenario, "a scenario")  # as an argument of public functions

__all__ = ["A_SCENARIO", "DEFAULT", "SCENARIOS", "Event", "Outcome", "Scenario", "Variable", "outcome"]
