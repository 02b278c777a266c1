"""Scenarios: kinds of encounters, each with its variables, limits, outcomes, events, records and vehicles."""

from collections.abc import Callable

from accelerated_evaluation.base.arguments import by_name
from accelerated_evaluation.base.registry import Member, Registry
from accelerated_evaluation.scenarios.protocol import Scenario

SCENARIOS: Registry[Scenario] = Registry("scenario", __name__, __path__, contract=[Scenario])


class OfScenarios(Registry[Member]):
    """What some scenarios have, such as a writer of files, by the name of the scenario."""

    def add(self, name: str) -> Callable[[Member], Member]:
        """Return a decorator as `Registry.add` does; InputError is raised if there is no such scenario."""
        return super().add(SCENARIOS[name].name)


DEFAULT = "cut_in"  # name of the scenario that is used if none is named
A_SCENARIO = by_name(SCENARIOS, Scenario, "a scenario")  # as an argument of public functions
