"""What the rules depend on: the checked configuration, the records, and the vehicles with their files."""

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from accelerated_evaluation.base.digests import content_digest, value_digest
from accelerated_evaluation.base.errors import InputError, located
from accelerated_evaluation.base.tables import require_file
from accelerated_evaluation.records.sources import SOURCES, describe, record_files
from accelerated_evaluation.records.verdict import require_checks
from accelerated_evaluation.scenarios import SCENARIOS
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.study.configuration import completed, read_yaml, resolved, validate
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

UNDER_TEST = "under_test"
OF_THE_STUDY = ("slow", "workers")  # settings of the simulations that no outcome depends on
LIMITS = ("lead_speed_min", "lead_speed_max", "range_max")  # of the filters, within which a vehicle is mapped


@dataclass(frozen=True)
class StudyInputs:
    """The inputs of a study, all of which have been checked.

    Attributes
    ----------
    config
        The complete configuration, without the sections of sources that are not used.
    records
        Files of the records.
    vehicles
        Sections of the vehicles: ``under_test``, and those that it is compared with by their labels.
    files
        Files that each vehicle depends on.
    accepted
        Checks of the records whose warnings the user accepts. They are not in ``config``: they concern the
        last job alone, and an edit of them runs no other job again.
    verdicts
        Files of published verdicts on the vehicles of another scenario than the cut-in.
    experiments
        Records that come with such a scenario, and the estimates of its stored experiments.
    """

    config: dict[str, Any]
    records: list[str]
    vehicles: dict[str, dict[str, Any]]
    files: dict[str, list[str]]
    accepted: list[str]
    verdicts: list[str] = field(default_factory=list)
    experiments: list[str] = field(default_factory=list)

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
        """Complete and check a configuration, and look up all that it names.

        Parameters
        ----------
        config
            As Snakemake merged it.
        paths
            The files that it is from. They are read again, because Snakemake takes the last of equal keys.
        project
            Folder of this project, whose records are found from any working directory.
        cores
            Number of cores that Snakemake may use.
        is_main_process
            False in the process of a job, which need not repeat the checks that take time.

        Raises
        ------
        StudyError
            If the configuration, or what it names, cannot be used.
        """
        for path in paths:
            read_yaml(Path(path))
        config = completed(config)
        validate(config)
        if config["scenario"]["name"] != CUT_IN.name:
            return cls._of_scenario(config, project, cores=cores, is_main_process=is_main_process)
        records = record_files(config["data"][config["data"]["source"]])
        limits = Path("results") / config["study"] / "limits.json"
        config = without_unused(resolved(config, records, limits, trust=not is_main_process), SOURCES)
        accepted, source = config["data"].pop("accepted_warnings"), config["data"][config["data"]["source"]]
        if not Path(source["path"]).exists() and (project / source["path"]).exists():
            source["path"] = str(project / source["path"])
        if is_main_process:
            require_cores(cores)
            require_places(Path("results") / config["study"], Path("figures") / config["study"])
            require_named(config)
            require_checks(accepted)
        vehicles = {UNDER_TEST: config["vehicle"], **compared_sections(config["compared_vehicles"])}
        files = {name: section_files(section) for name, section in vehicles.items()}
        inputs = cls(config, record_files(source), vehicles, files, accepted)
        require_plain([*inputs.records, *inputs.files_of(*vehicles)])
        return inputs

    @classmethod
    def _of_scenario(
        cls, config: dict[str, Any], project: Path, *, cores: int | None, is_main_process: bool
    ) -> Self:
        """Check what the configuration of another scenario than the cut-in names; see `checked`."""
        scenario = SCENARIOS[config["scenario"]["name"]]
        path = config["scenario"]["records"] or scenario.records
        if path is None:
            raise InputError(
                "scenario.records",
                seen="null",
                expected="the file of the records",
                change=f"Name it; no records of the scenario {scenario.name} come with the project.",
            )
        if not Path(path).exists() and (project / path).exists():
            path = project / path
        if is_main_process:
            require_cores(cores)
            require_places(Path("results") / config["study"], Path("figures") / config["study"])
        require_file(path, "Correct scenario.records.")
        config = {**config, "scenario": {**config["scenario"], "records": str(path)}}
        with located("vehicle.name or vehicle.parameters"):
            files = section_files(config["vehicle"], scenario)
        require_plain([str(path), *files])
        verdicts = [str(project / scenario.verdicts)] if scenario.verdicts else []
        known = [scenario.records, scenario.experiments] if scenario.experiments else []
        experiments = [str(project / path) for path in known]
        vehicles = {UNDER_TEST: config["vehicle"]}, {UNDER_TEST: files}
        return cls(config, [str(path)], *vehicles, [], verdicts, experiments)

    @property
    def source(self) -> dict[str, Any]:
        """Section of the source of the records."""
        return self.config["data"][self.config["data"]["source"]]

    @property
    def description(self) -> str:
        """Description of the records in the outputs."""
        return describe(self.config["data"])

    def files_of(self, *names: str) -> list[str]:
        """Return the files that some vehicles depend on."""
        return [path for name in names for path in self.files[name]]

    def content_of(self, *names: str) -> str:
        """Return the digest of the files of some vehicles."""
        return content_digest(self.files_of(*names))

    def is_slow(self, name: str) -> bool:
        """Return whether a study of a slow vehicle simulates a vehicle as rarely as it can."""
        settings, scenario = self.config["simulations"], SCENARIOS[self.config["scenario"]["name"]]
        stored = is_slow(self.vehicles[name]["name"], settings, scenario)
        return stored or (name == UNDER_TEST and settings["slow"])

    def simulating(self, *names: str) -> tuple[int, dict[str, Any]]:
        """Return the threads and settings of a job that simulates vehicles.

        Only slow vehicles have workers, and need their settings. How many workers there are is the number of
        threads, an edit of which runs nothing again.
        """
        settings = self.config["simulations"]
        slow = any(map(self.is_slow, names))
        used = [key for key in settings if key not in OF_THE_STUDY and (slow or key == "keep_class")]
        return settings["workers"] if slow else 1, part(settings, *used)

    def mapped(self, name: str, crash_map: Mapping[str, Any]) -> dict[str, Any]:
        """Return all that a crash map depends on. It belongs to the vehicle; all studies of one share it."""
        return {
            "vehicle": self.vehicles[name]["name"],
            "parameters": self.vehicles[name]["parameters"],
            "content": self.content_of(name),
            "limits": part(self.config["filters"], *LIMITS),
            "crash_map": crash_map,
            "seed": self.config["seed"],
        }


def part(section: Mapping[str, Any], *keys: str) -> dict[str, Any]:
    """Return the keys of a section of the configuration that a rule uses; edits of others rerun nothing."""
    return {key: section[key] for key in keys}


def map_folder(description: Mapping[str, Any]) -> str:
    """Return the folder of a crash map, whose name has a digest of what `StudyInputs.mapped` returns."""
    vehicle = Path(description["vehicle"].replace(":", "/")).name
    return f"results/vehicles/{vehicle}-{value_digest(description)[:10]}"
