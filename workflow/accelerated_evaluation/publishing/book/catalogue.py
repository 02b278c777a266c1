"""Inputs and outputs of each notebook, which its metadata declare, for the rules of the workflow.

The key ``study`` of a notebook's metadata lists the figures and tables that it publishes, and the results
that it reads::

    "study": {"figures": ["fig02_data"], "tables": ["account"], "reads": ["encounters.parquet"]}

A part of a name in braces, as in ``cross_entropy/{method}_0.json``, represents several files. When a notebook
runs, `publishing.book.execution` compares this declaration with what the notebook did.
"""

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from accelerated_evaluation.base.errors import InputError


class Contents(NamedTuple):
    """The inputs and outputs of a notebook."""

    figures: Sequence[str]  # names of the published figures
    tables: Sequence[str]  # names of the published tables
    reads: Sequence[str]  # paths of the results, relative to their folder


def read_contents(notebook: Path) -> Contents:
    """Return what the metadata of a notebook declare, or raise InputError."""
    declared = json.loads(notebook.read_text(encoding="utf-8"))["metadata"].get("study", {})
    if set(declared) != set(Contents._fields):
        raise InputError(
            f"{notebook}, key study of the metadata",
            seen=f"the lists {sorted(declared)}",
            expected="the figures and tables that the notebook publishes, and the results that it reads",
            change='Write three lists of names: "study": {"figures": [], "tables": [], "reads": []}.',
        )
    return Contents(**{name: tuple(declared[name]) for name in Contents._fields})


def require_captions(names: Iterable[str], folder: Path) -> None:
    """Raise InputError if a figure or table has no caption ``<name>.rst``, or a name occurs twice."""
    seen = set()
    for name in names:
        caption = folder / f"{name}.rst"
        if not caption.is_file():
            raise InputError(
                str(caption), seen="no such file", expected=f"the caption of {name}", change="Write it."
            )
        if name in seen:
            raise InputError(
                name, seen="two uses", expected="a single notebook that shows it", change="Show it once."
            )
        seen.add(name)
