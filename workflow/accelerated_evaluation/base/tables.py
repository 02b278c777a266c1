"""Read tables from files; a table that cannot be read causes one clear error."""

import csv
import gzip
import os
import re
import zlib
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from difflib import get_close_matches
from types import MappingProxyType

import numpy as np
import pandas as pd

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import atomic_path, begins_in, is_number

CLUSTER = "cluster"  # column of records that names the driver or device that made them
SHOWN = 5  # number of column names that a message shows
MOST_COLUMNS = 10_000  # limit for tables that are read; pandas takes a minute for ten times as many columns
LONGEST, LONGEST_REASON = 40, 300  # characters shown of a name, and of the message of another library
# Patterns of unreadable numbers, by how to write them. A comma before three digits may have two meanings.
FAULTS = {
    "without thousands separators": r"[-+]?\d{1,3}([,.' \u00a0\u202f]\d{3})+([,.]\d*)?",
    "with a point in place of a decimal comma": r"[-+]?[\d.' \u00a0\u202f]*,\d+([eE][-+]?\d+)?",
    "without their units": r"[-+]?\d+([,.]\d*)?\s*[^\W\d_].*",
}
DATE = re.compile(r"\d{1,4}([-/.])\d{1,2}\1\d{1,4}.*")


def require_file(path: str | os.PathLike, change: str) -> None:
    """Raise InputError, with ``change`` as the advice, unless ``path`` is a file."""
    is_there = os.path.exists(path)  # False for names that the system does not accept, unlike Path.exists
    if not os.path.isfile(path):
        seen = "a folder" if os.path.isdir(path) else "a device or a pipe" if is_there else "no such file"
        change += "" if is_there else begins_in(path)
        raise InputError(str(path), seen=seen, expected="a file to read", change=change)


def header_fault(header: Sequence[str]) -> str:
    """Return what is wrong with the header of a table that lacks a column: another separator, or no header.

    The text is empty if neither is seen.
    """
    whole = header[0] if len(header) == 1 else ""
    for separator, name in ((";", "semicolons"), ("\t", "tabs"), ("|", "vertical bars")):
        if separator in whole:
            return f"cells that are separated by {name} ({cut(whole)}), not by commas"
    if 2 * sum(map(is_number, header)) > len(header):
        return f"numbers in the first row ({names_in_words(header, '')}), so that the table has no header"
    return ""


def is_empty(cell: object) -> bool:
    """Return whether a cell of a table has no value."""
    return pd.api.types.is_scalar(cell) and bool(pd.isna(cell))


def number_fault(cell: object) -> str:
    """Return how to correct a cell that should be a number, for a message; empty if that is not seen."""
    if is_empty(cell):
        return ""
    if not isinstance(cell, str) or DATE.fullmatch(cell.strip()):
        return "Dates and other values are no numbers; correct the column. "
    corrections = [ways for ways, pattern in FAULTS.items() if re.fullmatch(pattern, cell.strip())]
    return f"Write numbers {' and '.join(corrections)}. " if corrections else ""


def column_of_numbers(
    column: pd.Series, where: Callable[[int], str], change: str, *, may_be_empty: bool = False
) -> pd.Series:
    """Return a column as floats; InputError shows the first cell that is not a finite number.

    ``where`` returns the place of a row, given its number from 0. With ``may_be_empty``, empty cells become
    NaN, and infinite numbers are allowed. Numbers that are given as text keep all their digits.
    """
    is_numeric = column.dtype.kind not in "mMb"  # dates would become numbers of nanoseconds
    numbers = pd.to_numeric(column, errors="coerce") if is_numeric else pd.Series(np.nan, column.index)
    wrong = numbers.isna() & column.notna() if may_be_empty else ~np.isfinite(numbers.to_numpy(float))
    if wrong.any():
        row = int(np.argmax(wrong))
        raise InputError(
            f"{where(row)}, column {column.name}",
            seen=repr(column.iloc[row]),
            expected="a number" if may_be_empty else "a finite number",
            change=f"{number_fault(column.iloc[row])}{change}",
        )
    return column.astype(np.float64) if is_numeric else numbers


def require_columns(path: str | os.PathLike, seen: Sequence[str], named: Mapping[str, str]) -> None:
    """Raise InputError if a table lacks a required column.

    InputError names the first missing column, the first few columns, and the most similar one. The keys of
    ``named`` are those of the configuration that name the required columns.
    """
    for key, name in named.items():
        if name not in seen:
            if fault := header_fault(seen):
                raise InputError(
                    f"{path}, row 1",
                    seen=fault,
                    expected=f"names of columns that are separated by commas, with {name!r} among them",
                    change="Export the table with commas, points as decimal marks, and a header.",
                )
            raise InputError(
                f"{path}, column {name!r}",
                seen=f"only the columns {names_in_words(seen, name)}",
                expected="a column of this name" if key == name else f"the column that {key} states",
                change=f"Correct the header of the table{', or the name there' * (key != name)}.",
            )


def names_in_words(names: Sequence[str], wanted: str) -> str:
    """Return a list of names for a message: the name most similar to ``wanted``, and the first few names.

    The text ends with the number of names that are not among the first few.
    """
    shown = dict.fromkeys([*get_close_matches(wanted, names, n=1), *names[:SHOWN]])
    more = f" and {len(names) - SHOWN:,} more" if len(names) > SHOWN else ""
    return f"{', '.join(map(cut, shown)) or 'without a name'}{more}"


def read_parquet(path: str | os.PathLike, named: Mapping[str, str] = MappingProxyType({})) -> pd.DataFrame:
    """Read a Parquet file.

    InputError is raised if it is damaged or lacks one of the columns ``named`` (see `require_columns`), or if
    one of these, or without names any column, is binary.
    """
    try:
        table = pd.read_parquet(path)
    except (OSError, ValueError) as error:  # pyarrow's own errors derive from these
        raise _unreadable(path, error, "a Parquet file") from error
    require_columns(path, list(map(str, table.columns)), named)
    for name in dict.fromkeys(named.values()) or table.columns:
        if table[name].dtype == object and table[name].map(type).isin([bytes]).any():
            from pyarrow.parquet import read_schema  # imported here, because it takes a moment

            raise InputError(
                f"{path}, column {name!r}",
                seen=f"the type {read_schema(path).field(name).type}",
                expected="numbers, or text with numbers",
                change="Write the column as numbers, such as float64; polars writes float16 as binary.",
            )
    return table


def write_parquet(path: str | os.PathLike, table: pd.DataFrame) -> None:
    """Write a table as a Parquet file without its index; an interrupted write leaves no incomplete file."""
    with atomic_path(path) as temporary:
        table.to_parquet(temporary, index=False)


def read_csv(
    path: str | os.PathLike, named: Mapping[str, str] = MappingProxyType({}), *, whole: bool = False
) -> pd.DataFrame:
    """Read a CSV file, which may be compressed (.gz), with all cells as text, without guessing types.

    An empty cell, or a code for one such as NA, is NaN; with ``whole`` it stays as it is.
    InputError is raised if it is damaged, lacks one of the columns ``named`` (see `require_columns`), or has
    two columns of the same name.
    """
    expected = "a comma-separated table in UTF-8 with a header"
    try:
        # The header is checked first: pandas takes a minute for a very wide table, and would rename the
        # second of two equal columns.
        opened = gzip.open if str(path).endswith(".gz") else open
        with opened(path, "rt", encoding="utf-8-sig", newline="") as file:
            first = next(filter(None, csv.reader(file)), None)
        header = [name.strip() for name in first or [] if name]
        if first is not None:  # pandas reports an empty file
            require_columns(path, header, named)
        if len(header) > MOST_COLUMNS:
            raise ValueError(f"{len(header):,} columns, more than {MOST_COLUMNS:,}")
        table = pd.read_csv(path, dtype=str, encoding="utf-8-sig", keep_default_na=not whole)
    # pandas' and Unicode errors derive from ValueError
    except (ValueError, csv.Error, gzip.BadGzipFile, EOFError, zlib.error) as error:
        raise _unreadable(path, error, expected) from error
    if twice := [name for name, count in Counter(header).items() if count > 1]:
        raise _unreadable(path, f"column {', '.join(map(cut, twice[:SHOWN]))} twice", expected)
    if not isinstance(table.index, pd.RangeIndex):  # otherwise pandas would silently shift the columns
        raise _unreadable(path, "more cells in a row than in the header", expected)
    return table.rename(columns=str.strip)


def cut(text: str) -> str:
    """Return a text in quotation marks for a message, shortened to about `LONGEST` characters."""
    quoted = repr(text[: LONGEST + 1])  # a control character takes four characters or more
    return quoted if len(quoted) <= LONGEST + 2 else f"{quoted[:LONGEST]}...'"


def _unreadable(path: str | os.PathLike, reason: object, expected: str) -> InputError:
    shown = " ".join(str(reason).split())[:LONGEST_REASON]
    seen = f"content that cannot be read ({shown})"
    return InputError(str(path), seen=seen, expected=expected, change="Repair the file or write it again.")
