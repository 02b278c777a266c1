"""A user's own lane-change records: a CSV or Parquet table with a mapping of its columns and units."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.tables import read_csv, read_parquet, require_file
from accelerated_evaluation.records.sources import SOURCES

# factor of each unit to the SI unit of its quantity
SPEED = {"m/s": 1.0, "km/h": 1 / 3.6, "mph": 0.44704, "ft/s": 0.3048}

UNITS = {
    "lead_speed": {"lead_speed": SPEED},
    "range": {
        "range": {"m": 1.0, "km": 1000.0, "ft": 0.3048},
        "inverse_range": {"1/m": 1.0, "1/ft": 1 / 0.3048},
    },
    "closing_speed": {"closing_speed": SPEED},
    "range_rate": {"range_rate": SPEED},
    "ttc": {"ttc": {"s": 1.0, "ms": 0.001}, "inverse_ttc": {"1/s": 1.0}},
}


@SOURCES.add("table")
def read(settings: Mapping[str, Any]) -> pd.DataFrame:
    """Read a table of lane changes and convert it to SI units.

    Parameters
    ----------
    settings
        ``path`` of a file whose name ends in .csv (comma-separated, UTF-8, with a header) or .parquet; and
        ``columns``: ``lead_speed``, ``range`` and ``closing``, each with the ``name`` of its column and its
        ``unit``, and for ``closing`` its ``quantity``: closing_speed, range_rate (negative when closing) or
        ttc. An inverse unit, such as 1/m or 1/s, says that the column holds the inverse.

    Returns
    -------
    pandas.DataFrame
        Three columns as `contract.complete` takes them, index ``row`` (data rows counted from 1). Text stays
        text and missing cells stay missing; both are for the filters to judge.

    Raises
    ------
    InputError
        If the file is missing or damaged, of another kind, lacks a column, or a unit is unknown.
    """
    path, columns = settings["path"], settings["columns"]
    require_file(path, "Set data.table.path to the file of lane changes.")
    quantities = {
        "lead_speed": "lead_speed",
        "range": "range",
        "closing": columns["closing"]["quantity"],
    }
    factors = {key: _factor(key, quantity, columns[key]["unit"]) for key, quantity in quantities.items()}
    cells = _read_cells(Path(path), {key: columns[key]["name"] for key in quantities})
    raw = {quantity: _scale(cells[key], factor) for key, (quantity, factor) in factors.items()}
    return pd.DataFrame(raw).set_index(pd.RangeIndex(1, len(cells) + 1, name="row"))


def _factor(key: str, quantity: str, unit: str) -> tuple[str, float]:
    """Return the SI quantity that a column holds, the inverse if its unit is inverse, and its factor."""
    for name, factors in UNITS[quantity].items():
        if unit in factors:
            return name, factors[unit]
    raise InputError(
        f"data.table.columns.{key}.unit",
        seen=repr(unit),
        expected="one of " + ", ".join(unit for factors in UNITS[quantity].values() for unit in factors),
        change=f"State the unit of the column of {quantity}.",
    )


def _read_cells(path: Path, names: Mapping[str, str]) -> pd.DataFrame:
    """Read the named columns, cell by cell as they are in the file, under their keys."""
    readers = {".csv": read_csv, ".parquet": read_parquet}
    if path.suffix.lower() not in readers:
        raise InputError(
            str(path),
            seen=f"a name ending in {path.suffix!r}",
            expected=f"a name ending in {' or '.join(readers)}",
            change="Convert the table.",
        )
    table = readers[path.suffix.lower()](
        path, {f"data.table.columns.{key}.name": name for key, name in names.items()}
    )
    return pd.DataFrame({key: table[name].reset_index(drop=True) for key, name in names.items()})


def _scale(cells: pd.Series, factor: float) -> pd.Series:
    """Multiply the numbers of a column; a cell that is none stays as it is."""
    if cells.dtype.kind not in "iuf":  # to_numeric would take booleans and dates for numbers
        cells = cells.astype(str)
    numbers = pd.to_numeric(cells, errors="coerce").astype(float) * factor
    return numbers.where(numbers.notna() | cells.isna(), cells)
