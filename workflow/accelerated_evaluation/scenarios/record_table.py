"""Tables of records of a scenario: reading, checks, and flags for the rows to which laws are fitted."""

import os
from pathlib import Path

import numpy as np
import pandas as pd

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.tables import read_csv, read_parquet, require_file
from accelerated_evaluation.scenarios.protocol import CLUSTER, FITTED, Scenario

REPEATED, OUTSIDE = "repeated", "outside"  # columns of flags for the two reasons why a row is left out


def read_record_table(scenario: Scenario, path: str | os.PathLike, cluster: str) -> pd.DataFrame:
    """Return the records of a scenario from a file, and mark the rows to which laws are fitted.

    Parameters
    ----------
    scenario
        The scenario.
    path
        Parquet file, or otherwise a CSV file, with the variables of the scenario and the column ``cluster``.
    cluster
        Name of the column that identifies clusters of records, such as the records of one driver.

    Returns
    -------
    pandas.DataFrame
        All columns of the file, `CLUSTER` as text, and three flags: `REPEATED` (an earlier row has the same
        variables and cluster), `OUTSIDE` (a variable is beyond its limits), and `FITTED` (neither of them).

    Raises
    ------
    InputError
        If the file cannot be read, a column is missing, or a variable is not a finite number.
    """
    require_file(path, "Correct the path of the records.")
    names = list(scenario.names)
    named = {f"the scenario {scenario.name} ({name})": name for name in (*names, cluster)}
    read = read_parquet if str(path).endswith(".parquet") else read_csv
    table = read(path, named)
    for name in names:
        table[name] = _numbers(table[name], str(path))
    table[CLUSTER] = table[cluster].astype(str)
    table[REPEATED] = table.duplicated([*names, cluster])
    values, (low, high) = table[names].to_numpy(), scenario.limits.T
    table[OUTSIDE] = ((values < low) | (values > high)).any(axis=1)
    table[FITTED] = ~(table[REPEATED] | table[OUTSIDE])
    return table


def read_scenario_records(scenario: Scenario, path: str | os.PathLike | None = None) -> pd.DataFrame:
    """Return the records of a scenario, after a check of the rows to which laws are fitted.

    Parameters
    ----------
    scenario
        The scenario.
    path
        File of the records; by default the records that come with the project.

    Returns
    -------
    pandas.DataFrame
        All columns of the file, and flags for rows that are repeated, outside the limits, or used in fits.

    Raises
    ------
    InputError
        If there is no file, or if a row to which laws are fitted cannot be simulated.
    """
    source = path or scenario.records
    if source is None:
        raise InputError(
            "scenario.records",
            seen="null",
            expected=f"a file, because no records of the scenario {scenario.name} come with the project",
            change="Name the file of the records.",
        )
    table = scenario.read_records(Path(source))
    fitted = table[table[FITTED]]
    scenario.checked(*(fitted[name] for name in scenario.names), source=str(source), rows=fitted.index + 2)
    return table


def account(table: pd.DataFrame) -> pd.Series:
    """Return the number of records, of records to which laws are fitted, and of records left out.

    Parameters
    ----------
    table
        Result of `read_record_table`.

    Returns
    -------
    pandas.Series
        Numbers of rows: ``records`` (all), `FITTED`, `REPEATED` and `OUTSIDE`; the last three add up to the
        first. A repeated row that is also outside the limits counts as repeated.
    """
    outside = table[OUTSIDE] & ~table[REPEATED]
    parts = {FITTED: table[FITTED], REPEATED: table[REPEATED], OUTSIDE: outside}
    return pd.Series({"records": len(table)} | {name: int(flags.sum()) for name, flags in parts.items()})


def _numbers(column: pd.Series, path: str) -> pd.Series:
    """Return a column as finite numbers; numbers that are given as text keep all their digits."""
    numbers = pd.to_numeric(column, errors="coerce")
    wrong = ~np.isfinite(numbers.to_numpy(float))
    if wrong.any():
        row = int(np.argmax(wrong))
        raise InputError(
            f"{path}, row {row + 2}, column {column.name}",
            seen=repr(column.iloc[row]),
            expected="a finite number",
            change="Correct or remove this record.",
        )
    return column.astype(np.float64)
