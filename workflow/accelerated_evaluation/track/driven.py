"""The reported outcomes of runs on a proving ground, and the files on which a campaign is based."""

import os
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from accelerated_evaluation.base.files import file_digest
from accelerated_evaluation.base.tables import require_file
from accelerated_evaluation.laws import Law
from accelerated_evaluation.methods.problem import read_law_of
from accelerated_evaluation.records.segments import read_encounters
from accelerated_evaluation.scenarios.protocol import Scenario


@dataclass(frozen=True)
class Source:
    """An input file with the SHA-256 checksum of its contents."""

    file: str
    sha256: str


def source_of(path: str | os.PathLike) -> Source:
    """Return a file with its checksum; raise InputError if it does not exist."""
    path = Path(path)
    require_file(path, "Correct the path.")
    return Source(str(path), file_digest(path))


def law_in(scenario: Scenario, law: Source, encounters: Source | None) -> Law:
    """Read a law: for cut-ins with the encounter table to which it was fitted, otherwise a joint law.

    InputError is raised if a file cannot be used, or if the law belongs to another scenario.
    """
    return read_law_of(scenario, law.file, None if encounters is None else read_encounters(encounters.file))


@dataclass(frozen=True)
class DrivenOutcome:
    """The reported outcome of a run that was driven."""

    crash: bool
    # By name, such as the smallest range; quantities that were not measured are left out.
    measured: dict[str, float] = field(default_factory=dict)
    note: str = ""  # a remark of the testers


BEYOND = DrivenOutcome(False, note="beyond the limits, not to be driven")


def outcomes_of(driven: Iterable[DrivenOutcome], scenario: Scenario) -> Any:  # noqa: ANN401
    """Convert reported outcomes to the type of outcomes that a simulation of the scenario returns.

    If an event is scored by a quantity that was not measured, the quantity gets the value 0 after a crash and
    infinity otherwise. All other quantities that were not measured are 0. All runs are marked as ended.
    """
    rows = list(driven)
    crash = np.array([row.crash for row in rows])
    nearness = {event.scored_by for event in scenario.events}

    def column(name: str) -> np.ndarray:
        unknown = np.where(crash, 0.0, np.inf) if name in nearness else np.zeros(len(rows))
        given = zip(rows, unknown.tolist(), strict=True)
        return np.array([row.measured.get(name, value) for row, value in given])

    columns = {name: column(name) for name in scenario.measured}
    flags = {each.name: np.ones(len(rows), bool) for each in scenario.outcomes if each.is_flag}
    return scenario.outcome_type(**flags | {"crash": crash} | columns)


def outcome_in_words(driven: DrivenOutcome) -> str:
    """Return the outcome of a run as text for a message, such as ``no crash, min_range 2.5``."""
    measured = [f"{name} {value:g}" for name, value in driven.measured.items()]
    return ", ".join(["crash" if driven.crash else "no crash", *measured])
