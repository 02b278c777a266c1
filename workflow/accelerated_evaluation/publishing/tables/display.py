"""Tables as CSV, Markdown, LaTeX and HTML: headers in words, and long tables folded."""

import math
import numbers
import os
import re
import sys
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from accelerated_evaluation.base.files import write_csv, write_text

# Significant digits in published CSV files; files of results have all digits. The ninth and later digits
# depend on the processor, because the order of sums does. After rounding to six digits this is visible only
# in the rare case that a number lies almost in the middle between two rounded values. The error of every
# published estimate is larger than the sixth digit.
DIGITS = 6
LARGEST_COUNT = 2**53
EXACT = 12  # significant digits that are the same on any processor, but for ties
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
# Characters that are escaped, only where they have a meaning in Markdown: tags, entities, links, emphasis,
# cells and formulas.
_MARKDOWN = re.compile(r"[|$`*\\]|<(?=[A-Za-z/!?])|&(?=[#A-Za-z])|\](?=[(\[])|(?<!\w)_|_(?!\w)")
_PLAIN = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
NAMES = {
    "under test": "car under test",
    "acc_aeb": "car with ACC and emergency braking",
    "acc_only": "car with ACC alone",
    "cc_human": "careful human (UN R157)",
    "reg157": "braking model of UN R157",
    "rss": "RSS driver",
    "fsm": "FSM driver",
    "human": "random human driver",
}
LONG = 15  # largest number of rows that are all shown
SHOWN = 8  # number of rows of a longer table that are shown
# Headers that are not the name of the column with spaces. The article and the CSV files keep the names.
HEADERS = {
    "aic": "AIC",
    "aic_above_best": "AIC above the best",
    "behind": "behind the best [standard errors]",
    "bic": "BIC",
    "change_inverse_range": "relative change of the tilt of R⁻¹",
    "change_inverse_ttc": "relative change of the tilt of TTC⁻¹",
    "ci_high": "upper limit",
    "ci_low": "lower limit",
    "cov_reported": "coefficient of variation, reported",
    "cov_true": "coefficient of variation, true",
    "coverage80": "coverage of 80 %",
    "coverage95": "coverage of 95 %",
    "dispersion_15000": "dispersion, blocks of 15,000",
    "contains": "the intervals contain",
    "dispersion_5000": "dispersion, blocks of 5,000",
    "gain_inverse_ttc_0.25": "gain [nats], TTC⁻¹ > 0.25/s",
    "gain_inverse_ttc_0.35": "gain [nats], TTC⁻¹ > 0.35/s",
    "gain_inverse_ttc_0.45": "gain [nats], TTC⁻¹ > 0.45/s",
    "high": "upper limit",
    "in_hundred_car": "expected in the 100-Car study",
    "knot_shift_inverse_range_per_m": "shift of the knots of R⁻¹ [1/m]",
    "knot_shift_inverse_ttc_per_s": "shift of the knots of TTC⁻¹ [1/s]",
    "ks_distance": "KS distance",
    "looked_at": "examined",
    "low": "lower limit",
    "n": "number",
    "n_parameters": "number of parameters",
    "p_value": "p value",
    "per_km": "per km",
    "refused": "rejected",
    "threshold_range_m": "threshold of the range [m]",
    "threshold_ttc_s": "threshold of TTC [s]",
    "to_crash": "ratio to crashes",
    "within": "within the limits",
    "to_exact": "ratio to exact",
    "to_exact_sd": "its standard deviation",
    "who": "vehicle or study",
}
# Endings of names that belong to the word before them.
ENDINGS = {
    r"^(?:low|high)(\d+)$": lambda found: f"{found[1]} %, {'from' if found[0][0] == 'l' else 'to'}",
    r"_low$": ", from",
    r"_high$": ", to",
    r"_min$": ", smallest",
    r"_max$": ", largest",
    r"_mean$": ", mean",
}
# Columns whose values are codes: of vehicles, and of quantities, models and methods.
CODED_COLUMNS = ("variable", "model", "method")
QUANTITIES = {"inverse_range": "R⁻¹", "inverse_ttc": "TTC⁻¹"}
VEHICLE_COLUMNS = ("vehicle", "driver", "reference", "who")


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
    count, as in `reproducible`. The float is first rounded to `EXACT` digits: a ratio of counts may lie just
    in the middle between two rounded values, and its last digits must not decide between them.
    """
    if not isinstance(value, float):
        return value
    exact = float(f"{value:.{EXACT}g}")
    return exact if exact.is_integer() and abs(exact) < LARGEST_COUNT else float(f"{exact:.{digits}g}")


def as_markdown(text: Any) -> Any:  # noqa: ANN401
    """Escape characters with a meaning in Markdown, HTML or MathJax, and write ^-1 as a superscript.

    Values other than text are not changed.
    """
    if not isinstance(text, str):
        return text
    escaped = _MARKDOWN.sub(lambda found: f"&#{ord(found[0])};", text)
    # MathJax searches the page for formulas between dollar signs, but only within one element.
    return escaped.replace("&#36;", "<span>&#36;</span>").replace("^-1", "⁻¹")


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


def vehicles_in_words(vehicles: pd.Series) -> pd.Series:
    """Return the names of vehicles in words, shape (n,); a name that is not known here stays as it is."""
    return vehicles.replace(NAMES)


def header(name: Any) -> Any:  # noqa: ANN401
    """Return the header of a column in words; what is no text, such as a number, stays as it is."""
    if not isinstance(name, str):
        return name
    if name in HEADERS:
        return HEADERS[name]
    for ending, words in ENDINGS.items():
        name = re.sub(ending, words, name)
    return name.replace("_", " ")


def presented(table: pd.DataFrame) -> pd.DataFrame:
    """Return a table with headers and names of vehicles in words, and "yes" and "no" for truth values.

    An index with a name or with texts becomes a column, as it has a meaning; any other is dropped.
    """
    if table.index.nlevels > 1 or table.index.name is not None or table.index.dtype.kind not in "iu":
        # Headers without a name have to differ, so they are blanks.
        names = [" " * place if name is None else name for place, name in enumerate(table.index.names, 1)]
        table = table.rename_axis(index=names).reset_index()
    words = {name: vehicles_in_words(table[name]) for name in VEHICLE_COLUMNS if name in table}
    words |= {name: table[name].map(_quantity) for name in CODED_COLUMNS if name in table}
    table = table.assign(**words)
    return table.map(_in_word).rename(columns=header)


def as_html(table: pd.DataFrame, whole: str = "") -> str:
    """Return a table as HTML for a notebook.

    A column that repeats one value becomes a part of a sentence above the table. Of a table with more than
    `LONG` rows, the first `SHOWN` are shown; ``whole`` is HTML that says where the others are.
    """
    shown = presented(table)
    same = repeated(shown)
    *parts, last = [f"<em>{escape(name)}</em> is {escape(str(shown[name].iloc[0]))}" for name in same] or [""]
    above = f"<p>In every row, {', '.join(parts)}{' and ' if parts else ''}{last}.</p>" if last else ""
    shown = shown.drop(columns=same)
    if len(shown) <= LONG:
        return above + _html(shown)
    return f"{above}{_html(shown.iloc[:SHOWN])}<p>These are {SHOWN} of {len(shown)} rows. {whole}</p>"


def shell_of_notebook() -> Any:  # noqa: ANN401
    """Return the IPython shell in which this code runs; None if it does not run in a notebook."""
    return sys.modules["IPython"].get_ipython() if "IPython" in sys.modules else None


def display_in_notebooks() -> None:
    """Let a notebook, if this is one, display every table as `as_html` writes it."""
    if (shell := shell_of_notebook()) is not None:
        shell.display_formatter.formatters["text/html"].for_type(pd.DataFrame, as_html)


def repeated(shown: pd.DataFrame) -> list[str]:
    """Return the names of the columns with one value in at least three rows, if any other column is left."""
    if len(shown) < 3 or isinstance(shown.columns, pd.MultiIndex) or shown.columns.has_duplicates:
        return []
    texts = shown.map(str)
    same = (texts == texts.iloc[0]).all()
    return [] if same.all() else [name for name in shown if same[name]]


def _html(shown: pd.DataFrame) -> str:
    with pd.option_context("display.max_colwidth", None):
        html = shown.to_html(index=False, border=0, na_rep="–", escape=True)
    html = html.replace(" × 10", "\N{NO-BREAK SPACE}×\N{NO-BREAK SPACE}10")
    return html.replace("^-1", "⁻¹").replace(" +- ", " ± ")


def _quantity(value: Any) -> Any:  # noqa: ANN401
    """Write the code of a quantity, model or method in words; what is no text stays as it is."""
    return QUANTITIES.get(value, value.replace("_", " ")) if isinstance(value, str) else value


def _in_word(value: Any) -> Any:  # noqa: ANN401
    """Write a truth value as a word; any other value stays as it is."""
    return ("yes" if value else "no") if isinstance(value, bool | np.bool_) else value
