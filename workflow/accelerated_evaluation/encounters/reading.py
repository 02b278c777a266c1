"""Read tables from files, with one clear error for what cannot be read."""

import os
from pathlib import Path

import pandas as pd

from accelerated_evaluation.errors import InputError


def require_file(path: str | os.PathLike, change: str) -> None:
    """Raise InputError, with ``change`` as the advice, unless ``path`` is a file."""
    if not Path(path).is_file():
        raise InputError(str(path), seen="no such file", expected="a file to read", change=change)


def read_parquet(path: str | os.PathLike) -> pd.DataFrame:
    """Read a Parquet file; InputError if it is damaged."""
    try:
        return pd.read_parquet(path)
    except (OSError, ValueError) as error:  # pyarrow's own errors derive from these
        raise _unreadable(path, error, "a Parquet file") from error


def read_csv(path: str | os.PathLike) -> pd.DataFrame:
    """Read a CSV file, all cells as text, so that pandas guesses no types.

    Raises
    ------
    InputError
        If it is damaged, or its header has a column twice.
    """
    expected = "a comma-separated table in UTF-8 with a header"
    try:
        # Without this look pandas would rename the second of two equal columns.
        header = pd.read_csv(path, dtype=str, encoding="utf-8-sig", header=None, nrows=1).iloc[0].dropna()
        table = pd.read_csv(path, dtype=str, encoding="utf-8-sig")
    except ValueError as error:  # pandas' and Unicode errors derive from it
        raise _unreadable(path, error, expected) from error
    if header.duplicated().any():
        twice = ", ".join(map(repr, header[header.duplicated()].unique()[:5]))
        raise _unreadable(path, f"column {twice} twice", expected)
    if not isinstance(table.index, pd.RangeIndex):  # else pandas would shift the columns in silence
        raise _unreadable(path, "more cells in a row than in the header", expected)
    return table


def _unreadable(path: str | os.PathLike, reason: object, expected: str) -> InputError:
    seen = f"content that cannot be read ({' '.join(str(reason).split())})"
    return InputError(str(path), seen=seen, expected=expected, change="Mend the file or make it anew.")
