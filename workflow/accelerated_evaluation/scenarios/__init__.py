"""Scenarios: what varies in an encounter, its limits, its records, its events and its vehicles."""

from accelerated_evaluation.base.registry import Registry
from accelerated_evaluation.scenarios.protocol import Event, Outcome, Scenario, Variable, outcome

SCENARIOS: Registry[Scenario] = Registry("scenario", __name__, __path__)

__all__ = ["SCENARIOS", "Event", "Outcome", "Scenario", "Variable", "outcome"]
