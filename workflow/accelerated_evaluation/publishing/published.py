"""Registration of figures and tables: a decorator registers each, and one call in a notebook publishes it.

A new figure needs a function in `publishing.figures`, a call in a notebook, and a caption::

    @figure
    def fig25_example(estimates: pd.DataFrame, alpha: float) -> tuple[Figure, pd.DataFrame]:
        ...

    show(study, fig25_example)      # in the notebook

The name of the function is the name of its files and of its caption, ``workflow/report/fig25_example.rst``.
The names of its parameters are those of the properties of `Study` that it uses. The metadata of the notebook
list the figure, and the results that it reads (`publishing.book.catalogue`). The title of a figure states its
finding; it is a template in ``workflow/titles.yaml`` (`title_of`).
"""

import inspect
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import wraps
from html import escape
from pathlib import Path
from typing import Any, TypeVar

import pandas as pd
import yaml
from matplotlib.figure import Figure
from pandas.errors import UndefinedVariableError

from accelerated_evaluation.base.arguments import A_FUNCTION, Argument, one_of
from accelerated_evaluation.base.checking import checked
from accelerated_evaluation.base.errors import InputError, StudyError
from accelerated_evaluation.base.files import PROJECT
from accelerated_evaluation.base.registry import Registry
from accelerated_evaluation.base.users_code import call
from accelerated_evaluation.publishing import figures
from accelerated_evaluation.publishing.figures.style import (
    COLUMN_WIDTH,
    Drawn,
    note_source,
    paper_style,
    save_figure,
)
from accelerated_evaluation.publishing.provenance import figure_metadata
from accelerated_evaluation.publishing.study import FILES, Study
from accelerated_evaluation.publishing.tables.display import as_html, readable, save_table
from accelerated_evaluation.publishing.texts import UNKNOWN, fill

Make = TypeVar("Make", bound=Callable[..., Any])
WIDTH = 150 * COLUMN_WIDTH  # [px], width of a figure in a notebook
CAPTIONS = PROJECT / "workflow/report"
TITLES = PROJECT / "workflow/titles.yaml"
# Results that every study has.
ALWAYS = ("config.json", "contents.json", "encounters.parquet", "records_report.csv")
# Functions that make figures, by the names of the figures.
FIGURES: Registry[Callable[..., Any]] = Registry("figure", figures.__name__, figures.__path__)


def _drawn(value: Any) -> Drawn:  # noqa: ANN401
    drawn, data = value
    if not isinstance(drawn, Figure) or not isinstance(data, pd.DataFrame):
        raise TypeError
    return drawn, data


A_FIGURE = Argument(
    "a Matplotlib figure and the table of its data",
    _drawn,
    "Correct the figure; docs/extensions.md has an example.",
)
A_TABLE = one_of(pd.DataFrame, words="a pandas.DataFrame", change="Return the table.")


@checked(make=A_FUNCTION)
def figure(make: Make) -> Make:
    """Register a function that returns a Matplotlib figure and the table of its data.

    Its name is that of the figure and its files, its parameters are properties of `Study`, and its new
    attribute ``publish`` saves the figure. It draws in the style of the project. The source of the data is
    noted below its figure, unless it takes the ``source`` itself or has written another note there.
    """
    own = inspect.signature(make)
    parameters = list(own.parameters.values())
    if "source" not in own.parameters:
        noted = inspect.Parameter("source", inspect.Parameter.POSITIONAL_OR_KEYWORD, default=None)
        parameters.insert(sum(each.default is each.empty for each in parameters), noted)
    signature = own.replace(parameters=parameters)

    def draw(*given: Any, **named: Any) -> Any:  # noqa: ANN401
        bound = signature.bind(*given, **named).arguments
        source = None if "source" in own.parameters else bound.pop("source", None)
        with paper_style():
            made = make(**bound)
            drawn = made[0] if isinstance(made, tuple) and made else None
            if source is not None and isinstance(drawn, Figure) and not drawn.get_supxlabel():
                note_source(drawn, source)
        return made

    def publish(study: Study, made: Drawn, arguments: Mapping[str, Any]) -> ShownFigure:
        (drawn, data), name = made, make.__name__
        title = title_of(name, {**arguments, "data": data, "study": study})
        save_figure(drawn, data, study.figures, name, figure_metadata(name, study.name, title))
        study.used.figures.append(name)
        return ShownFigure(data, study.figures / f"{name}.png", title, caption_of(study, name, make))

    styled: Any = wraps(make)(draw)
    styled.__signature__, styled.publish, styled.returns = signature, publish, A_FIGURE
    return FIGURES.add(make.__name__)(styled)


def title_of(name: str, names: Mapping[str, Any]) -> str:
    """Return the finding of a figure in at most twelve words, as its template in `TITLES` states it.

    The template may use the arguments of the figure by their names, its ``data``, and the ``study``. The
    title is empty if there is no template, or a number in it is not known.
    """
    template = yaml.safe_load(TITLES.read_text(encoding="utf-8")).get(name, "")
    try:
        title = fill(template, names).strip()
    except StudyError as error:
        # The data of a figure that shows nothing have no columns.
        if isinstance(error.__cause__, UNKNOWN | UndefinedVariableError):
            return ""
        raise
    return "" if {"–", "∞"} & set(title) else title


def caption_of(study: Study, name: str, make: Callable[..., Any]) -> list[str]:
    """Return the paragraphs of the caption of a figure or table as Markdown.

    Those of the user have the docstring of their function.
    """
    is_own = not (CAPTIONS / f"{name}.rst").is_file()
    caption = (inspect.getdoc(make) or name).split("\n\n") if is_own else study.caption(CAPTIONS, name)
    return [paragraph.replace("*", r"\*") for paragraph in caption]


def heading(name: str, title: str) -> str:
    """Return the number of a figure and its title as Markdown; one of the user has its name as number."""
    number = re.match(r"fig(\d+)_", name)
    return f"**{f'Figure {int(number[1])}' if number else name}.{title and f' {title}.'}**"


def alternative(title: str, caption: Sequence[str]) -> str:
    """Return the text that stands for a figure if it cannot be seen: its title, and its first sentence."""
    sentence = re.split(r"(?<=\.) ", " ".join(caption[0].split()), maxsplit=1)[0]
    return re.sub(r"[\\`]", "", f"{title and f'{title}. '}{sentence}")


def results_of(name: str) -> list[str]:
    """Return the paths, inside the folder of the results of a study, of the results that a figure may read.

    InputError is raised if a parameter of its function is not the name of a result.
    """
    reads = dict.fromkeys(ALWAYS)
    for parameter in inspect.signature(FIGURES[name]).parameters:
        if parameter in FILES:
            reads[FILES[parameter]] = None
        elif not hasattr(Study, parameter):
            raise InputError(
                f"figure {name}, parameter {parameter}",
                seen="no such result",
                expected="a result of a study, such as answer or encounters, or a value such as source",
                change="Rename the parameter. INTERFACE.yaml lists the results.",
            )
    return [*reads]


def table(
    name: str,
    *,
    digits: int | None = None,
    digest: Callable[[pd.DataFrame], pd.DataFrame] | None = None,
) -> Callable[[Make], Make]:
    """Return a decorator that registers a function which returns a table.

    In Markdown, LaTeX and notebooks, the table has ``digits`` significant digits, by default all, and may be
    the shorter one that ``digest`` returns.
    """

    def register(make: Make) -> Make:
        def publish(study: Study, made: pd.DataFrame, _: Mapping[str, Any]) -> ShownTable:
            shown = made if digest is None else digest(made)
            folder = study.figures / "tables"
            save_table(made.assign(data=study.source), folder, name, digits=digits, digest=shown)
            study.used.tables.append(name)
            caption = " ".join(caption_of(study, name, make)[0].split())
            rounded = shown if digits is None else shown.map(readable, digits=digits)
            return ShownTable(name, made, rounded, caption)

        make.publish, make.returns = publish, A_TABLE
        return make

    return register


def result_table(
    name: str,
    *,
    result: str | None = None,
    digits: int | None = None,
    digest: Callable[[pd.DataFrame], pd.DataFrame] | None = None,
) -> Callable[..., pd.DataFrame]:
    """Register a table of results that is published without changes, as by `table`.

    ``result`` is the name of the result in `Study`, if it is not that of the files.
    """

    def make(**results: pd.DataFrame) -> pd.DataFrame:
        return results[result or name]

    parameter = inspect.Parameter(result or name, inspect.Parameter.KEYWORD_ONLY)
    make.__signature__ = inspect.Signature([parameter])
    return table(name, digits=digits, digest=digest)(make)


@dataclass(frozen=True)
class ShownFigure:
    """A published figure, which a notebook displays."""

    data: pd.DataFrame = field(repr=False)  # the data that are drawn
    png: Path  # path of the published image
    title: str  # the finding; empty if there is none
    caption: Sequence[str]  # its paragraphs

    def _ipython_display_(self) -> None:
        """Display an anchor with number and title, the published image, and the caption.

        The book identifies the figure by the name in the metadata of the image, and shows its own caption in
        place of the texts. The file is read because drawing the figure again would take time.
        """
        from IPython.display import Image, Markdown, display  # slow to import, and only notebooks need it

        name, alt = self.png.stem, alternative(self.title, self.caption)
        above = f'<a id="{name}"></a>\n\n{heading(name, self.title)}'
        display(Markdown(above), metadata={"of": name})
        display(Image(self.png, width=WIDTH, alt=alt), metadata={"image/png": {"published": name}})
        display(Markdown("\n\n".join(self.caption)), metadata={"of": name})


@dataclass(frozen=True)
class ShownTable:
    """A published table, of which a notebook displays a shorter version."""

    name: str  # of its files
    data: pd.DataFrame  # the whole table
    digest: pd.DataFrame  # the table that is displayed
    caption: str

    def _repr_html_(self) -> str:
        caption = re.sub("`+([^`]+)`+", r"<code>\1</code>", escape(self.caption))
        whole = f'The whole table: <a href="../tables/{self.name}.csv">{self.name}.csv</a>.'
        return f"{as_html(self.digest, whole)}<p>{caption}</p>"

    def __repr__(self) -> str:
        return repr(self.digest)


Shown = ShownFigure | ShownTable


def arguments_of(study: Study, make: Callable[..., Any], given: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return the arguments of a registered function by name; None if the study lacks a result that it needs.

    The parameters are read from the study, except for those that are given. One with a default value is an
    optional result, which is read if the study has it.
    """
    wanted = {
        name: parameter.default is parameter.empty
        for name, parameter in inspect.signature(make).parameters.items()
        if name not in given
    }
    if not study.has(*(name for name, is_needed in wanted.items() if is_needed)):
        return None
    had = {name: getattr(study, name) for name, is_needed in wanted.items() if is_needed or study.has(name)}
    return had | given


def show(study: Study, make: Callable[..., Any], **given: Any) -> Shown | None:  # noqa: ANN401
    """Make a registered figure or table of a study, publish it, and return an object for the notebook.

    Nothing is made, and None is returned, if the study lacks a result that the function needs.
    """
    arguments = arguments_of(study, make, given)
    if arguments is None:
        return None
    kind = "figure" if make.returns is A_FIGURE else "table"
    made = call(make, where=f"{kind} {make.__name__}", returns=make.returns, **arguments)
    return make.publish(study, made, arguments)
