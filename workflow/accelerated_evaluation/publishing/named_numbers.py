"""The named numbers of a study: each with its unit, its kind, such as a mean or a median, and its subject.

``workflow/numbers.yaml`` says how each number follows from published tables. A study publishes them as
``numbers.csv``; texts use them as ``n.NAME`` (`publishing.texts`).
"""

import math
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import yaml
from scipy.special import betaincinv
from scipy.stats import poisson

from accelerated_evaluation.base.errors import InputError, StudyError
from accelerated_evaluation.methods.importance_sampling import crude_simulations
from accelerated_evaluation.publishing.study import Study
from accelerated_evaluation.publishing.tables.claims import UNTESTED
from accelerated_evaluation.publishing.tables.display import reproducible_value
from accelerated_evaluation.publishing.tables.exact import share_of_one_run
from accelerated_evaluation.publishing.tables.paper_claims import NUMBERS
from accelerated_evaluation.publishing.texts import UNKNOWN, evaluate_expression

COLUMNS = ["name", "value", "unit", "kind", "subject"]
# Tables that have rows in every study. The others may have none if the vehicle never crashes.
NEVER_EMPTY = (
    "answer",
    "claims",
    "encounters_account",
    "exact",
    "laws",
    "records_report",
    "sensitivity",
    "vehicles",
)
PUBLIC = ["nais", "nais_25", "cross_entropy", "subset", "form", "enkf"]  # methods of public tools


class Tables:
    """Published tables in a folder, as items and attributes; each is read when it is used."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __getitem__(self, name: str) -> pd.DataFrame:
        """Return a table by its name, without its column ``data``; InputError if it does not exist."""
        path = self.folder / f"{name}.csv"
        if not path.is_file():
            raise InputError(
                str(path),
                seen="no such file",
                expected="a published table of a finished study",
                change="Run the study first: make study.",
            )
        return pd.read_csv(path).drop(columns="data", errors="ignore")


def named_numbers(definitions: Path, study: Study, results: Tables) -> pd.DataFrame:
    """Return the named numbers of a study, with the columns `COLUMNS`; values are texts, empty if unknown.

    A number is unknown if a table lacks its row, as in a study whose vehicle never crashes. ``results`` are
    the tables of the benchmarks. InputError is raised if a table is missing, or one in `NEVER_EMPTY` has no
    row.
    """
    tables = Tables(study.figures / "tables")
    for name in NEVER_EMPTY:
        if tables[name].empty:
            raise InputError(
                f"{tables.folder / name}.csv",
                seen="a table without rows",
                expected="a complete table of a finished study",
                change="Delete the table, and run the study again: make study.",
            )
    known = FUNCTIONS | {"tables": tables, "results": results, "study": study}
    rows = []
    for subject, content in yaml.safe_load(definitions.read_text(encoding="utf-8")).items():
        names = dict(known)
        for name, expression in content.pop("let", {}).items():
            names[name] = _value(expression, names)
        for name, (kind, unit, expression) in content.items():
            value = _value(expression, names)
            known[name] = names[name] = np.float64(math.nan if value is None else value)
            rows.append((name, _published(known[name]), unit, kind, subject))
    return pd.DataFrame(rows, columns=COLUMNS)


def _value(expression: str, names: Mapping[str, Any]) -> Any:  # noqa: ANN401
    """Return the value of an expression; None if it divides by zero, or needs a row that a table lacks."""
    try:
        return evaluate_expression(expression, names)
    except StudyError as error:
        if isinstance(error.__cause__, UNKNOWN):
            return None
        raise


def _published(value: float) -> str:
    """Write a number for a CSV file: a count without decimals, and an unknown value as an empty cell."""
    if not math.isfinite(value):
        return ""
    return str(int(value)) if value.is_integer() else str(reproducible_value(float(value)))


def as_names(numbers: pd.DataFrame) -> SimpleNamespace:
    """Return the values of named numbers as attributes; an unknown value is NaN."""
    return SimpleNamespace(**dict(zip(numbers["name"], pd.to_numeric(numbers["value"]), strict=True)))


def read_numbers(figures: Path) -> SimpleNamespace:
    """Return the published numbers of a study as attributes; InputError is raised if there are none."""
    return as_names(Tables(figures)["numbers"])


def row(table: pd.DataFrame, **values: str) -> pd.Series:
    """Return the first row of a table that has the given values."""
    for column, value in values.items():
        table = table[table[column] == value]
    return table.iloc[0]


def upper_share(found: int, tried: int) -> float:
    """Return the upper 95 % limit of a probability, from the number of trials in which it happened."""
    return float(betaincinv(found + 1, tried - found, 0.95))


FUNCTIONS = {
    "crude_simulations": crude_simulations,
    "exp": math.exp,
    "log": math.log,
    "numbers_of_paper": list(NUMBERS),
    "poisson_quantile": poisson.ppf,
    "public_tools": PUBLIC,
    "row": row,
    "share_of_one_run": share_of_one_run,
    "untested": UNTESTED,
    "upper_share": upper_share,
}
