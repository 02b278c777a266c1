"""The modules of the library that a rule of the benchmarks depends on."""

import os

from accelerated_evaluation.study.dependencies import ROOMS, files_of


def modules_up_to(room: str) -> list[str]:
    """Return the relative paths of all modules that code which imports from ``room`` may run."""
    return [os.path.relpath(path) for name in ROOMS[: ROOMS.index(room) + 1] for path in files_of(name)]
