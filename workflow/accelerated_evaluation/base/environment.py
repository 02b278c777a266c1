"""The packages that the study needs, and which of them are not installed; needs only the standard library."""

import re
import tomllib
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

TO_INSTALL = (
    "install them with `make environment`, which makes the locked environment .venv (then `source "
    ".venv/bin/activate`), or with `python -m pip install --editable '.[study]'` in the environment of Snakemake"
)


def missing_packages(project: Path) -> list[str]:
    """Return the names of the packages that the study needs and that are not installed.

    They are read from ``pyproject.toml`` in the folder ``project``. The list is empty if there is no such
    file, because the study was then installed with its dependencies. Versions are not compared.
    """
    file = project / "pyproject.toml"
    if not file.is_file():
        return []
    known = tomllib.loads(file.read_text(encoding="utf-8"))["project"]
    needed = [*known["dependencies"], *known["optional-dependencies"]["study"]]
    return [name for each in needed if not _is_installed(name := re.match(r"[\w.-]+", each)[0])]


def _is_installed(name: str) -> bool:
    try:
        version(name)
    except PackageNotFoundError:
        return False
    return True


def missing_in_words(project: Path) -> str:
    """Return a sentence that says which packages are missing and how to install them; empty if none are."""
    missing = ", ".join(missing_packages(project))
    return missing and f"the study needs Python packages that are not installed here ({missing}); {TO_INSTALL}"
