"""What a configuration says about an answer, as values: made once, at the top of a command or script."""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Self

import numpy as np

from accelerated_evaluation.answer.by_few_runs import SHARE
from accelerated_evaluation.answer.choice import ANSWER, LawSettings
from accelerated_evaluation.answer.criterion import Criterion, criteria_of
from accelerated_evaluation.base.arguments import a_number
from accelerated_evaluation.base.checking import checked
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.base.sections import integer, section
from accelerated_evaluation.crash_map.maps import Grid
from accelerated_evaluation.crash_map.section import events_section, grid_section
from accelerated_evaluation.laws import FitSettings
from accelerated_evaluation.laws.smooth.support import Support
from accelerated_evaluation.methods import Stopping
from accelerated_evaluation.methods.surrogate import Surrogate
from accelerated_evaluation.records.named import NamedRecords
from accelerated_evaluation.records.sources import describe
from accelerated_evaluation.scenarios import SCENARIOS, Event, Scenario
from accelerated_evaluation.scenarios.record_table import named_records_of
from accelerated_evaluation.vehicles.loading import section_of, vehicles_of
from accelerated_evaluation.vehicles.named import NamedVehicle
from accelerated_evaluation.vehicles.protocol import event_named, events_of

SECTION = section(
    grid=grid_section(45, 30, 50, 12, 240),
    events=events_section(impact_speed=[5, 10], min_range=[0.5, 1, 2], min_ttc=[1, 1.5, 2, 3]),
    draws=integer(
        500,
        20,
        100_000,
        "Number of posterior draws of law, parameters and crash probability, for the intervals. "
        "Simulations with lead motion are in proportion to it.",
    ),
)
LIMITS = ("lead_speed_min", "lead_speed_max", "range_max")  # limits of a crash map


@checked(replicates=a_number(1, whole=True), sampling_share=a_number(0))
@dataclass(frozen=True)
class Request:
    """What is asked of an estimate, in addition to its configuration; see the command ``estimate``.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> request = ae.Request(law="independent_variables", event="impact_speed=5")
    """

    law: str = ANSWER
    replicates: int = 1
    sampling_share: float = SHARE
    predecessor: str | os.PathLike | None = None
    event: str | None = None
    compare: Sequence[Path] = ()
    reference: Sequence[str] = ()
    criteria: Sequence[str] = ()  # in addition to those of the configuration


@dataclass(frozen=True)
class Settings:
    """The settings of an answer for one vehicle in one scenario."""

    scenario: Scenario
    event: Event
    events: Sequence[Event]  # further events
    criteria: Sequence[Criterion]
    records: NamedRecords
    support: Support | None  # limits of the laws of cut-ins; None for other scenarios
    accepted: Sequence[str]  # checks whose verdict "stop" the user accepts
    laws: LawSettings
    vehicle: NamedVehicle
    references: Mapping[str, NamedVehicle]  # vehicles to compare with, which are fast
    stopping: Stopping
    batch_size: int
    many: int  # number of simulations of a fast vehicle
    grid: Grid | None  # of crash maps; None for scenarios without
    sample: Callable[[], np.random.Generator]  # returns the generator that draws a sample of the records

    @classmethod
    def of(cls, config: Mapping[str, Any], request: Request) -> Self:
        """Return the settings of a complete configuration, with what is asked in addition.

        InputError is raised if there is no such event, criterion or vehicle to compare with.
        """
        scenario, answer = SCENARIOS[config["scenario"]["name"]], config["answer"]
        where, text = "--event", request.event
        if text is None:
            where, text = "scenario.event", config["scenario"]["event"]
        event = event_named(text, scenario, where)
        stated = criteria_of(config["criteria"], scenario)
        asked = criteria_of(request.criteria, scenario, "--criterion")
        criteria = list(dict.fromkeys([*stated, *asked]))
        wanted = [*request.reference, *(each.reference for each in criteria if each.reference)]
        vehicles = {
            name: NamedVehicle.of(
                section_of(name, config["compared_vehicles"].get(name)), config["simulations"], scenario
            )
            for name in dict.fromkeys(wanted)
        }
        for name, reference in vehicles.items():
            require_fast(name, reference)
        limits = {key: config["filters"][key] for key in LIMITS}
        return cls(
            scenario,
            event,
            events_of(scenario, answer["events"]),
            criteria,
            named_records_of(scenario, config),
            support_of(scenario, config),
            config["data"]["accepted_warnings"],
            law_settings(scenario, config),
            NamedVehicle.of(config["vehicle"], config["simulations"], scenario),
            vehicles,
            Surrogate.stopping({name: config[name] for name in Surrogate.plan}),
            config["surrogate"]["batch_size"],
            config["scenario"]["simulations"],
            Grid(**limits, **answer["grid"]) if "maps" in scenario.stages else None,
            partial(child_generator, config["seed"], "sample"),
        )


def require_fast(name: str, vehicle: NamedVehicle) -> None:
    """Raise InputError if there is no such vehicle to compare with, or if it is slow to simulate."""
    known = vehicles_of(vehicle.scenario)
    if ":" not in vehicle.name and vehicle.name not in known:
        expected = f"one of {', '.join(known)}, or path/to/file.py:ClassName"
        raise InputError("--reference", seen=repr(name), expected=expected, change="Correct the name.")
    if vehicle.is_stored:
        change = "Estimate this vehicle under the same law, and compare the two estimates by --compare."
        raise InputError(
            "--reference", seen=name, expected="a vehicle that is fast to simulate", change=change
        )
    vehicle.load()  # raises an error for an unknown class


def support_of(scenario: Scenario, config: Mapping[str, Any]) -> Support | None:
    """Return the limits of smooth laws in a configuration; None for a scenario without these laws."""
    if "smooth laws" not in scenario.stages:
        return None
    edges = config["segments"]["lead_speed_edges"]
    return Support.within(config["filters"], config["models"]["closing_speed_max"], edges)


def law_settings(scenario: Scenario, config: Mapping[str, Any]) -> LawSettings:
    """Return how a configuration asks for laws of a scenario to be fitted, weighted and drawn."""
    return LawSettings(
        config["answer" if "smooth laws" in scenario.stages else "scenario"]["draws"],
        config["answer"]["grid"]["closing_speed_max"],
        Path("results", config["study"], "laws", "family.npz"),
        config["models"]["inverse_range"]["variant"],
        FitSettings(
            config["models"],
            config["filters"]["range_max"],
            config["models"]["closing_speed_max"],
            describe(config["data"]),
        ),
        partial(child_generator, config["seed"], "laws"),
    )
