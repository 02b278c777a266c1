"""Differences between two finished studies: in their settings, and in the cells of their published tables."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import takewhile
from typing import Any

import numpy as np
import pandas as pd
from pandas.api.types import is_numeric_dtype

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.publishing.study import Study, read_result

NAMES = ["study", "data"]  # columns of published tables that only name the study
ENDS = (("low80", "high80"), ("low", "high"))  # columns with the ends of the interval of the numbers in a row


def changed_settings(first: Study, second: Study) -> pd.DataFrame:
    """Return the keys of the configuration with different values: ``key`` and the values of both studies."""
    values = [pd.Series(dict(_flat(study.config)), dtype=object).drop("study") for study in (first, second)]
    return _changed(values, (first, second)).rename_axis("key").reset_index()


def changed_cells(first: Study, second: Study) -> pd.DataFrame:
    """Return the cells that differ in the tables that both studies have published.

    Rows are matched by their leading columns of text, such as the method or the event, and by their order if
    several rows have the same text. A cell that only one of the studies has is missing in the other.
    ``ratio`` is that of the second to the first if both are numbers. ``half_widths`` is the difference of
    their logarithms, divided by half the width of the wider interval of their rows, if they have intervals.
    InputError is raised if the studies have no published table of the same name in the working folder.
    """
    tables = [_published(study) for study in (first, second)]
    common = sorted(tables[0].keys() & tables[1].keys())
    if not common:
        raise InputError(
            f"the tables in {first.figures} and {second.figures}",
            seen="no table of the same name",
            expected="published tables of two finished studies of one scenario",
            change="Correct the names of the studies, or run them in this folder first.",
        )
    parts = {}
    for name in common:
        cells = _cells(*(each[name] for each in tables))
        changed = _changed(cells, (first, second))
        widths = np.fmax(*(_half_widths(own, changed.index.get_level_values(0)) for own in cells))
        parts[name] = changed.assign(half_widths=widths)
    changed = pd.concat(parts, names=["table", "row", "column"]).reset_index()
    one, other = (pd.to_numeric(changed[_header(study)], errors="coerce") for study in (first, second))
    ratio = other / one.replace(0, np.nan)
    distance = np.log(ratio.where(ratio > 0)).abs()
    return changed.assign(ratio=ratio, half_widths=distance / changed["half_widths"])


def _half_widths(cells: pd.Series, rows: pd.Index) -> Array:
    """Return half the width of the logarithm of the interval in each of some rows; NaN without one."""
    widths = np.full(len(rows), np.nan)
    columns = cells.index.get_level_values("column")
    for names in ENDS:
        if set(names) <= set(columns):
            low, high = (
                pd.to_numeric(cells[columns == name].droplevel("column"), errors="coerce").reindex(rows)
                for name in names
            )
            found = np.log((high / low).where((low > 0) & (high > low))).to_numpy() / 2
            widths = np.where(np.isnan(widths), found, widths)
    return widths


def _header(study: Study) -> str:
    return f"in {study.results.name}"


def _flat(section: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the dotted name and the value of every key that has no keys below it."""
    for key, value in section.items():
        if isinstance(value, Mapping) and value:
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value


def _published(study: Study) -> dict[str, pd.DataFrame]:
    return {path.stem: read_result(path) for path in (study.figures / "tables").glob("*.csv")}


def _cells(*tables: pd.DataFrame) -> list[pd.Series]:
    """Return the cells of each table by row and column; leading texts of the first table name the rows."""
    plain = [table.drop(columns=NAMES, errors="ignore") for table in tables]
    first = plain[0]
    texts = list(takewhile(lambda name: not is_numeric_dtype(first[name]), first.columns))
    return [_by_row(table, texts or [first.columns[0]]) for table in plain]


def _by_row(table: pd.DataFrame, texts: Sequence[str]) -> pd.Series:
    words = table.reindex(columns=texts).fillna("").astype(str).to_numpy()
    row = pd.Series(map(", ".join, words), dtype=str)
    repeated = row.groupby(row).cumcount() + 1
    row = row.where(repeated == 1, row + " (" + repeated.astype(str) + ")")
    rest = table.drop(columns=texts, errors="ignore").astype(object).set_axis(row)
    return rest.melt(var_name="column", ignore_index=False).set_index("column", append=True)["value"]


def _changed(values: Sequence[pd.Series], studies: Sequence[Study]) -> pd.DataFrame:
    """Return the values that differ; numbers that agree to nine digits do not differ."""
    both = pd.concat(values, axis=1, keys=map(_header, studies))
    return both[np.array([not _equal(*pair) for pair in both.to_numpy()], dtype=bool)]


def _equal(one: object, other: object) -> bool:
    if isinstance(one, int | float) and isinstance(other, int | float):
        return bool(np.isclose(one, other, rtol=1e-9, atol=0, equal_nan=True))
    return one == other
