"""Tables as CSV, Markdown and LaTeX."""

import math
import numbers
import os
import re
from pathlib import Path
from typing import Any

import pandas as pd

from accelerated_evaluation.base.files import write_csv, write_text
from accelerated_evaluation.publishing.tables.display import presented

# Significant digits in published CSV files; files of results have all digits. The ninth and later digits
# depend on the processor, because the order of sums does. After rounding to six digits this is visible only
# in the rare case that a number lies almost in the middle between two rounded values. The error of every
# published estimate is larger than the sixth digit.
DIGITS = 6
LARGEST_COUNT = 2**53
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
# Characters that are escaped, only where they have a meaning in Markdown: tags, entities, links, emphasis,
# cells and formulas.
_MARKDOWN = re.compile(r"[|$`*\\]|<(?=[A-Za-z/!?])|&(?=[#A-Za-z])|\](?=[(\[])|(?<!\w)_|_(?!\w)")
_PLAIN = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")


def save_table(
    table: pd.DataFrame,
    folder: str | os.PathLike,
    name: str,
    *,
    digits: int | None = None,
    digest: pd.DataFrame | None = None,
) -> pd.DataFrame:
    """Save a table as CSV, Markdown and LaTeX: ``folder/name`` with the endings csv, md and tex.

    Numbers in the CSV file always have `DIGITS` significant digits. Markdown and LaTeX have ``digits``, by
    default all, and the shorter table ``digest``, if there is one, with headers in words.
    """
    shown = table if digest is None else digest
    shown = presented(shown if digits is None else shown.map(lambda value: readable(value, digits)))
    write_csv(Path(folder) / f"{name}.csv", reproducible(table))
    write_text(Path(folder) / f"{name}.md", to_markdown(shown) + "\n")
    write_text(Path(folder) / f"{name}.tex", as_latex(shown.to_latex(index=False, escape=True)))
    return table


def to_markdown(table: pd.DataFrame) -> str:
    """Return a table as Markdown, with the special characters of texts escaped."""
    return table.map(as_markdown).to_markdown(index=False, disable_numparse=True)


def reproducible(table: pd.DataFrame) -> pd.DataFrame:
    """Round floats to `DIGITS` significant digits, which do not depend on the processor.

    Counts are not rounded. A column of counts with missing values contains floats, so a float without a
    fractional part is treated as a count. Above `LARGEST_COUNT`, floats cannot represent every whole number,
    so larger values are not treated as counts.
    """
    columns = {
        name: column.map(reproducible_value) for name, column in table.items() if column.dtype.kind in "fO"
    }
    return table.assign(**columns)


def reproducible_value(value: Any, digits: int = DIGITS) -> Any:  # noqa: ANN401
    """Round a float to the given number of significant digits.

    Counts and values of other types are returned unchanged. A float without a fractional part is treated as a
    count, as in `reproducible`.
    """
    is_count = isinstance(value, float) and value.is_integer() and abs(value) < LARGEST_COUNT
    return value if is_count or not isinstance(value, float) else float(f"{value:.{digits}g}")


def as_markdown(text: Any) -> Any:  # noqa: ANN401
    """Escape characters with a meaning in Markdown, HTML or MathJax.

    Values other than text are not changed.
    """
    if not isinstance(text, str):
        return text
    escaped = _MARKDOWN.sub(lambda found: f"&#{ord(found[0])};", text)
    # MathJax searches the page for formulas between dollar signs, but only within one element.
    return escaped.replace("&#36;", "<span>&#36;</span>")


def readable(value: Any, digits: int = 3) -> Any:  # noqa: ANN401
    """Write a number for a text, such as 7,840, 1.57 or 7.4 × 10⁻⁷; NaN is written as a dash.

    Whole numbers below a million are written with all digits, others with so many significant ones. Values of
    other types are returned without change.
    """
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        return value
    size = abs(float(value))
    if not math.isfinite(size):
        return "–" if math.isnan(size) else "∞"
    if size == 0 or 1e-3 <= size < 1e6:
        whole = size == int(size)
        decimals = 0 if whole else max(digits - 1 - math.floor(math.log10(size)), 0)
        return f"{value:,.{decimals}f}"
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    return f"{mantissa.rstrip('0').rstrip('.')} × 10{str(int(exponent)).translate(_SUPERSCRIPT)}"


def as_latex(text: str) -> str:
    """Replace the characters of numbers that LaTeX's plain fonts lack; other text is not changed."""
    text = re.sub("[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+", lambda found: f"$^{{{found[0].translate(_PLAIN)}}}$", text)
    return text.replace("×", r"$\times$").replace("–", "--").replace("∞", r"$\infty$")
