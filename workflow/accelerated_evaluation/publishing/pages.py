"""The pages of the project with placeholders: README, guides and pages of the benchmarks.

``make pages``, or ``python -m accelerated_evaluation.publishing.pages`` in the folder of the project, fills
them in again.
"""

from pathlib import Path
from typing import Any

from accelerated_evaluation.base.files import write_text
from accelerated_evaluation.publishing.named_numbers import FUNCTIONS, Tables, read_numbers
from accelerated_evaluation.publishing.tables.evidence import rests_in_words
from accelerated_evaluation.publishing.texts import FILLED, refill

FOLDERS = ("docs", "fewruns", "benchmarks")
DEFAULT = "spmd"  # the study whose named numbers the pages state


def pages(root: Path) -> list[Path]:
    """Return the pages in Markdown that contain placeholders."""
    found = [*root.glob("*.md"), *(path for name in FOLDERS for path in (root / name).rglob("*.md"))]
    return sorted(path for path in found if FILLED.search(path.read_text(encoding="utf-8")))


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


def fill_pages(root: Path) -> None:
    """Fill in all pages again."""
    names = names_of_pages(root)
    for path in pages(root):
        write_text(path, refill(path.read_text(encoding="utf-8"), names))


if __name__ == "__main__":
    fill_pages(Path())
