"""Write a weighted set of scenarios to a folder: scenario files, weights, and a page of instructions."""

import os
import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import write_csv, write_text
from accelerated_evaluation.laws.motion import SPEED_COLUMNS, LeadMotion, draw_lead_speeds
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.scenarios.outcomes import Outcome
from accelerated_evaluation.scenarios.protocol import Scenario
from accelerated_evaluation.track.recipe import (
    ALL_LAWS,
    CUT_IN_FILES,
    CUT_INS,
    ENCOUNTERS,
    MOVING,
    ONE_LAW,
    RECIPE,
    STILL,
    WHOLE,
)
from accelerated_evaluation.track.scenarios import (
    LANE_CHANGE_BEGINS,
    RUN_UP,
    WRITERS,
    ConcreteScenario,
    require_scenariogeneration,
    write_scenarios,
)
from accelerated_evaluation.track.weighted_set import POOL, WeightedSet

TABLE, WEIGHTS = "scenarios.csv", "weights.csv"


def write_set(
    folder: str | os.PathLike, drawn: WeightedSet, origin: Mapping[str, str], scenario: Scenario
) -> None:
    """Write a weighted set into a new folder, which appears only when it is complete.

    The folder contains ``scenarios.csv`` and ``README.md``; for a set with draws of the law ``weights.csv``;
    and for cut-ins the OpenSCENARIO files and their road. ``origin`` are statements about the origin of the
    set, which the page lists by name. InputError is raised if the folder is not empty, and StudyError if the
    library scenariogeneration is needed but not installed.
    """
    if scenario.name in WRITERS:
        require_scenariogeneration()
    folder = Path(folder)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        change = "Name another folder, because files of two sets must not be mixed."
        raise InputError(
            str(folder), seen="a file, or a folder with files", expected="no folder yet", change=change
        )
    folder.parent.mkdir(parents=True, exist_ok=True)
    temporary = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
    try:
        names = [f"scenario_{number:03d}" for number in drawn.table["scenario"]]
        if scenario.name in WRITERS:
            write_scenarios(temporary, map(_scenario, names, drawn.table.to_dict("records")))
        write_csv(temporary / TABLE, table_of(drawn, names, scenario))
        if drawn.draws is not None:
            write_csv(temporary / WEIGHTS, drawn.draws)
        write_text(temporary / "README.md", page(drawn, origin, scenario))
        temporary.chmod(0o755)
        temporary.replace(folder)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def table_of(drawn: WeightedSet, names: list[str], scenario: Scenario) -> pd.DataFrame:
    """Return the table ``scenarios.csv`` of a weighted set.

    It has the derived quantities of the scenario, such as the host speed, and for cut-ins the column
    ``file``; the names of the scenarios are those of their files without the ending.
    """
    files = {"file": [f"{name}.xosc" for name in names]} if scenario.name in WRITERS else {}
    return drawn.table.assign(**scenario.derived, **files)


def _scenario(name: str, row: Mapping[str, float]) -> ConcreteScenario:
    notes = {"weight": repr(float(row["weight"])), "shell": str(int(row["shell"]))}
    later_speeds = [row[column] for column in SPEED_COLUMNS if column in row]
    return ConcreteScenario(name, row["lead_speed"], row["range"], row["closing_speed"], notes, later_speeds)


def with_motion(drawn: WeightedSet, motion: LeadMotion, generator: np.random.Generator) -> WeightedSet:
    """Add a random motion of the lead vehicle to each cut-in of a weighted set.

    The motions are drawn from their law, so the weights do not change. The lead speeds [m/s] after the cut-in
    are in the columns `SPEED_COLUMNS`.
    """
    encounters = drawn.table[list(CUT_IN.names)].to_numpy(dtype=float).T
    speeds = draw_lead_speeds(motion, encounters, generator)[:, 1:]
    later = pd.DataFrame(speeds, columns=list(SPEED_COLUMNS), index=drawn.table.index)
    return replace(drawn, table=drawn.table.join(later))


def page(drawn: WeightedSet, origin: Mapping[str, str], scenario: Scenario) -> str:
    """Return the page of instructions: how to compute the crash probability from a vehicle's outcomes."""
    parts = _parts_of(drawn, scenario) if drawn.scored else _parts_of_cut_ins(drawn)
    counts = drawn.table["shell"].value_counts(sort=False)
    beyond = "more" if drawn.edges[-1] > drawn.edges[0] else "less"
    ends = [*(f"{edge:.2f}" for edge in drawn.edges[1:]), beyond]
    shells = "\n".join(
        f"| {shell} | {edge:.2f} to {end} | {probability:.4g} | {counts[shell]} |"
        for shell, (edge, end, probability) in enumerate(
            zip(drawn.edges, ends, drawn.probabilities, strict=True), start=1
        )
    )
    return RECIPE.format(
        whole="" if drawn.draws is None else WHOLE.format(noun=scenario.noun, draws=drawn.draws.shape[1] - 1),
        uncertainty=(ONE_LAW if drawn.draws is None else ALL_LAWS).format(noun=scenario.noun),
        noun=scenario.noun,
        size=len(drawn.table),
        shells=shells,
        origin="\n".join(f"- {name}: {value}" for name, value in origin.items()),
        **parts,
    )


def _parts_of_cut_ins(drawn: WeightedSet) -> dict[str, str]:
    """Return the parts of the page for cut-ins that are ordered by the deceleration that they need."""
    numbers = {
        "least": f"{drawn.edges[0]:.3g}",
        "safe": f"{drawn.assumed_safe:.6f}",
        "harder": f"{drawn.probabilities.sum():.4g}",
    }
    return {name: part.format(**numbers) for name, part in CUT_INS.items()} | _cut_ins_in_words(drawn)


def _cut_ins_in_words(drawn: WeightedSet) -> dict[str, str]:
    """Return the parts of the page that describe cut-ins and their files."""
    numbers = {"run_up": RUN_UP, "begins": LANE_CHANGE_BEGINS}
    numbers |= MOVING if SPEED_COLUMNS[0] in drawn.table else STILL
    return {name: part.format(**numbers) for name, part in CUT_IN_FILES.items()}


def _parts_of(drawn: WeightedSet, scenario: Scenario) -> dict[str, str]:
    """Return the parts of the page for encounters that are ordered by the score of a built-in vehicle."""
    outcomes = {each.name: each for each in scenario.outcomes}
    score = outcomes.get(scenario.events[0].scored_by, Outcome("score", "", "the score of the event"))
    known = {
        "description": scenario.description,
        "variables": "\n".join(
            f"  - `{each.name}` [{each.unit}]: {each.description}" for each in scenario.variables
        ),
        "crash": outcomes["crash"].description,
        "pool": POOL,
        "vehicle": scenario.default_vehicle,
        "score": f"{score.name} [{score.unit}]",
        "score_meaning": score.description,
    }
    parts = {name: part.format(**known) for name, part in ENCOUNTERS.items()}
    return parts | (_cut_ins_in_words(drawn) if scenario.name in WRITERS else {})
