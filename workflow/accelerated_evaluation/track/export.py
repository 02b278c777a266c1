"""Export a weighted set of scenarios for others: scenario files, weights, and a page of instructions."""

import os
import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import write_csv, write_text
from accelerated_evaluation.track.recipe import ALL_LAWS, ONE_LAW, RECIPE, WHOLE
from accelerated_evaluation.track.scenarios import (
    LANE_CHANGE,
    RUN_UP,
    Scenario,
    require_scenariogeneration,
    write_scenarios,
)
from accelerated_evaluation.track.weighted_set import WeightedSet

TABLE, WEIGHTS = "scenarios.csv", "weights.csv"


def write_set(folder: str | os.PathLike, drawn: WeightedSet, origin: Mapping[str, str]) -> None:
    """Write a set into a new folder: ``scenarios.csv``, the scenario files, their road, and ``README.md``.

    The folder appears only when it is complete.

    Parameters
    ----------
    folder
        A folder that does not exist yet, or is empty.
    drawn
        The set.
    origin
        Statements about the origin of the set for the page, by name.

    Raises
    ------
    InputError
        If the folder is not empty.
    StudyError
        If the library scenariogeneration is not installed.
    """
    require_scenariogeneration()
    folder = Path(folder)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        change = "Name another folder, because files of two sets must not be mixed."
        raise InputError(str(folder), seen="something there", expected="no folder yet", change=change)
    folder.parent.mkdir(parents=True, exist_ok=True)
    temporary = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
    try:
        names = [f"scenario_{number:03d}" for number in drawn.table["scenario"]]
        write_scenarios(temporary, map(_scenario, names, drawn.table.to_dict("records")))
        write_csv(temporary / TABLE, table_of(drawn, names))
        if drawn.draws is not None:
            write_csv(temporary / WEIGHTS, drawn.draws)
        write_text(temporary / "README.md", page(drawn, origin))
        temporary.chmod(0o755)
        temporary.replace(folder)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def table_of(drawn: WeightedSet, names: list[str]) -> pd.DataFrame:
    """Return the table of weights, with the initial host speed [m/s] and the file of each scenario."""
    host_speed = drawn.table["lead_speed"] + drawn.table["closing_speed"]
    return drawn.table.assign(host_speed=host_speed, file=[f"{name}.xosc" for name in names])


def _scenario(name: str, row: Mapping[str, float]) -> Scenario:
    notes = {"weight": repr(float(row["weight"])), "shell": str(int(row["shell"]))}
    return Scenario(name, row["lead_speed"], row["range"], row["closing_speed"], notes)


def page(drawn: WeightedSet, origin: Mapping[str, str]) -> str:
    """Return the page that explains how to compute the crash probability from the outcomes of a vehicle."""
    counts = drawn.table["shell"].value_counts(sort=False)
    ends = [*(f"{edge:.2f}" for edge in drawn.edges[1:]), "more"]
    shells = "\n".join(
        f"| {shell} | {edge:.2f} to {end} | {probability:.4g} | {counts[shell]} |"
        for shell, (edge, end, probability) in enumerate(
            zip(drawn.edges, ends, drawn.probabilities, strict=True), start=1
        )
    )
    return RECIPE.format(
        whole="" if drawn.draws is None else WHOLE.format(draws=drawn.draws.shape[1] - 1),
        uncertainty=ONE_LAW if drawn.draws is None else ALL_LAWS,
        run_up=RUN_UP,
        begins=RUN_UP - LANE_CHANGE / 2,
        size=len(drawn.table),
        least=f"{drawn.edges[0]:.3g}",
        safe=f"{drawn.assumed_safe:.6f}",
        harder=f"{drawn.probabilities.sum():.4g}",
        shells=shells,
        origin="\n".join(f"- {name}: {value}" for name, value in origin.items()),
    )
