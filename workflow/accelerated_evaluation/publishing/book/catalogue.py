"""What each notebook reads and makes, from its metadata, and texts with placeholders for values.

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

A text with placeholders is a cell of code that begins with ``%%text``. It shows the text with the values that
the variables have at this place, whoever runs the notebook: a reader in Jupyter, papermill or the study.
"""

import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from accelerated_evaluation.base.errors import InputError, StudyError
from accelerated_evaluation.base.percent import in_percent
from accelerated_evaluation.publishing.tables.display import as_markdown, readable, shell_of_notebook


class Contents(NamedTuple):
    """The inputs and outputs of a notebook, or of a part of it."""

    figures: Sequence[str]  # names of the published figures
    tables: Sequence[str]  # names of the published tables
    reads: Sequence[str]  # paths of the results, relative to their folder


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


def number(value: float, decimals: int = 0, sign: str = "") -> str:
    """Write a number with a fixed number of decimals, such as 1,234.5.

    NaN is written as a dash, and infinity as ∞. A ``"+"`` as sign writes the sign of positive numbers too.
    """
    return f"{value:{sign},.{decimals}f}" if math.isfinite(value) else readable(float(value))


def percent(value: float, decimals: int = 0, sign: str = "") -> str:
    """Write a share as `in_percent` does; with the sign ``"+"`` a change, such as +12.3 %.

    The spaces are non-breaking ones.
    """
    if not math.isfinite(value):
        return readable(float(value))
    written = f"{number(100 * value, decimals, sign)} %" if sign else in_percent(value, decimals)
    return written.replace(" ", "\N{NO-BREAK SPACE}")


def of_draws(share: float) -> str:
    """Write in how many of the draws something is the case, such as "every draw" or "97 % of the draws"."""
    if share in (0, 1):
        return "every draw" if share else "no draw"
    return f"{percent(share)} of the draws"


def unbroken(value: Any, digits: int = 3) -> Any:  # noqa: ANN401
    """Write a number as `readable` does, with non-breaking spaces, so that it stays on one line."""
    written = readable(value, digits)
    return written.replace(" ", "\N{NO-BREAK SPACE}") if isinstance(written, str) else written


def fill(text: str, names: Mapping[str, Any]) -> str:
    """Return a Markdown text with its placeholders of Jinja filled in.

    StudyError is raised if a placeholder uses an unknown name, or its expression fails.
    """
    try:
        return _ENVIRONMENT.from_string(text).render(names)
    except Exception as error:
        # The message of a KeyError is only the key, so the type of the error is written too.
        raise StudyError(f"{type(error).__name__}: {error}") from error


def fill_in_notebooks() -> None:
    """Let a notebook, if this is one, show cells that begin with ``%%text`` as Markdown, by `fill`."""
    if (shell := shell_of_notebook()) is None:
        return
    from IPython.display import Markdown, display  # slow to import, and only notebooks need it

    def text(_: str, cell: str) -> None:
        """Show Markdown with placeholders for values of variables."""
        display(Markdown(fill(cell, shell.user_ns).rstrip("\n")))

    shell.register_magic_function(text, "cell")


def _escaped(value: Any) -> Any:  # noqa: ANN401
    """Escape a string, unless the filter ``safe`` has marked it."""
    return value if isinstance(value, Markup) else as_markdown(value)


_ENVIRONMENT = Environment(
    undefined=StrictUndefined, finalize=_escaped, trim_blocks=True, lstrip_blocks=True, autoescape=False
)
_ENVIRONMENT.filters |= {"number": number, "percent": percent, "of_draws": of_draws, "readable": unbroken}
