"""Checks that everything named in the configuration exists, before the first job is started.

Jobs may take minutes, so a wrong name should be reported before.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from accelerated_evaluation.base.errors import InputError, located
from accelerated_evaluation.records.named import NamedRecords

if TYPE_CHECKING:  # the compiler takes a second
    from accelerated_evaluation.vehicles.named import NamedVehicle

UNDER_TEST = "under_test"  # label of the vehicle under test among all vehicles
# Endings of the files that jobs write.
ENDINGS = {
    ".csv",
    ".json",
    ".parquet",
    ".npz",
    ".pdf",
    ".svg",
    ".png",
    ".md",
    ".tex",
    ".ipynb",
    ".log",
    ".tsv",
}


def compared_sections(compared: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Complete the sections ``compared_vehicles``, by label, with all keys of a vehicle.

    If a section has no key ``name``, its label is the name of a built-in vehicle.
    """
    from accelerated_evaluation.vehicles.loading import section_of  # the compiler takes a second

    return {label: section_of(label, entry) for label, entry in compared.items()}


def require_records(records: NamedRecords) -> None:
    """Raise InputError, with the key of the configuration, if a file of the records does not exist."""
    for file in records.files:
        if not Path(file).is_file():
            raise InputError(
                records.key,
                seen=f"{file}, which {'is no file' if Path(file).exists() else 'does not exist'}",
                expected="the file of the records",
                change=f"Correct the path, which is relative to {Path.cwd()}.",
            )


def require_vehicles(vehicles: Mapping[str, "NamedVehicle"]) -> None:
    """Load each vehicle of a configuration once, to check that it exists.

    InputError names the key of the configuration, which the label of a vehicle gives, if a vehicle cannot be
    created with its parameters.
    """
    for label, vehicle in vehicles.items():
        key = "vehicle.name or vehicle.parameters" if label == UNDER_TEST else f"compared_vehicles.{label}"
        with located(key):
            vehicle.load()


def require_cores(cores: int | None) -> None:
    """Raise InputError if there is fewer than one core, with which Snakemake would wait forever."""
    if cores is not None and cores < 1:
        raise InputError(
            "--cores (CORES of make)",
            seen=str(cores),
            expected="1 or more, or all",
            change="Correct the number.",
        )


def require_places(*folders: Path) -> None:
    """Raise InputError if a file has the path of a results folder, or a folder that of a result file."""
    for folder in folders:
        for place in (folder, *folder.parents):
            if place.exists() and not place.is_dir():
                raise InputError(
                    str(place),
                    seen="a file",
                    expected="a folder, or nothing, for the results of studies",
                    change="Rename or remove the file.",
                )
        for place in folder.rglob("*.*"):
            if place.suffix in ENDINGS and place.is_dir():
                raise InputError(
                    str(place), seen="a folder", expected="a result, or nothing", change="Remove the folder."
                )


def require_plain(paths: Iterable[str]) -> None:
    """Raise InputError for a path with a brace, which Snakemake would treat as a wildcard."""
    for path in paths:
        if set("{}") & set(path):
            raise InputError(
                path,
                seen="a brace in the path of a file that the configuration names",
                expected="a path without { and }, which Snakemake takes for the name of a wildcard",
                change="Rename the file or its folder.",
            )
