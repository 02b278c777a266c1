"""What each notebook reads and makes, from its metadata, and the tables from which named numbers follow.

The key ``study`` of a notebook's metadata lists the figures and tables that it publishes, and the results
that it reads::

    "study": {
        "figures": ["fig02_data"], "tables": ["account"], "reads": ["encounters.parquet"],
        "optional": [{"figures": ["fig30_preventable"], "tables": [], "reads": ["happened/preventable.csv"]}]
    }

A part of a name in braces, as in ``cross_entropy/{method}_0.json``, represents several files. A study has the
notebooks for which it makes all results in ``reads``, whatever its scenario and however slow its vehicle is.
Each part in ``optional`` belongs to the notebook if the study makes all results of this part, too. When a
notebook runs, `publishing.book.execution` compares this declaration with what the notebook did.
"""

import json
import re
from collections.abc import Callable, Iterable
from itertools import chain
from pathlib import Path
from typing import NamedTuple

from accelerated_evaluation.base.errors import InputError


class Contents(NamedTuple):
    """The inputs and outputs of a notebook, or of a part of it."""

    figures: list[str]  # names of the published figures
    tables: list[str]  # names of the published tables
    reads: list[str]  # paths of the results, relative to their folder


def read_contents(notebook: Path, is_made: Callable[[str], bool] = lambda _: True) -> Contents | None:
    """Return what the metadata of a notebook declare, or raise InputError.

    ``is_made`` says whether a study makes a result. Optional parts without all of their results are left out,
    and None is returned if the study does not make a result that the notebook needs.
    """
    declared = json.loads(notebook.read_text(encoding="utf-8"))["metadata"].get("study", {})
    parts = [
        {name: part for name, part in declared.items() if name != "optional"},
        *declared.get("optional", []),
    ]
    for part in parts:
        if set(part) != set(Contents._fields):
            raise InputError(
                f"{notebook}, key study of the metadata",
                seen=f"the lists {sorted(part)}",
                expected="the figures and tables that the notebook publishes, and the results that it reads",
                change='Write three lists of names: "study": {"figures": [], "tables": [], "reads": []}, and '
                'the same three in each part of the list "optional", if there is one.',
            )
    needed, *optional = (Contents(*map(tuple, (part[name] for name in Contents._fields))) for part in parts)
    if not all(map(is_made, needed.reads)):
        return None
    had = [needed, *(part for part in optional if all(map(is_made, part.reads)))]
    return Contents(*(tuple(dict.fromkeys(chain(*names))) for names in zip(*had, strict=True)))


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


def tables_of_numbers(definitions: Path) -> dict[str, list[str]]:
    """Return the names of the tables from which named numbers follow: of the study, and of the benchmarks."""
    text = definitions.read_text(encoding="utf-8")
    return {
        group: sorted(set(re.findall(rf"\b{group}\.([a-z]\w*)", text))) for group in ("tables", "results")
    }
