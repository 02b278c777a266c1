"""A user's own lane-change records: a CSV or Parquet table with a mapping of its columns and units."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from accelerated_evaluation.base.arrays import INVERSE_LENGTH, INVERSE_TIME, LENGTH, SPEED, TIME
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.sections import Check, Schema, choice, section, text
from accelerated_evaluation.base.tables import read_csv, read_parquet, require_file
from accelerated_evaluation.records.sources import exposure, source

# For each quantity: the quantities that its column may contain (itself or its inverse), and their units.
UNITS = {
    "lead_speed": {"lead_speed": SPEED},
    "range": {"range": LENGTH, "inverse_range": INVERSE_LENGTH},
    "closing_speed": {"closing_speed": SPEED},
    "range_rate": {"range_rate": SPEED},
    "ttc": {"ttc": TIME, "inverse_ttc": INVERSE_TIME},
}


def _column(name: str, unit: str, name_of: str, unit_of: str, quantities: Iterable[str]) -> dict[str, Schema]:
    """Return the schemas of the keys ``name`` and ``unit`` of a column, given defaults and descriptions."""
    units = [unit for quantity in quantities for factors in UNITS[quantity].values() for unit in factors]
    return {"name": text(name, name_of), "unit": choice(unit, dict.fromkeys(units), unit_of)}


CLOSING = ("closing_speed", "range_rate", "ttc")
QUANTITY = choice(
    "closing_speed",
    CLOSING,
    "Quantity in this column: closing speed, range rate (negative when closing) or TTC (eq. 1).",
)
COLUMNS = section(
    lead_speed=section(
        **_column("lead_speed", "m/s", "Column of the lead speed v_L.", "Its unit.", ["lead_speed"])
    ),
    range=section(
        **_column(
            "range",
            "m",
            "Column of the range R, or of its inverse.",
            "Its unit; 1/m and 1/ft mean that the column contains R^-1.",
            ["range"],
        )
    ),
    closing=section(
        **_column(
            "closing_speed",
            "m/s",
            "Column of the closing speed, range rate or TTC.",
            "Its unit; 1/s means that the column contains TTC^-1.",
            CLOSING,
        ),
        quantity=QUANTITY,
    ),
)


def _all_different(columns: Mapping[str, Mapping[str, str]]) -> bool:
    return len({column["name"] for column in columns.values()}) == len(columns)


def _is_unit_of(quantity: str, unit: str) -> bool:
    return any(unit in factors for factors in UNITS[quantity].values())


@source(
    "table",
    description="lane changes of a user's table",
    files="CSV or Parquet file",
    exposure=exposure(),
    columns=COLUMNS,
    checks=(
        Check(("columns",), _all_different, "a different column for each of the three quantities"),
        Check(("columns.closing.quantity", "columns.closing.unit"), _is_unit_of, "a unit of that quantity"),
    ),
)
def read(settings: Mapping[str, Any]) -> pd.DataFrame:
    """Read a table of lane changes, .csv (UTF-8, with a header) or .parquet, and convert it to SI units.

    For each column, ``columns`` has its ``name`` and ``unit``, and for ``closing`` its ``quantity``:
    closing_speed, range_rate (negative when closing) or ttc. An inverse unit, such as 1/m or 1/s, means that
    the column contains the inverse. Text and missing cells are not changed; the filters handle them.
    InputError is raised if the file is missing or damaged, of another kind, lacks a column, or a unit is
    unknown.
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
    """Return the name of the quantity in a column (or its inverse), and the factor to its SI unit."""
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
    """Return the columns with the given names, with their cells as in the file, renamed to their keys."""
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
    """Multiply the numbers in a column by a factor; cells that are not numbers stay unchanged."""
    if cells.dtype.kind not in "iuf":  # to_numeric would convert booleans and dates to numbers
        cells = cells.astype(str)
    numbers = pd.to_numeric(cells, errors="coerce").astype(float) * factor
    return numbers.where(numbers.notna() | cells.isna(), cells)
