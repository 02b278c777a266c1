"""The PDF of the article, which Typst makes from the filled text and the figures of a study."""

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import typst

from accelerated_evaluation.base.errors import StudyError
from accelerated_evaluation.base.files import atomic_path, write_text
from accelerated_evaluation.publishing.article.text import TEXT, shown_figures
from accelerated_evaluation.publishing.named_numbers import FUNCTIONS, Tables, read_numbers
from accelerated_evaluation.publishing.provenance import origin_of
from accelerated_evaluation.publishing.study import Study
from accelerated_evaluation.publishing.tables.claims import departure
from accelerated_evaluation.publishing.tables.exact import best_known
from accelerated_evaluation.publishing.texts import fill, typeset


@dataclass(frozen=True)
class Sources:
    """The files from which an article is made, apart from the results of the study."""

    text: Path  # folder with ``article.typ``, its style and its bibliography
    benchmarks: Path  # folder with the tables of the benchmarks
    captions: Path  # folder with the captions of the figures, ``<name>.rst``


def names_of(study: Study, sources: Sources) -> dict[str, Any]:
    """Return what placeholders of the article may use, such as numbers, tables and captions of figures."""
    figures = shown_figures(sources.text)
    return FUNCTIONS | {
        "n": read_numbers(study.figures),
        "tables": Tables(study.figures / "tables"),
        "results": Tables(sources.benchmarks),
        "study": study,
        "departure": departure(study.premises, study.source),
        "captions": {name: _first_paragraph(study.caption(sources.captions, name)) for name in figures},
        "origin": {"version": version("accelerated-evaluation"), **origin_of(study)},
        "best_known": best_known,
    }


def write_article(study: Study, sources: Sources, pdf: Path) -> None:
    """Write the article of a finished study as a PDF.

    StudyError is raised if a placeholder of the text fails, or Typst cannot compile it.
    """
    with TemporaryDirectory(prefix=".article.") as folder:
        compile_text(filled_folder(Path(folder), names_of(study, sources), sources.text, study.figures), pdf)


def filled_folder(folder: Path, names: Mapping[str, Any], text: Path, figures: Path) -> Path:
    """Copy the text of the article and its figures to a folder, fill in the text, and return the folder."""
    shutil.copytree(text, folder, dirs_exist_ok=True)
    (folder / "figures").mkdir()
    for name in shown_figures(text):
        shutil.copy(figures / f"{name}.pdf", folder / "figures")
    write_text(folder / TEXT, fill((text / TEXT).read_text(encoding="utf-8"), names))
    return folder


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
