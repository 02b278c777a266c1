"""The pages of the project with placeholders: README, guides and pages of the benchmarks.

A page ``NAME.md`` is made from its template ``NAME.md.in`` in the same folder. ``make pages``, or
``python -m accelerated_evaluation.publishing.pages`` in the folder of the project, makes them again.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from accelerated_evaluation.base.files import write_text
from accelerated_evaluation.publishing.named_numbers import FUNCTIONS, Tables, read_numbers
from accelerated_evaluation.publishing.tables.evidence import rests_in_words
from accelerated_evaluation.publishing.texts import fill

FOLDERS = ("docs", "fewruns", "benchmarks")
DEFAULT = "spmd"  # the study whose named numbers the pages state


def templates(root: Path) -> list[Path]:
    """Return the templates of pages."""
    return sorted(
        [*root.glob("*.md.in"), *(path for name in FOLDERS for path in (root / name).rglob("*.md.in"))]
    )


def names_of_pages(root: Path) -> dict[str, Any]:
    """Return what placeholders of pages may use.

    These are the tables of each published study by its name, the tables ``results`` of the benchmarks, the
    named numbers ``n`` of the default study, and functions.
    """
    figures = root / "figures"
    studies = {folder.name: Tables(folder / "tables") for folder in figures.iterdir()}
    numbers = read_numbers(figures / DEFAULT)
    functions = FUNCTIONS | {"rests_in_words": rests_in_words}
    return studies | functions | {"n": numbers, "results": Tables(root / "benchmarks" / "results")}


def filled(template: Path, names: Mapping[str, Any]) -> str:
    """Return a page, which begins with a comment that names its template."""
    text = fill(template.read_text(encoding="utf-8"), names)
    return f"<!-- Made from {template.name} by `make pages`; edit that file. -->\n\n{text}\n"


def fill_pages(root: Path) -> None:
    """Make all pages of the project from their templates."""
    names = names_of_pages(root)
    for template in templates(root):
        write_text(template.with_suffix(""), filled(template, names))


if __name__ == "__main__":
    fill_pages(Path())
