"""Checks that everything named in the configuration exists, before the first job is started.

Jobs may take minutes, so a wrong name should be reported before.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from accelerated_evaluation.base.errors import InputError, located

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
    """Complete the entries of the section ``compared_vehicles`` with all keys of a vehicle.

    Parameters
    ----------
    compared
        Sections by label. If a section has no key ``name``, its label is the name of a built-in vehicle.

    Returns
    -------
    dict
        Sections by label, with the keys ``name``, ``parameters``, ``files`` and ``deterministic``.
    """
    return {
        label: {"name": label, "parameters": {}, "files": [], "deterministic": None, **entry}
        for label, entry in compared.items()
    }


def require_named(config: Mapping[str, Any]) -> None:
    """Check that the records and the vehicles of a valid configuration exist, and load each vehicle once.

    Raises
    ------
    InputError
        If a file does not exist, or a vehicle cannot be created with its parameters.
    """
    from accelerated_evaluation.vehicles.loading import load_vehicle  # the compiler takes a second

    source = config["data"]["source"]
    path = config["data"][source]["path"]
    if not Path(path).exists():
        raise InputError(
            f"data.{source}.path",
            seen=f"{path}, which does not exist",
            expected="the file of the records",
            change=f"Correct the path, which is relative to {Path.cwd()}.",
        )
    with located("vehicle.name or vehicle.parameters"):
        load_vehicle(config["vehicle"]["name"], **config["vehicle"]["parameters"])
    for label, vehicle in compared_sections(config["compared_vehicles"]).items():
        with located(f"compared_vehicles.{label}"):
            load_vehicle(vehicle["name"], **vehicle["parameters"])


def require_cores(cores: int | None) -> None:
    """Check the number of cores; with fewer than one, Snakemake would wait forever.

    Parameters
    ----------
    cores
        Number of cores; None if none was given.

    Raises
    ------
    InputError
        If the number is below 1.
    """
    if cores is not None and cores < 1:
        raise InputError(
            "--cores (CORES of make)",
            seen=str(cores),
            expected="1 or more, or all",
            change="Correct the number.",
        )


def require_places(*folders: Path) -> None:
    """Check that no file is in the place of a results folder, and no folder in the place of a result file.

    Raises
    ------
    InputError
        If a file has the path of a folder of results, or a folder the path of a result file.
    """
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
    """Check that the paths of a user's files contain no braces, which Snakemake would treat as wildcards.

    Raises
    ------
    InputError
        For the first path with a brace.
    """
    for path in paths:
        if set("{}") & set(path):
            raise InputError(
                path,
                seen="a brace in the path of a file that the configuration names",
                expected="a path without { and }, which Snakemake takes for the name of a wildcard",
                change="Rename the file or its folder.",
            )
