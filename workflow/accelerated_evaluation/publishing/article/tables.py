"""The published tables of a study and the tables of the benchmarks, as the article reads them."""

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from accelerated_evaluation.base.errors import InputError

DIGITS = 6  # significant digits, as in all published tables


class Tables:
    """Tables in some folders; each is read when it is first used.

    A table is taken from the first folder that has it. ``last`` is the name of the table that was read last,
    for errors.
    """

    def __init__(self, *folders: Path) -> None:
        self.folders, self.last = folders, ""

    def __getitem__(self, name: str) -> pd.DataFrame:
        """Return a table by its name, without its column ``data``; InputError if no folder has it."""
        self.last = name
        for folder in self.folders:
            path = folder / f"{name}.csv"
            if path.is_file():
                return pd.read_csv(path).drop(columns="data", errors="ignore")
        raise InputError(
            f"{self.folders[0] / name}.csv",
            seen="no such file",
            expected="a published table of a finished study",
            change="Run the study first: make study.",
        )

    def row(self, name: str, key: str, value: str) -> dict[str, Any]:
        """Return the first row of a table whose column ``key`` has the given value.

        The row maps the names of the columns to values of JSON types (see `plain`).
        """
        table = self[name]
        return plain(table[table[key] == value].iloc[0].to_dict())

    def rows(self, name: str, columns: Mapping[str, str]) -> list[dict[str, Any]]:
        """Return columns of a table, with new names, as a list of rows with values of JSON types."""
        return plain(self[name][list(columns)].rename(columns=columns).to_dict("records"))


def plain(value: Any) -> Any:  # noqa: ANN401
    """Convert a value to the types of JSON: floats rounded to `DIGITS` digits; None for NaN and infinity.

    Mappings, lists and arrays are converted element by element.
    """
    if isinstance(value, Mapping):
        return {str(key): plain(part) for key, part in value.items()}
    if isinstance(value, list | tuple | np.ndarray | pd.Series):
        return [plain(part) for part in value]
    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, int | np.integer):
        return int(value)
    if isinstance(value, float | np.floating):
        return float(f"{value:.{DIGITS}g}") if math.isfinite(value) else None
    return value


def typeset(text: str) -> str:
    """Return a text with ``^-1`` replaced by a superscript: R⁻¹ in place of R^-1."""
    return text.replace("^-1", "\N{SUPERSCRIPT MINUS}\N{SUPERSCRIPT ONE}")


TEXT = "article.typ"
BENCHMARKS = (
    "worlds",
    "worlds_beyond",
    "samplers",
    "successors",
    "answers",
)  # tables in benchmarks/results that the text quotes
_SHOWN = re.compile(r'plot\("(\w+)"')


def shown_figures(folder: Path) -> tuple[str, ...]:
    """Return the names of the figures that the text in a folder shows, in order."""
    return tuple(dict.fromkeys(_SHOWN.findall((folder / TEXT).read_text(encoding="utf-8"))))
