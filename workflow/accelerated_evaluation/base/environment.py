"""The packages that the study needs, and which of them are not installed; needs only the standard library."""

import os
import re
import sys
import tomllib
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[3]
TO_INSTALL = (
    "install them with `make environment`, which makes the locked environment .venv (then `source "
    ".venv/bin/activate`), or with `python -m pip install --editable ./fewruns --editable '.[study]'` in the "
    "environment of Snakemake"
)


def import_from_here() -> None:
    """Let this process and the jobs that it starts import the library from the clone of this module.

    Otherwise jobs in a container would import the copy of the library in its image, and an environment with
    the packages of `missing_packages` alone would not suffice.
    """
    folders = [folder for folder in (PROJECT / "workflow", PROJECT / "fewruns" / "src") if folder.is_dir()]
    own = [str(folder) for folder in folders]
    sys.path += [folder for folder in own if folder not in sys.path]
    given = [folder for folder in os.environ.get("PYTHONPATH", "").split(os.pathsep) if folder]
    os.environ["PYTHONPATH"] = os.pathsep.join(dict.fromkeys([*own, *given]))


def missing_packages(project: Path = PROJECT) -> list[str]:
    """Return the names of the packages that the study needs and that are not installed.

    They are read from ``pyproject.toml`` in the folder of a clone. The list is empty if there is no such
    file, because the study was then installed with its dependencies. Versions are not compared. Packages of
    the clone itself need not be installed.
    """
    file = project / "pyproject.toml"
    if not file.is_file():
        return []
    known = tomllib.loads(file.read_text(encoding="utf-8"))["project"]
    needed = [*known["dependencies"], *known["optional-dependencies"]["study"]]
    names = [re.split(r"[^\w.-]", each)[0] for each in needed]
    return [name for name in names if not (_is_installed(name) or (project / name / "src").is_dir())]


def missing_in_words(project: Path = PROJECT) -> str:
    """Return a sentence that says which packages are missing and how to install them; empty if none are."""
    missing = ", ".join(missing_packages(project))
    return (
        missing and f"the study needs Python packages that are not installed here ({missing}); {TO_INSTALL}"
    )


def _is_installed(name: str) -> bool:
    try:
        version(name)
    except PackageNotFoundError:
        return False
    return True
