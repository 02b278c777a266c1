"""What a rule depends on besides its files: the code of the library, and sections of the configuration.

Snakemake detects that a script has changed, but not that a module which it imports has been edited. Rules
therefore have digests of the library's code among their parameters.
"""

import os
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import fewruns

from accelerated_evaluation.base.extensions import Extension, known
from accelerated_evaluation.base.files import content_digest

# The rooms (packages) of the library, and the distribution of the sampler. Each imports only what stands
# before it in this order, which a test checks.
SAMPLER = "fewruns"
ROOMS: tuple[str, ...] = (
    "base",
    "records",
    SAMPLER,
    "laws",
    "scenarios",
    "vehicles",
    "crash_map",
    "methods",
    "answer",
    "track",
    "study",
)
ROOMS += ("publishing", "commands")
LIBRARY = Path(__file__).resolve().parents[1]
JOBS = "study/jobs"  # the module that all scripts use


def code_up_to(room: str, *uses: str) -> dict[str, str]:
    """Return digests of all code that a script importing from ``room`` may run, by the name of the room.

    Extensions are also included, by the names of `extension_names`, if they add members to one of the parts
    ``uses`` of the library (`Extension.adds_to`), by default to one of all these rooms. A script that imports
    a room need not use all members in it. For example, the records of a study are read without any law, and
    one method estimates without the others.
    """
    rooms = ROOMS[: ROOMS.index(room) + 1]
    extensions = [name for name, each in extension_names().items() if each.adds_to(*(uses or rooms))]
    return {name: digest_of(name) for name in (JOBS, *rooms, *extensions)}


def extension_names() -> dict[str, Extension]:
    """Return the extensions by name; files have their path from the working directory."""
    return {os.path.relpath(name) if os.path.isabs(name) else name: each for name, each in known().items()}


def files_of(room: str) -> list[Path]:
    """Return the Python files of a room or an extension, or the one of a module such as ``study/jobs``."""
    if (extension := extension_names().get(room)) is not None:
        return extension.files
    module = LIBRARY / f"{room}.py"
    folder = Path(fewruns.__file__).parent if room == SAMPLER else LIBRARY / room
    return [module] if module.is_file() else sorted(folder.rglob("*.py"))


@cache
def digest_of(room: str) -> str:
    """Return the SHA-256 of the contents of the files of a room."""
    return content_digest(files_of(room))


def in_order(value: Any) -> Any:  # noqa: ANN401
    """Return a value of the configuration with the keys of all mappings in alphabetical order.

    Snakemake compares parameters as text, so equal settings in a different order would count as a change.
    """
    if isinstance(value, Mapping):
        return {key: in_order(value[key]) for key in sorted(value)}
    return [in_order(item) for item in value] if isinstance(value, list) else value


def without_unused(config: Mapping[str, Any], sources: Iterable[str]) -> dict[str, Any]:
    """Return a configuration without the sections of data sources that the study does not use.

    Editing an unused section must not cause any job to run again.
    """
    unused = set(sources) - {config["data"]["source"]}
    data = {key: value for key, value in config["data"].items() if key not in unused}
    return {**config, "data": data}
