"""The PDF of the article, which Typst makes from the text, the numbers and the figures of a study."""

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import typst

from accelerated_evaluation.base.errors import InputError, StudyError
from accelerated_evaluation.base.files import atomic_path, write_json
from accelerated_evaluation.publishing.article.numbers import collect
from accelerated_evaluation.publishing.article.tables import TEXT, Tables, shown_figures, typeset
from accelerated_evaluation.publishing.provenance import origin_of
from accelerated_evaluation.publishing.study import Study

NUMBERS = "numbers.json"


@dataclass(frozen=True)
class Sources:
    """The files from which an article is made, apart from the results of the study."""

    text: Path  # folder with ``article.typ``, its style and its bibliography
    benchmarks: Path  # folder with the tables of the benchmarks
    captions: Path  # folder with the captions of the figures, ``<name>.rst``


def numbers_of(study: Study, sources: Sources) -> dict[str, Any]:
    """Return all data that the text of the article uses: numbers, captions of its figures, and provenance."""
    figures = shown_figures(sources.text)
    tables = Tables(study.figures / "tables")
    try:
        numbers = collect(tables, Tables(sources.benchmarks), study)
    except (AttributeError, LookupError, TypeError, ValueError) as error:
        raise InputError(
            f"{study.figures / 'tables' / tables.last}.csv, or a table that was read before",
            seen=f"content that cannot be used ({type(error).__name__}: {error})",
            expected="a complete table of a finished study, with rows below its header",
            change="Delete the table, and run the study again: make study.",
        ) from error
    captions = {name: _first_paragraph(study.caption(sources.captions, name)) for name in figures}
    origin = {"version": version("accelerated-evaluation"), **origin_of(study)}
    return numbers | {"captions": captions, "provenance": origin}


def write_article(study: Study, sources: Sources, pdf: Path, numbers: Path) -> None:
    """Write the article of a finished study as a PDF, and the numbers that it uses as JSON.

    StudyError is raised if Typst cannot compile the text.
    """
    known = numbers_of(study, sources)
    with TemporaryDirectory(prefix=".article.") as folder:
        for path in sources.text.iterdir():
            shutil.copy(path, folder)
        (Path(folder) / "figures").mkdir()
        for name in known["captions"]:
            shutil.copy(study.figures / f"{name}.pdf", Path(folder) / "figures")
        write_json(Path(folder) / NUMBERS, known)
        compile_text(Path(folder), pdf)
    write_json(numbers, known)


def compile_text(folder: Path, pdf: Path) -> None:
    """Compile ``article.typ`` to a PDF that depends on the files in its folder only.

    The fonts are those that Typst contains, and no date is written. StudyError contains the message of Typst.
    """
    with atomic_path(pdf) as temporary:
        try:
            typst.compile(
                folder / TEXT, output=temporary, root=folder, format="pdf", ignore_system_fonts=True
            )
        except typst.TypstError as error:
            raise StudyError(f"Typst cannot compile {TEXT}: {error.message}") from error


def _first_paragraph(caption: Sequence[str]) -> str:
    """Return the first paragraph of a caption as plain text."""
    return typeset(" ".join(caption[0].split()).replace("`", ""))
