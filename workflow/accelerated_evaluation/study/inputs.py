"""The inputs of a study: the checked configuration, the records, and the vehicles with their files."""

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from accelerated_evaluation.answer.criterion import criteria_of
from accelerated_evaluation.base.errors import InputError, located
from accelerated_evaluation.base.files import content_digest, project_file, value_digest
from accelerated_evaluation.base.tables import require_file
from accelerated_evaluation.records.sources import SOURCES, describe, record_files
from accelerated_evaluation.records.verdict import require_checks
from accelerated_evaluation.scenarios import SCENARIOS
from accelerated_evaluation.study.configuration import completed, load_modules, read_again, resolved, validate
from accelerated_evaluation.study.dependencies import without_unused
from accelerated_evaluation.study.preflight import (
    compared_sections,
    require_cores,
    require_named,
    require_places,
    require_plain,
)
from accelerated_evaluation.vehicles.external.slow import is_slow
from accelerated_evaluation.vehicles.loading import section_files
from accelerated_evaluation.vehicles.protocol import event_named

UNDER_TEST = "under_test"
OF_THE_STUDY = ("slow", "workers")  # settings of the simulations that do not influence any outcome
LIMITS = ("lead_speed_min", "lead_speed_max", "range_max")  # filters that are the limits of a crash map


@dataclass(frozen=True)
class StudyInputs:
    """The inputs of a study, which have been checked."""

    config: dict[str, Any]  # the complete configuration, without the sections of sources that are not used
    records: list[str]  # paths of the records
    # Sections of the configuration: ``under_test``, and the compared vehicles by label.
    vehicles: dict[str, dict[str, Any]]
    files: dict[str, list[str]]  # paths of the files on which each vehicle depends
    # Names of the checks of the records whose warnings the user accepts. They are not in `config`, because
    # they are used only by the last job, and editing them must not run other jobs again.
    accepted: list[str]
    # Paths of published verdicts for a scenario other than the cut-in.
    verdicts: list[str] = field(default_factory=list)

    @classmethod
    def checked(
        cls,
        config: Mapping[str, Any],
        paths: Iterable[str | os.PathLike],
        project: Path,
        *,
        cores: int | None,
        is_main_process: bool,
    ) -> Self:
        """Complete and check a configuration, and find all files that it names.

        ``config`` is as Snakemake has merged it, and ``paths`` are the configuration files, which are read
        again, because Snakemake accepts repeated keys and reads some numbers as others. Paths of records are
        relative to the working directory or to the folder of the project. The processes of jobs, which are
        not the main process, skip slow checks. StudyError is raised if the configuration is not valid, or if
        a file or vehicle that it names cannot be used.
        """
        paths = list(paths)
        config = read_again(config, paths)
        config["modules"] = load_modules(config, paths)
        config = completed(config)
        validate(config)
        scenario = SCENARIOS[config["scenario"]["name"]]
        criteria_of(config["criteria"], scenario)
        if not scenario.has_sources:
            return cls._of_scenario(config, project, cores=cores, is_main_process=is_main_process)
        records = record_files(config["data"][config["data"]["source"]])
        limits = Path("results") / config["study"] / "limits.json"
        config = without_unused(resolved(config, records, limits, trust=not is_main_process), SOURCES)
        accepted, source = config["data"].pop("accepted_warnings"), config["data"][config["data"]["source"]]
        source["path"] = str(project_file(source["path"], project))
        compared = compared_sections(config["compared_vehicles"])
        if is_main_process:
            require_cores(cores)
            require_places(Path("results") / config["study"], Path("figures") / config["study"])
            require_named(config["data"]["source"], source["path"], config["vehicle"], compared)
            require_checks(accepted)
        vehicles = {UNDER_TEST: config["vehicle"], **compared}
        files = {name: section_files(section) for name, section in vehicles.items()}
        inputs = cls(config, record_files(source), vehicles, files, accepted)
        require_plain([*inputs.records, *inputs.files_of(*vehicles)])
        return inputs

    @classmethod
    def _of_scenario(
        cls, config: dict[str, Any], project: Path, *, cores: int | None, is_main_process: bool
    ) -> Self:
        """Check the configuration of a scenario other than the cut-in, as `checked` does for the cut-in."""
        scenario = SCENARIOS[config["scenario"]["name"]]
        path = config["scenario"]["records"] or scenario.records
        if path is None:
            raise InputError(
                "scenario.records",
                seen="null",
                expected="the file of the records",
                change=f"Name the file; the project contains no records of the scenario {scenario.name}.",
            )
        path = project_file(path, project)
        if is_main_process:
            require_cores(cores)
            require_places(Path("results") / config["study"], Path("figures") / config["study"])
        require_file(path, "Correct scenario.records.")
        event_named(config["scenario"]["event"], scenario, where="scenario.event")
        data = dict(config["data"])
        require_checks(accepted := data.pop("accepted_warnings"))
        config = {**config, "scenario": {**config["scenario"], "records": str(path)}, "data": data}
        with located("vehicle.name or vehicle.parameters"):
            files = section_files(config["vehicle"], scenario)
        require_plain([str(path), *files])
        verdicts = [str(project / scenario.verdicts)] if scenario.verdicts else []
        own = {"parameters": {}, "files": [], "deterministic": None}
        vehicles = {UNDER_TEST: config["vehicle"]} | {
            name: {"name": name} | own for name in scenario.vehicles
        }
        of_files = {name: files if name == UNDER_TEST else [] for name in vehicles}
        return cls(config, [str(path)], vehicles, of_files, accepted, verdicts)

    @property
    def source(self) -> dict[str, Any]:
        """Section of the configuration for the source of the records."""
        return self.config["data"][self.config["data"]["source"]]

    @property
    def place(self) -> str:
        """File or folder of the records, as the configuration names it."""
        return self.config["scenario"]["records"] or self.source["path"]

    @property
    def description(self) -> str:
        """Text that describes the records in tables and figures."""
        return describe(self.config["data"])

    def files_of(self, *names: str) -> list[str]:
        """Return the paths of the files on which the named vehicles depend."""
        return [path for name in names for path in self.files[name]]

    def content_of(self, *names: str) -> str:
        """Return a digest of the contents of the files on which the named vehicles depend."""
        return content_digest(self.files_of(*names))

    def is_slow(self, name: str) -> bool:
        """Return whether a vehicle is treated as slow, so that it is simulated as rarely as possible."""
        settings, scenario = self.config["simulations"], SCENARIOS[self.config["scenario"]["name"]]
        stored = is_slow(self.vehicles[name]["name"], settings, scenario)
        return stored or (name == UNDER_TEST and settings["slow"])

    def simulating(self, *names: str) -> tuple[int, dict[str, Any]]:
        """Return the number of threads and the settings of a job that simulates the named vehicles.

        Slow vehicles run in several workers, whose number is the number of threads. It is not one of the
        settings, so that changing it does not run the job again. Jobs with fast vehicles have one thread,
        and their settings are the same in all studies, which share the results of these jobs.
        """
        if not any(map(self.is_slow, names)):
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


def part(section: Mapping[str, Any], *keys: str) -> dict[str, Any]:
    """Return some keys of a section of the configuration.

    A rule depends only on the keys that it uses, so that editing other keys does not run its jobs again.
    """
    return {key: section[key] for key in keys}


def map_folder(description: Mapping[str, Any]) -> str:
    """Return the folder of a crash map, named by a digest of its settings from `StudyInputs.mapped`."""
    vehicle = Path(description["vehicle"].replace(":", "/")).name
    return f"results/vehicles/{vehicle}-{value_digest(description)[:10]}"
