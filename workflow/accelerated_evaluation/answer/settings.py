"""What a configuration says about an answer, as values: made once, at the top of a command or script."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Self

import numpy as np

from accelerated_evaluation.answer.consequences.criterion import (
    Counted,
    Criterion,
    counted_in_service,
    criteria_of,
)
from accelerated_evaluation.answer.ways.choice import LawSettings
from accelerated_evaluation.answer.ways.request import Request
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.base.sections import integer, section
from accelerated_evaluation.crash_map.maps import Grid
from accelerated_evaluation.crash_map.section import events_section, grid_section
from accelerated_evaluation.laws import FitSettings
from accelerated_evaluation.laws.limited import Limit
from accelerated_evaluation.laws.smooth.support import Support
from accelerated_evaluation.methods import Stopping
from accelerated_evaluation.methods.surrogate import Surrogate
from accelerated_evaluation.records.named import NamedRecords
from accelerated_evaluation.records.sources import describe
from accelerated_evaluation.scenarios import SCENARIOS, Scenario
from accelerated_evaluation.scenarios.events import Event
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


@dataclass(frozen=True)
class Settings:
    """The settings of an answer for one vehicle in one scenario."""

    scenario: Scenario
    event: Event
    events: Sequence[Event]  # further events
    criteria: Sequence[Criterion]
    in_service: Counted | None  # crashes of the vehicle's fleet
    records: NamedRecords
    support: Support | None  # limits of the laws of cut-ins; None for other scenarios
    accepted: Sequence[str]  # checks whose verdict "stop" the user accepts
    laws: LawSettings
    limits: Sequence[Limit]  # of the encounters that happen to the vehicle
    vehicle: NamedVehicle
    references: Mapping[str, NamedVehicle]  # vehicles to compare with, which are fast
    against: NamedVehicle | None  # another vehicle to compare with, from few runs as well
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
        wanted += [] if request.against is None else [request.against]
        vehicles = {
            name: NamedVehicle.of(
                section_of(name, config["compared_vehicles"].get(name)), config["simulations"], scenario
            )
            for name in dict.fromkeys(wanted)
        }
        against = None
        if request.against is not None:
            against = vehicles.pop(request.against)
            require_known("--against", request.against, against)
        for name, reference in vehicles.items():
            require_fast(name, reference)
        limits = {key: config["filters"][key] for key in LIMITS}
        return cls(
            scenario,
            event,
            events_of(scenario, answer["events"]),
            criteria,
            counted_in_service(config["in_service"], scenario.noun),
            named_records_of(scenario, config),
            support_of(scenario, config),
            config["data"]["accepted_warnings"],
            law_settings(scenario, config),
            limits_of(scenario, config, request.host_speed_max),
            NamedVehicle.of(config["vehicle"], config["simulations"], scenario),
            vehicles,
            against,
            Surrogate.stopping({name: config[name] for name in Surrogate.plan}),
            config["surrogate"]["batch_size"],
            config["scenario"]["simulations"],
            Grid(**limits, **answer["grid"]) if scenario.has_support else None,
            partial(child_generator, config["seed"], "sample"),
        )


def require_fast(name: str, vehicle: NamedVehicle) -> None:
    """Raise InputError if there is no such vehicle to compare with, or if it is slow to simulate."""
    require_known("--reference", name, vehicle)
    if vehicle.is_stored:
        change = f"Write --against {name} instead, which estimates it from few runs."
        raise InputError(
            "--reference", seen=name, expected="a vehicle that is fast to simulate", change=change
        )


def require_known(option: str, name: str, vehicle: NamedVehicle) -> None:
    """Raise InputError, which names the option, if there is no such vehicle."""
    known = vehicles_of(vehicle.scenario)
    if ":" not in vehicle.name and vehicle.name not in known:
        expected = f"one of {', '.join(known)}, or path/to/file.py:ClassName"
        raise InputError(option, seen=repr(name), expected=expected, change="Correct the name.")
    if not vehicle.is_stored:
        vehicle.load()  # raises an error for an unknown class


def limits_of(
    scenario: Scenario, config: Mapping[str, Any], host_speed_max: float | None = None
) -> tuple[Limit, ...]:
    """Return the limits of the encounters that a configuration states for its vehicle and its scenario.

    ``host_speed_max`` [m/s] replaces that of the vehicle. InputError is raised if the scenario has no such
    variable.
    """
    fastest = config["vehicle"]["host_speed_max"] if host_speed_max is None else host_speed_max
    stated = {(name,): value for name, value in config["scenario"]["limits"].items()}
    if fastest is not None:
        stated[tuple(scenario.host_speed)] = fastest
    for names, value in stated.items():
        if not names or not {*names} <= {*scenario.names}:
            raise InputError(
                "scenario.limits" if names else "vehicle.host_speed_max",
                seen=f"{' '.join(names) or 'a largest speed'} of at most {value:g} in {scenario.name}",
                expected=f"a limit of one of its variables, {', '.join(scenario.names)}",
                change="Name a variable in scenario.limits, or leave the limit out.",
            )
    return tuple(Limit.of(scenario.names, names, value) for names, value in stated.items())


def support_of(scenario: Scenario, config: Mapping[str, Any]) -> Support | None:
    """Return the limits of smooth laws in a configuration; None for a scenario without these laws."""
    if not scenario.has_support:
        return None
    edges = config["segments"]["lead_speed_edges"]
    return Support.within(config["filters"], config["models"]["closing_speed_max"], edges)


def law_settings(scenario: Scenario, config: Mapping[str, Any]) -> LawSettings:
    """Return how a configuration asks for laws of a scenario to be fitted, weighted and drawn."""
    return LawSettings(
        config["answer" if scenario.has_support else "scenario"]["draws"],
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
