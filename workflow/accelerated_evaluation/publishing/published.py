"""Registration of figures and tables: a decorator registers each, and one call in a notebook publishes it.

A new figure needs a function in `publishing.figures`, a call in a notebook, and a caption::

    @figure
    def fig25_example(estimates: pd.DataFrame, alpha: float, source: str) -> tuple[Figure, pd.DataFrame]:
        ...

    show(study, fig25_example)      # in the notebook

The name of the function is the name of its files and of its caption, ``workflow/report/fig25_example.rst``.
The names of its parameters are those of the properties of `Study` that it uses. The metadata of the notebook
list the figure, and the results that it reads (`publishing.book.catalogue`).
"""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import pandas as pd
from matplotlib.figure import Figure

from accelerated_evaluation.base.arguments import A_FUNCTION, Argument, one_of
from accelerated_evaluation.base.checking import checked
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.registry import Registry
from accelerated_evaluation.base.users_code import call
from accelerated_evaluation.publishing import figures
from accelerated_evaluation.publishing.figures.style import COLUMN_WIDTH, save_figure
from accelerated_evaluation.publishing.provenance import figure_metadata
from accelerated_evaluation.publishing.study import FILES, Study
from accelerated_evaluation.publishing.tables.display import as_html, readable, save_table

Make = TypeVar("Make", bound=Callable[..., Any])
WIDTH = 150 * COLUMN_WIDTH  # [px], width of a figure in a notebook
# Results that every study has.
ALWAYS = ("config.json", "contents.json", "encounters.parquet", "records_report.csv")
# Functions that make figures, by the names of the figures.
FIGURES: Registry[Callable[..., Any]] = Registry("figure", figures.__name__, figures.__path__)


def _drawn(value: Any) -> tuple[Figure, pd.DataFrame]:  # noqa: ANN401
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
    attribute ``publish`` saves the figure.
    """

    def publish(study: Study, made: tuple[Figure, pd.DataFrame]) -> ShownFigure:
        drawn, data = made
        metadata = figure_metadata(make.__name__, study.name)
        save_figure(drawn, data, study.figures, make.__name__, metadata)
        study.used.figures.append(make.__name__)
        return ShownFigure(data, study.figures / f"{make.__name__}.png")

    make.publish, make.returns = publish, A_FIGURE
    return FIGURES.add(make.__name__)(make)


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
        def publish(study: Study, made: pd.DataFrame) -> ShownTable:
            shown = made if digest is None else digest(made)
            folder = study.figures / "tables"
            save_table(made.assign(data=study.source), folder, name, digits=digits, digest=shown)
            study.used.tables.append(name)
            return ShownTable(made, shown if digits is None else shown.map(readable, digits=digits))

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

    def _repr_png_(self) -> tuple[bytes, dict[str, float | str]]:
        """Return the published image and its metadata; the book identifies the figure by the name in these.

        The file is read because drawing the figure again would take time.
        """
        return self.png.read_bytes(), {"width": WIDTH, "published": self.png.stem}


@dataclass(frozen=True)
class ShownTable:
    """A published table, of which a notebook displays a shorter version."""

    data: pd.DataFrame  # the whole table
    digest: pd.DataFrame  # the table that is displayed

    def _repr_html_(self) -> str:
        return as_html(self.digest)

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
    return make.publish(study, made)
