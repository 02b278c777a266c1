"""The encounter table, the only form in which lane-change records are passed to other packages."""

import os

import numpy as np
import pandas as pd

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.tables import read_parquet, require_file, write_parquet

NUMBERS = ("lead_speed", "range", "closing_speed", "inverse_range", "inverse_ttc")
COLUMNS = (*NUMBERS, "segment")
QUANTITIES = (*NUMBERS, "range_rate", "ttc")  # names of columns in the records of a source


def complete(raw: pd.DataFrame) -> pd.DataFrame:
    """Compute the five numbers of the encounter table from the three columns of a source.

    Columns that the source provides are not changed.

    Parameters
    ----------
    raw
        ``lead_speed`` [m/s]; ``range`` [m] or ``inverse_range`` [1/m]; and one of ``closing_speed`` [m/s],
        ``range_rate`` [m/s], ``ttc`` [s] and ``inverse_ttc`` [1/s].

    Returns
    -------
    pandas.DataFrame
        Columns ``NUMBERS``, index of ``raw``. TTC = -R / (dR/dt), the first equation of section II of the
        paper, and the closing speed is -dR/dt.
    """
    range_ = raw["range"] if "range" in raw else 1 / raw["inverse_range"]
    inverse_range = raw["inverse_range"] if "inverse_range" in raw else 1 / range_
    if "closing_speed" in raw or "range_rate" in raw:
        closing_speed = raw["closing_speed"] if "closing_speed" in raw else -raw["range_rate"]
        inverse_ttc = closing_speed * inverse_range
    else:
        inverse_ttc = raw["inverse_ttc"] if "inverse_ttc" in raw else 1 / raw["ttc"]
        closing_speed = inverse_ttc / inverse_range
    values = (raw["lead_speed"], range_, closing_speed, inverse_range, inverse_ttc)
    return pd.DataFrame(dict(zip(NUMBERS, values, strict=True)))


def write_encounters(path: str | os.PathLike, encounters: pd.DataFrame, description: str) -> None:
    """Write an encounter table as a Parquet file.

    Parameters
    ----------
    path
        File to write.
    encounters
        Table with the columns `COLUMNS`; its index and other columns are not written.
    description
        Description of the data, which is stored in the metadata of the file.
    """
    table = encounters[list(COLUMNS)].reset_index(drop=True)
    table.attrs = {"description": description}
    write_parquet(path, table)


def read_encounters(path: str | os.PathLike) -> pd.DataFrame:
    """Read an encounter table from a Parquet file.

    Parameters
    ----------
    path
        File that `write_encounters` wrote.

    Returns
    -------
    pandas.DataFrame
        One row for each encounter, with the columns `COLUMNS`. Its ``attrs["description"]`` contains the
        description of the data.

    Raises
    ------
    InputError
        If the file is missing or is not an encounter table.
    """
    require_file(path, "Run the ingest step, or correct the path.")
    table = read_parquet(path)
    if list(table.columns) != list(COLUMNS):
        raise InputError(
            str(path),
            seen=f"columns {', '.join(map(str, table.columns))}",
            expected=f"the columns of an encounter table: {', '.join(COLUMNS)}",
            change="Write the file with the ingest step.",
        )
    numbers = table[list(NUMBERS)]
    are_numbers = all(kind.kind in "iuf" for kind in numbers.dtypes)
    if not are_numbers or not (np.isfinite(numbers) & (numbers >= 0)).all(axis=None):
        raise InputError(
            str(path),
            seen="speeds, ranges or times that are missing, infinite, below 0 or not numbers",
            expected="an encounter table as the ingest step writes it",
            change="Write the file with the ingest step.",
        )
    return table
