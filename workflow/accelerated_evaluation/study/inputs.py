"""The inputs of a study: the checked configuration, the records, and the vehicles with their files."""

import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any, Self

from accelerated_evaluation.answer.consequences.criterion import criteria_of
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import content_digest, project_file, value_digest
from accelerated_evaluation.records.named import NamedRecords
from accelerated_evaluation.records.sources import SOURCES
from accelerated_evaluation.records.verdict import require_checks
from accelerated_evaluation.scenarios import SCENARIOS
from accelerated_evaluation.scenarios.record_table import named_records_of
from accelerated_evaluation.study.configuration import completed, load_modules, read_again, resolved, validate
from accelerated_evaluation.study.dependencies import in_order, without_unused
from accelerated_evaluation.study.limits import with_values
from accelerated_evaluation.study.preflight import (
    UNDER_TEST,
    compared_sections,
    require_cores,
    require_places,
    require_plain,
    require_records,
    require_vehicles,
)
from accelerated_evaluation.study.schema import shown
from accelerated_evaluation.vehicles.named import NamedVehicle
from accelerated_evaluation.vehicles.protocol import event_named

OF_THE_STUDY = ("slow", "workers")  # settings of the simulations that do not influence any outcome
MODULES_OF_STUDIES: dict[str, list[str]] = {}  # of the studies of a workflow, in this process
LIMITS = ("lead_speed_min", "lead_speed_max", "range_max")  # filters that are the limits of a crash map


@dataclass(frozen=True)
class StudyInputs:
    """The inputs of a study, which have been checked."""

    config: dict[str, Any]  # the complete configuration, without the sections of sources that are not used
    records: NamedRecords
    # Sections of the configuration: ``under_test``, and the compared vehicles by label.
    vehicles: dict[str, dict[str, Any]]
    files: dict[str, list[str]]  # paths of the files on which each vehicle depends
    slow: set[str]  # labels of the vehicles that are simulated as rarely as possible
    # Names of the checks of the records whose warnings the user accepts. They are not in `config`, because
    # they are used only by the last job, and editing them must not run other jobs again.
    accepted: list[str]
    verdicts: list[str]  # paths of published verdicts of the scenario

    @classmethod
    def checked(
        cls,
        config: Mapping[str, Any],
        paths: Iterable[str | os.PathLike],
        project: Path,
        *,
        cores: int | None,
        is_main_process: bool,
        moved: Callable[[str], str] = str,
    ) -> Self:
        """Complete and check a configuration, and find all files that it names.

        ``config`` is as Snakemake has merged it, and ``paths`` are the configuration files, which are read
        again, because Snakemake accepts repeated keys and reads some numbers as others. Paths of records are
        relative to the working directory or to the folder of the project. ``moved`` returns where the prefix
        of a module moves a path of a result. The processes of jobs, which are not the main process, skip slow
        checks. StudyError is raised if the configuration is not valid, or if a file or vehicle that it names
        cannot be used.
        """
        paths = list(paths)
        config = {**config, "modules": load_modules(config, paths)}
        config = completed(read_again(config, paths))
        validate(config)
        scenario = SCENARIOS[config["scenario"]["name"]]
        criteria_of(config["criteria"], scenario)
        event_named(config["scenario"]["event"], scenario, where="scenario.event")
        named = named_records_of(scenario, config)
        config = in_order(with_values(config, {named.key: str(project_file(named.path, project))}))
        named = named_records_of(scenario, config)
        vehicles = {UNDER_TEST: config["vehicle"], **compared_sections(config["compared_vehicles"])}
        settings = config["simulations"]
        named_vehicles = {
            label: NamedVehicle.of(section, settings, scenario) for label, section in vehicles.items()
        }
        if is_main_process:
            require_cores(cores)
            require_places(*(Path(moved(f"{folder}/{config['study']}")) for folder in ("results", "figures")))
            require_records(named)
            require_vehicles(named_vehicles)
            require_checks(config["data"]["accepted_warnings"])
        files = {label: each.files for label, each in named_vehicles.items()}
        slow = {label for label, each in named_vehicles.items() if each.is_stored}
        slow |= {UNDER_TEST} if settings["slow"] else set()
        require_plain([*named.files, *chain(*files.values())])
        limits = Path(moved(f"results/{config['study']}/limits.json"))
        config = without_unused(resolved(config, named.files, limits, trust=not is_main_process), SOURCES)
        accepted = config["data"].pop("accepted_warnings")
        verdicts = [str(project / path)] if (path := scenario.records.verdicts) else []
        return cls(config, named_records_of(scenario, config), vehicles, files, slow, accepted, verdicts)

    @property
    def source(self) -> dict[str, Any]:
        """Section of the configuration for the source of the records."""
        return self.config["data"][self.config["data"]["source"]]

    def files_of(self, *names: str) -> list[str]:
        """Return the paths of the files on which the named vehicles depend."""
        return [path for name in names for path in self.files[name]]

    def content_of(self, *names: str) -> str:
        """Return a digest of the contents of the files on which the named vehicles depend."""
        return content_digest(self.files_of(*names))

    def simulating(self, *names: str) -> tuple[int, dict[str, Any]]:
        """Return the number of threads and the settings of a job that simulates the named vehicles.

        Slow vehicles run in several workers, whose number is the number of threads. It is not one of the
        settings, so that changing it does not run the job again. Jobs with fast vehicles have one thread,
        and their settings are the same in all studies, which share the results of these jobs.
        """
        if self.slow.isdisjoint(names):
            return 1, {"keep_class": False}
        settings = self.config["simulations"]
        used = [key for key in settings if key not in OF_THE_STUDY]
        return settings["workers"], part(settings, *used)

    def mapped(self, name: str, crash_map: Mapping[str, Any]) -> dict[str, Any]:
        """Return all settings on which the crash map of a vehicle depends.

        Studies of the same vehicle with equal settings share the crash map.
        """
        return {
            "vehicle": self.vehicles[name]["name"],
            "parameters": self.vehicles[name]["parameters"],
            "content": self.content_of(name),
            "limits": part(self.config["filters"], *LIMITS),
            "crash_map": crash_map,
            "seed": self.config["seed"],
        }


def require_same_modules(studies: dict[str, list[str]], study: str, modules: list[str]) -> None:
    """Raise InputError if two studies of a workflow name different modules, and note those of a study.

    All studies of a workflow run in the same processes, so a law or figure of one would be used in the other.
    ``studies`` has the modules of the studies so far.
    """
    studies[study] = modules
    for other, theirs in studies.items():
        if sorted(theirs) != sorted(modules):
            raise InputError(
                "modules",
                seen=f"{shown(theirs)} in the study {other}, and {shown(modules)} in the study {study}",
                expected="the same files in all studies of a workflow, because they share its processes",
                change="Name the same files in each study, or use one workflow for each.",
            )


def part(section: Mapping[str, Any], *keys: str) -> dict[str, Any]:
    """Return some keys of a section of the configuration.

    A rule depends only on the keys that it uses, so that editing other keys does not run its jobs again.
    """
    return {key: section[key] for key in keys}


def map_folder(description: Mapping[str, Any]) -> str:
    """Return the folder of a crash map, named by a digest of its settings from `StudyInputs.mapped`."""
    vehicle = Path(description["vehicle"].replace(":", "/")).name
    return f"results/vehicles/{vehicle}-{value_digest(description)[:10]}"
