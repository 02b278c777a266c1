"""What a configuration says about an answer, as values: made once, at the top of a command or script."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Self

import numpy as np

from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.crash_map.maps import Grid
from accelerated_evaluation.laws import FitSettings
from accelerated_evaluation.laws.smooth.splines import Support
from accelerated_evaluation.methods import Stopping
from accelerated_evaluation.methods.surrogate import Surrogate
from accelerated_evaluation.records.settings import CutInSettings
from accelerated_evaluation.records.sources import describe
from accelerated_evaluation.scenarios import SCENARIOS, Event, Scenario
from accelerated_evaluation.vehicles.protocol import events_of

LIMITS = ("lead_speed_min", "lead_speed_max", "range_max")  # limits of a crash map


@dataclass(frozen=True)
class RecordSettings:
    """Which records are read, and how those of cut-ins are filtered."""

    scenario: Scenario
    table: str | None  # file of the records of a scenario without sources; None for those of the project
    cut_ins: CutInSettings  # how records of cut-ins are read
    support: Support | None  # limits of the laws of cut-ins; None for other scenarios
    accepted: Sequence[str]  # checks whose verdict "stop" the user accepts
    seed: int

    @classmethod
    def of(cls, config: Mapping[str, Any]) -> Self:
        """Return the settings of a complete configuration."""
        scenario = SCENARIOS[config["scenario"]["name"]]
        return cls(
            scenario,
            config["scenario"]["records"],
            CutInSettings.of(config),
            Support.within(
                config["filters"],
                config["models"]["closing_speed_max"],
                config["segments"]["lead_speed_edges"],
            )
            if "smooth laws" in scenario.stages
            else None,
            config["data"]["accepted_warnings"],
            config["seed"],
        )

    @property
    def generator(self) -> np.random.Generator:
        """Generator that draws a sample of the records, as in the jobs of a study."""
        return child_generator(self.seed, "sample")

    @property
    def named(self) -> str:
        """The file or folder of the records; a description if the records come with the project."""
        data = self.cut_ins.data
        if self.scenario.has_sources:
            return str(data[data["source"]]["path"])
        return str(self.table or f"records of the scenario {self.scenario.name} in the project")


@dataclass(frozen=True)
class LawSettings:
    """How laws are fitted to records, weighted and drawn."""

    seed: int
    draws: int
    closing_speed_max: float  # cap on the closing speed of laws of cut-ins [m/s]
    store: Path  # file in which the fit of smooth laws is kept
    paper: str  # name of the paper's law that the study uses
    fitting: FitSettings  # of the laws in `FITS`

    @classmethod
    def of(cls, config: Mapping[str, Any]) -> Self:
        """Return the settings of a complete configuration."""
        stages = SCENARIOS[config["scenario"]["name"]].stages
        return cls(
            config["seed"],
            config["answer" if "smooth laws" in stages else "scenario"]["draws"],
            config["answer"]["grid"]["closing_speed_max"],
            Path("results", config["study"], "laws", "family.npz"),
            config["models"]["inverse_range"]["variant"],
            FitSettings(
                config["models"],
                config["filters"]["range_max"],
                config["models"]["closing_speed_max"],
                describe(config["data"]),
            ),
        )

    @property
    def streams(self) -> partial:
        """Function that returns the random generator of a step, as in the jobs of a study."""
        return partial(child_generator, self.seed, "laws")


@dataclass(frozen=True)
class Settings:
    """The settings of an answer for one vehicle in one scenario."""

    scenario: Scenario
    event: str
    events: Sequence[Event]  # further events
    criteria: Sequence[str | Mapping[str, Any]]
    records: RecordSettings
    laws: LawSettings
    vehicle: Mapping[str, Any]  # its section: name, parameters, files
    compared_vehicles: Mapping[str, Mapping[str, Any]]
    simulations: Mapping[str, Any]  # the section that says how slow vehicles are simulated
    stopping: Stopping
    batch_size: int
    many: int  # number of simulations of a fast vehicle
    grid: Grid | None  # of crash maps; None for scenarios without

    @classmethod
    def of(cls, config: Mapping[str, Any]) -> Self:
        """Return the settings of a complete configuration."""
        records, answer = RecordSettings.of(config), config["answer"]
        scenario, limits = records.scenario, {key: config["filters"][key] for key in LIMITS}
        return cls(
            scenario,
            config["scenario"]["event"],
            events_of(scenario, answer["events"]),
            config["criteria"],
            records,
            LawSettings.of(config),
            config["vehicle"],
            config["compared_vehicles"] if scenario.references else {},
            config["simulations"],
            Surrogate.stopping({name: config[name] for name in Surrogate.plan}),
            config["surrogate"]["batch_size"],
            config["scenario"]["simulations"],
            Grid(**limits, **answer["grid"]) if "maps" in scenario.stages else None,
        )
