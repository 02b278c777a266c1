"""Scenarios: kinds of encounters, each with its variables, limits, outcomes, events, records and vehicles."""

from accelerated_evaluation.base.registry import Registry
from accelerated_evaluation.scenarios.protocol import Event, Outcome, Scenario, Variable, outcome

SCENARIOS: Registry[Scenario] = Registry("scenario", __name__, __path__, contract=[Scenario])

__all__ = ["SCENARIOS", "Event", "Outcome", "Scenario", "Variable", "outcome"]
