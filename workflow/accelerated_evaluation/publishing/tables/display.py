"""Tables as readers see them: headers in words, no index, no column of one value, long tables folded."""

import re
import sys
from html import escape
from typing import Any

import numpy as np
import pandas as pd

from accelerated_evaluation.publishing.names import in_words

LONG = 15  # largest number of rows that are not folded
SHOWN = 8  # number of rows of a longer table that stay visible
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
    words = {name: in_words(table[name]) for name in VEHICLE_COLUMNS if name in table}
    words |= {name: table[name].map(_quantity) for name in CODED_COLUMNS if name in table}
    table = table.assign(**words)
    return table.map(_in_word).rename(columns=header)


def as_html(table: pd.DataFrame) -> str:
    """Return a table as HTML for a notebook.

    A column that repeats one value becomes a line above the table. Of a table with more than `LONG` rows, the
    first `SHOWN` are visible, and a click unfolds the others.
    """
    shown = presented(table)
    repeated = _repeated(shown)
    line = "; ".join(f"{name}: {shown[name].iloc[0]}" for name in repeated)
    shown = shown.drop(columns=repeated)
    above = f"<p>In all rows, {escape(line)}.</p>" if line else ""
    if len(shown) <= LONG:
        return above + _html(shown)
    rest = _html(shown.iloc[SHOWN:])
    folded = f"<details><summary>{len(shown) - SHOWN} more rows</summary>{rest}</details>"
    return above + _html(shown.iloc[:SHOWN]) + folded


def display_in_notebooks() -> None:
    """Let a notebook, if this is one, display every table as `as_html` writes it."""
    shell = sys.modules["IPython"].get_ipython() if "IPython" in sys.modules else None
    if shell is not None:
        shell.display_formatter.formatters["text/html"].for_type(pd.DataFrame, as_html)


def _repeated(shown: pd.DataFrame) -> list[str]:
    """Return the names of the columns with one value in at least three rows, if any other column is left."""
    if len(shown) < 3 or isinstance(shown.columns, pd.MultiIndex) or shown.columns.has_duplicates:
        return []
    texts = shown.map(str)
    same = (texts == texts.iloc[0]).all()
    return [] if same.all() else [name for name in shown if same[name]]


def _html(shown: pd.DataFrame) -> str:
    with pd.option_context("display.max_colwidth", None):
        html = shown.to_html(index=False, border=0, na_rep="–", escape=True)
    return html.replace(" × 10", "\N{NO-BREAK SPACE}×\N{NO-BREAK SPACE}10")


def _quantity(value: Any) -> Any:  # noqa: ANN401
    """Write the code of a quantity, model or method in words; what is no text stays as it is."""
    return QUANTITIES.get(value, value.replace("_", " ")) if isinstance(value, str) else value


def _in_word(value: Any) -> Any:  # noqa: ANN401
    """Write a truth value as a word; any other value stays as it is."""
    return ("yes" if value else "no") if isinstance(value, bool | np.bool_) else value
