"""What a configuration names has to exist; it is looked up before the first job, as jobs may take minutes."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from accelerated_evaluation.errors import InputError, located


def compared_sections(compared: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Return the entries of the section ``compared_vehicles``, each with all keys of the section ``vehicle``.

    An entry without a name is the built-in vehicle that its label names.
    """
    return {
        label: {"name": label, "parameters": {}, "files": [], **entry} for label, entry in compared.items()
    }


def require_named(config: Mapping[str, Any]) -> None:
    """Look up the records and the vehicles of a valid configuration, and make each vehicle once.

    Raises
    ------
    InputError
        If there is no such file, or a vehicle cannot be made with its parameters.
    """
    from accelerated_evaluation.vehicles.loading import load_vehicle  # imports the compiler: a second

    source = config["data"]["source"]
    path = config["data"][source]["path"]
    if not Path(path).exists():
        raise InputError(
            f"data.{source}.path",
            seen=f"{path}, where there is no file",
            expected="the file of the records",
            change=f"Correct the path, which begins at {Path.cwd()}.",
        )
    with located("vehicle.name or vehicle.parameters"):
        load_vehicle(config["vehicle"]["name"], **config["vehicle"]["parameters"])
    for label, vehicle in compared_sections(config["compared_vehicles"]).items():
        with located(f"compared_vehicles.{label}"):
            load_vehicle(vehicle["name"], **vehicle["parameters"])


def require_plain(paths: Iterable[str]) -> None:
    """Refuse paths of the user's files with braces, which Snakemake would take for wildcards.

    Raises
    ------
    InputError
        For the first of these paths.
    """
    for path in paths:
        if set("{}") & set(path):
            raise InputError(
                path,
                seen="a brace in the path of a file that the configuration names",
                expected="a path without { and }, which Snakemake takes for the name of a wildcard",
                change="Rename the file or its folder.",
            )
