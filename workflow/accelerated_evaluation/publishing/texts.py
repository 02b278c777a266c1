"""Texts with placeholders for numbers: of notebooks, README, guides, benchmarks, captions and the article.

There is one language of placeholders, that of Jinja, with a filter for each notation of a number. `fill`
fills it in. `publishing.pages` fills the pages of the project.
"""

import json
import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from jinja2 import Environment, StrictUndefined, Undefined, UndefinedError
from markupsafe import Markup

from accelerated_evaluation.base.errors import StudyError
from accelerated_evaluation.base.percent import in_percent
from accelerated_evaluation.publishing.tables.display import as_markdown, readable, shell_of_notebook

# Causes of a StudyError if a number is not known: a table lacks its row, or it is a ratio to zero.
UNKNOWN = LookupError | ArithmeticError | UndefinedError


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


def count_in_words(count: float) -> str:
    """Write a count in a sentence: none, one or a number."""
    return {0: "none", 1: "one"}.get(count) or number(count)


def rounded(value: float, digits: int = 2) -> float:
    """Round a number to so many significant digits."""
    return float(f"{value:.{digits}g}")


def unbroken(value: Any, digits: int = 3) -> Any:  # noqa: ANN401
    """Write a number as `readable` does, with non-breaking spaces, so that it stays on one line."""
    written = readable(value, digits)
    return written.replace(" ", "\N{NO-BREAK SPACE}") if isinstance(written, str) else written


def interval_in_words(low: float, high: float, digits: int = 2) -> str:
    """Write an interval, such as 1.3 × 10⁻⁶ to 6.4 × 10⁻⁶; equal ends get more digits until they differ."""
    if low == high or not (math.isfinite(low) or math.isfinite(high)):
        return unbroken(low, digits)
    ends = [unbroken(end, digits) for end in (low, high)]
    return (
        interval_in_words(low, high, digits + 1) if ends[0] == ends[1] and digits < 6 else " to ".join(ends)
    )


def list_in_words(names: Iterable[str]) -> str:
    """Write names as a list in a sentence, such as "a, b and c", or "none"."""
    *others, last = [*names] or ["none"]
    return f"{', '.join(others)} and {last}" if others else last


def typeset(text: str) -> str:
    """Return a text with ``^-1`` replaced by a superscript: R⁻¹ in place of R^-1."""
    return text.replace("^-1", "⁻¹")


def quoted(text: str) -> Markup:
    """Return a text as a string in the language of Typst."""
    return Markup(json.dumps(text, ensure_ascii=False))


def fill(text: str, names: Mapping[str, Any]) -> str:
    """Return a Markdown text with its placeholders of Jinja filled in; a ratio to zero is unknown.

    StudyError is raised if a placeholder uses an unknown name, or its expression fails.
    """
    try:
        with np.errstate(all="ignore"):
            return _ENVIRONMENT.from_string(text).render(names)
    except Exception as error:
        # The message of a KeyError is only the key, so the type of the error is written too.
        raise StudyError(f"{type(error).__name__}: {error}") from error


def evaluate_expression(expression: str, names: Mapping[str, Any]) -> Any:  # noqa: ANN401
    """Return the value of an expression in the language of the placeholders, or raise StudyError."""
    try:
        with np.errstate(all="ignore"):
            value = _ENVIRONMENT.compile_expression(expression, undefined_to_none=False)(**names)
        if isinstance(value, Undefined):
            str(value)  # raises the error that says what is undefined
    except StudyError:
        raise
    except Exception as error:
        raise StudyError(f"{expression}: {type(error).__name__}: {error}") from error
    return value


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
_ENVIRONMENT.filters |= {
    "counted": count_in_words,
    "number": number,
    "of_draws": of_draws,
    "percent": percent,
    "quoted": quoted,
    "readable": unbroken,
    "rounded": rounded,
    "typeset": typeset,
}
_ENVIRONMENT.globals |= {"interval": interval_in_words, "listed": list_in_words}
