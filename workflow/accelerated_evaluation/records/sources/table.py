"""A user's own lane-change records: a CSV or Parquet table with a mapping of its columns and units."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from accelerated_evaluation.base.arrays import INVERSE_LENGTH, INVERSE_TIME, LENGTH, SPEED, TIME
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.sections import Check, Schema, choice, section, text
from accelerated_evaluation.base.tables import read_csv, read_parquet, require_file
from accelerated_evaluation.records.segments import complete
from accelerated_evaluation.records.sources import exposure, source

# For each quantity: the quantities that its column may contain (itself or its inverse), and their units.
UNITS = {
    "lead_speed": {"lead_speed": SPEED},
    "host_speed": {"host_speed": SPEED},
    "range": {"range": LENGTH, "inverse_range": INVERSE_LENGTH},
    "closing_speed": {"closing_speed": SPEED},
    "range_rate": {"range_rate": SPEED},
    "ttc": {"ttc": TIME, "inverse_ttc": INVERSE_TIME},
}
TINY = 1e-9  # relative size of rounding errors
CLOSING = ("closing_speed", "range_rate", "ttc")
QUANTITY = choice(
    "closing_speed",
    CLOSING,
    "Quantity in this column: closing speed, range rate (negative when closing) or TTC (eq. 1).",
)
LEAD_SPEED = "lead_speed"  # default name of the column of the lead speed


def _column(
    name: str | None, unit: str, name_of: str, unit_of: str, quantities: Iterable[str]
) -> dict[str, Schema]:
    """Return the schemas of the keys ``name`` and ``unit`` of a column, given defaults and descriptions."""
    kind = {"type": ["string", "null"]} if name is None else {}
    units = [unit for quantity in quantities for factors in UNITS[quantity].values() for unit in factors]
    return {"name": text(name, name_of, **kind), "unit": choice(unit, dict.fromkeys(units), unit_of)}


COLUMNS = section(
    lead_speed=section(
        **_column(LEAD_SPEED, "m/s", "Column of the lead speed v_L.", "Its unit.", ["lead_speed"])
    ),
    host_speed=section(
        **_column(
            None,
            "m/s",
            "Column of the host speed (of the vehicle behind), from which the lead speed follows; null if "
            "there is a column of the lead speed.",
            "Its unit.",
            ["host_speed"],
        )
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


def _read_columns(columns: Mapping[str, Mapping[str, str]]) -> dict[str, Mapping[str, str]]:
    """Return the columns that are read: the host speed, if it has a name, in place of the lead speed."""
    unread = "host_speed" if columns["host_speed"]["name"] is None else "lead_speed"
    return {key: column for key, column in columns.items() if key != unread}


def _all_different(columns: Mapping[str, Mapping[str, str]]) -> bool:
    return len({column["name"] for column in _read_columns(columns).values()}) == 3


def _one_speed(lead_speed: str, host_speed: str | None) -> bool:
    return host_speed is None or lead_speed == LEAD_SPEED


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
        Check(
            ("columns.lead_speed.name", "columns.host_speed.name"),
            _one_speed,
            "one of them, because the lead speed follows from the host speed and the closing speed",
        ),
        Check(("columns.closing.quantity", "columns.closing.unit"), _is_unit_of, "a unit of that quantity"),
    ),
)
def read(settings: Mapping[str, Any]) -> pd.DataFrame:
    """Read a table of lane changes, .csv (UTF-8, with a header) or .parquet, and convert it to SI units.

    For each column, ``columns`` has its ``name`` and ``unit``, and for ``closing`` its ``quantity``:
    closing_speed, range_rate (negative when closing) or ttc. An inverse unit, such as 1/m or 1/s, means that
    the column contains the inverse. If ``host_speed`` has a name, the lead speed is the host speed minus the
    closing speed. Text and missing cells are not changed; the filters handle them.
    InputError is raised if the file is missing or damaged, of another kind, lacks a column, or a unit is
    unknown.
    """
    path, columns = settings["path"], _read_columns(settings["columns"])
    require_file(path, "Set data.table.path to the file of lane changes.")
    quantities = {key: column.get("quantity", key) for key, column in columns.items()}
    factors = {key: _factor(key, quantity, columns[key]["unit"]) for key, quantity in quantities.items()}
    cells = _read_cells(Path(path), {key: columns[key]["name"] for key in quantities})
    raw = pd.DataFrame({quantity: _scale(cells[key], factor) for key, (quantity, factor) in factors.items()})
    if "host_speed" in raw:
        raw.insert(0, "lead_speed", _lead_speed(raw))
    return raw.drop(columns="host_speed", errors="ignore").set_index(
        pd.RangeIndex(1, len(cells) + 1, name="row")
    )


def _lead_speed(raw: pd.DataFrame) -> pd.Series:
    """Return the host speed minus the closing speed; cells of the host speed that are no numbers stay."""
    numbers = raw.apply(pd.to_numeric, errors="coerce").astype(float)
    host = numbers["host_speed"]
    with np.errstate(divide="ignore", invalid="ignore"):
        closing = complete(numbers.rename(columns={"host_speed": "lead_speed"}))["closing_speed"]
    lead = host - closing
    lead = lead.mask(lead.abs() < TINY * host, 0.0)  # a standing vehicle, but for rounding errors
    return lead.where(host.notna(), raw["host_speed"])


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
