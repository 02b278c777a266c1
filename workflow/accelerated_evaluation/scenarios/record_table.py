"""Tables of records of a scenario: read, checked, and with a verdict on every row."""

import os
from pathlib import Path

import numpy as np
import pandas as pd

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.tables import read_csv, read_parquet, require_file
from accelerated_evaluation.scenarios.protocol import CLUSTER, FITTED, Scenario

REPEATED, OUTSIDE = "repeated", "outside"  # columns that say why a row is left out


def read_record_table(scenario: Scenario, path: str | os.PathLike, cluster: str) -> pd.DataFrame:
    """Read the records of a scenario, and mark the rows to which laws are fitted.

    Parameters
    ----------
    scenario
        The scenario.
    path
        Parquet file, or otherwise a CSV file, with the variables of the scenario and the column ``cluster``.
    cluster
        Column that says which records belong together, such as those of one driver.

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
    """Read the records of a scenario, and check that the rows for the fit are within its limits.

    Parameters
    ----------
    scenario
        The scenario.
    path
        The file; by default the records that come with the project.

    Raises
    ------
    InputError
        If there is no file, or a row cannot be used.
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
    """Return how many records there are, and how many of them are fitted, or left out for each reason.

    Parameters
    ----------
    table
        Result of `read_record_table`.

    Returns
    -------
    pandas.Series
        ``records``, and its parts `FITTED`, `REPEATED` and `OUTSIDE`. A repeated row counts as such, even if
        it is outside.
    """
    outside = table[OUTSIDE] & ~table[REPEATED]
    parts = {FITTED: table[FITTED], REPEATED: table[REPEATED], OUTSIDE: outside}
    return pd.Series({"records": len(table)} | {name: int(flags.sum()) for name, flags in parts.items()})


def _numbers(column: pd.Series, path: str) -> pd.Series:
    """Return a column as finite numbers; text keeps all its digits."""
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
