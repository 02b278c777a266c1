"""The files of the law of a campaign or weighted set, with their checksums."""

import os
from dataclasses import dataclass
from pathlib import Path

from accelerated_evaluation.base.files import file_digest
from accelerated_evaluation.base.tables import require_file
from accelerated_evaluation.laws import Law
from accelerated_evaluation.methods.problem import read_law_of
from accelerated_evaluation.records.segments import read_encounters
from accelerated_evaluation.scenarios.protocol import Scenario


@dataclass(frozen=True)
class InputFile:
    """An input file with the SHA-256 checksum of its contents."""

    file: str
    sha256: str


def source_of(path: str | os.PathLike) -> InputFile:
    """Return a file with its checksum; raise InputError if it does not exist."""
    path = Path(path)
    require_file(path, "Correct the path.")
    return InputFile(str(path), file_digest(path))


def law_in(scenario: Scenario, law: InputFile, encounters: InputFile | None) -> Law:
    """Read a law: for cut-ins with the encounter table to which it was fitted, otherwise a joint law.

    InputError is raised if a file cannot be used, or if the law belongs to another scenario.
    """
    return read_law_of(scenario, law.file, None if encounters is None else read_encounters(encounters.file))
