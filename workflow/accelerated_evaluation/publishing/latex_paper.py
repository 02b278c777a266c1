"""A folder for a LaTeX paper: figures, tables, a macro for each number, and an example."""

import re
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path

import pandas as pd
from matplotlib.font_manager import findfont
from tqdm import tqdm

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import PROJECT, write_text
from accelerated_evaluation.publishing.book.catalogue import read_contents
from accelerated_evaluation.publishing.book.execution import run_notebook
from accelerated_evaluation.publishing.figures.style import Print, printed
from accelerated_evaluation.publishing.named_numbers import Tables
from accelerated_evaluation.publishing.provenance import origin_of
from accelerated_evaluation.publishing.study import Study
from accelerated_evaluation.publishing.tables.display import as_latex, readable

WIDTHS = {"one_column": 3.48, "two_columns": 7.14}  # [in], of the class IEEEtran
EXAMPLE = PROJECT / "workflow" / "paper" / "example.tex"
DIGITS = ("Zero", "One", "Two", "Three", "Four", "Five", "Six", "Seven", "Eight", "Nine")
VALUES = {"paper": "Paper", "ours": "Ours", "ours_low": "OursLow", "ours_high": "OursHigh"}
SHORT = ("claim", "paper", "ours", "verdict")  # columns of the table of claims that a column of text can hold


def write_paper(study: Study, target: Path, font: str, figure: str | None = None) -> None:
    """Write figures, tables and numbers of a study to a folder for a LaTeX paper, and replace existing files.

    It contains ``figures/one_column``, ``figures/two_columns``, ``tables``, ``numbers.tex`` and
    ``example.tex``. The font family of the figures should be that of the paper's text. If the name of one
    figure or its beginning is given, such as "fig12", only this figure is written. InputError is raised if a
    result of the study or the figure is missing, or the font is not installed.
    """
    _require_font(font)
    study.path("config.json")
    folders = {width: target / "figures" / name for name, width in WIDTHS.items()}
    if figure is not None:
        name = _published_figure(study, figure)
        draw(study, Print(font, folders, name), [_notebook_with(name)])
        return
    notebooks = sorted((PROJECT / "notebooks").glob("*.ipynb"))
    draw(study, Print(font, folders), [path for path in notebooks if read_contents(path).figures])
    tables = study.figures / "tables"
    for path in sorted(tables.glob("*.tex")):
        write_text(target / "tables" / path.name, path.read_text(encoding="utf-8"))
    claims = pd.read_csv(tables / "claims.csv")
    write_text(target / "tables" / "claims_short.tex", _short(claims))
    write_text(target / "numbers.tex", numbers(claims, Tables(study.figures)["numbers"], origin_of(study)))
    shutil.copyfile(EXAMPLE, target / "example.tex")


def numbers(claims: pd.DataFrame, named: pd.DataFrame, origin: dict[str, str]) -> str:
    r"""Return LaTeX code that defines a macro for each named number and claim, and for the provenance.

    The macro of the named number ``answer_median`` is ``\AnswerMedian``. That of a claim consists of the
    claim and of the kind of number: ``\CruxOursLow`` is the lower end of our spread of the claim "crux".
    Macro names have letters only, so digits are written as words. InputError is raised if two macros would
    have the same name.
    """
    macros = [(f"Study{key.capitalize()}", value.replace("_", r"\_")) for key, value in origin.items()]
    macros += [
        (macro(name), readable(value)) for name, value in zip(named["name"], named["value"], strict=True)
    ]
    for claim in claims.to_dict("records"):
        name = macro(claim["claim"])
        macros += [(name + end, readable(claim[key])) for key, end in VALUES.items()]
    names = pd.Series([name for name, _ in macros])
    if names.duplicated().any():
        twice = names[names.duplicated()].iloc[0]
        raise InputError(
            "tables/claims.csv",
            seen=f"two numbers for which the macro would be \\{twice}",
            expected="names that give different macros",
            change="Change the name of one of the two claims or numbers.",
        )
    lines = [f"\\newcommand{{\\{name}}}{{{as_latex(str(value))}}}\n" for name, value in macros]
    return "% Numbers of the study; write \\Name{} in the text.\n" + "".join(lines)


def macro(name: str) -> str:
    """Return the name of a macro: each word of a name with a capital letter, and digits as words."""
    words = re.findall(r"[A-Za-z]+|\d", name)
    return "".join(DIGITS[int(word)] if word.isdigit() else word[0].upper() + word[1:] for word in words)


def draw(study: Study, settings: Print, notebooks: Sequence[Path]) -> None:
    """Run notebooks again to draw their figures in the style of the paper.

    Their other outputs go to a temporary folder, which is deleted.
    """
    with tempfile.TemporaryDirectory() as folder, printed(settings):
        parameters = {"results": str(study.results.resolve()), "figures": f"{folder}/figures/{study.name}"}
        for notebook in tqdm(notebooks, desc="Drawing", unit=" notebooks"):
            run_notebook(str(notebook), parameters, f"{folder}/notebook.ipynb")


def _short(claims: pd.DataFrame) -> str:
    """Return the claims with the paper's number, ours and the verdict, as a table for one column of text."""
    shown = claims[list(SHORT)].map(readable)
    return as_latex(shown.to_latex(index=False, escape=True, column_format="p{2.9cm}rrl"))


def _published_figure(study: Study, beginning: str) -> str:
    """Return the name of the published figure that begins in this way, or raise InputError."""
    names = sorted(path.stem for path in study.figures.glob("fig*.csv"))
    found = [name for name in names if f"{name}_".startswith(f"{beginning}_")]
    if len(found) != 1:
        raise InputError(
            "--figure",
            seen=beginning,
            expected=f"the number or the name of a figure in {study.figures}: {', '.join(names)}",
            change="Write for example fig12, or make the figures of the study first.",
        )
    return found[0]


def _notebook_with(figure: str) -> Path:
    """Return the first notebook that publishes a figure."""
    paths = sorted((PROJECT / "notebooks").rglob("*.ipynb"))
    return next(path for path in paths if figure in read_contents(path).figures)


def _require_font(font: str) -> None:
    """Raise InputError if Matplotlib does not find the font."""
    try:
        findfont(font, fallback_to_default=False)
    except ValueError as error:
        raise InputError(
            "--font", seen=font, expected="a font that is installed", change="See `fc-list : family`."
        ) from error
