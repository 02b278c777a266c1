"""Tables of records of a scenario: reading, checks, and flags for the rows to which laws are fitted."""

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
import pandas as pd

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import project_file
from accelerated_evaluation.base.sections import integer, mapping, section, text
from accelerated_evaluation.base.tables import (
    column_of_numbers,
    read_csv,
    read_parquet,
    require_file,
    write_parquet,
)
from accelerated_evaluation.records.checks import Records, Simulate
from accelerated_evaluation.records.named import NamedRecords
from accelerated_evaluation.records.sources import UNKNOWN
from accelerated_evaluation.scenarios import DEFAULT
from accelerated_evaluation.scenarios.protocol import CLUSTER, FITTED, Scenario

REPEATED, OUTSIDE = "repeated", "outside"  # columns of flags for the two reasons why a row is left out
SECTION = section(
    name=text(
        DEFAULT,
        "Kind of encounter: cut_in, or another module of workflow/accelerated_evaluation/scenarios. The "
        "sections data, filters, segments, models, crash_map, answer, sensitivity and uncertainty are only "
        "for cut-ins.",
    ),
    records=text(
        None,
        "File of the records for a scenario other than the cut-in; null for the records of the project.",
        type=["string", "null"],
    ),
    draws=integer(
        100,
        20,
        10_000,
        "Number of posterior draws of the law, in a study of a scenario other than the cut-in.",
    ),
    simulations=integer(
        200_000,
        1000,
        1_000_000_000,
        "Number of simulations under the draws of the law, in a study of a scenario other than the cut-in. "
        "If an event is rare, they are repeated up to 25 times with other encounters, until there are 100 "
        "events.",
    ),
    event=text(
        "crash",
        "Event for which the methods are compared, and which the command estimate counts, in a scenario "
        "other than the cut-in: crash, or another outcome and a threshold in its unit, such as "
        "impact_speed=1.",
    ),
    limits=mapping(
        {},
        "Largest values of variables of the encounters, by name, such as turning_speed_mps: 30. Encounters "
        "with larger values do not happen, and every answer is about the others.",
        additionalProperties={"type": "number"},
    ),
)


def read_record_table(scenario: Scenario, path: str | os.PathLike, cluster: str) -> pd.DataFrame:
    """Return the records of a scenario from a file, and mark the rows to which laws are fitted.

    The file, Parquet or CSV, has the variables and a column that identifies clusters, such as the records of
    one driver. It is returned with `CLUSTER` as text, and three flags: `REPEATED` (an earlier row has the
    same variables and cluster), `OUTSIDE` (a variable is beyond its limits), and `FITTED` (neither of them).
    InputError is raised if the file cannot be read, a column is missing, or a variable is not a finite
    number.
    """
    require_file(path, "Correct the path of the records.")
    names = list(scenario.names)
    named = {f"the scenario {scenario.name} ({name})": name for name in (*names, cluster)}
    read = read_parquet if str(path).endswith(".parquet") else read_csv
    table = read(path, named)
    for name in names:
        table[name] = _numbers(table[name], str(path))
    table[CLUSTER] = _names_of_clusters(table[cluster], str(path))
    table[REPEATED] = table.duplicated([*names, CLUSTER])
    values, (low, high) = table[names].to_numpy(), scenario.limits.T
    table[OUTSIDE] = ((values < low) | (values > high)).any(axis=1)
    table[FITTED] = ~(table[REPEATED] | table[OUTSIDE])
    return table


def read_scenario_records(scenario: Scenario, path: str | os.PathLike | None = None) -> pd.DataFrame:
    """Return the records of a scenario, after a check of the rows to which laws are fitted.

    By default, they are those that come with the project. InputError is raised if there is no file, or if a
    row to which laws are fitted cannot be simulated.
    """
    source = project_file(TableRecords(scenario, path).path)
    table = _read_records(scenario, source)
    fitted = table[table[FITTED]]
    scenario.checked(*(fitted[name] for name in scenario.names), source=str(source), rows=fitted.index + 2)
    return table


@dataclass(frozen=True)
class TableRecords:
    """Records of a scenario that are one table with its variables."""

    scenario: Scenario
    given: str | os.PathLike | None  # path of the table; None for the records that come with the project
    key: ClassVar = "scenario.records"

    @classmethod
    def of(cls, scenario: Scenario, config: Mapping[str, Any]) -> Self:
        """Return the records that the section ``scenario`` of a configuration names."""
        return cls(scenario, config["scenario"]["records"])

    @property
    def path(self) -> str:
        """The table; InputError is raised if none is named and none comes with the project."""
        if (path := self.given or self.scenario.records.file) is None:
            missing = f"no records of the scenario {self.scenario.name} come with the project"
            raise InputError(
                self.key,
                seen="null",
                expected=f"a file, because {missing}",
                change="Name the file of the records.",
            )
        return str(path)

    @property
    def files(self) -> list[str]:
        """The table."""
        return [self.path]

    @property
    def name(self) -> str:
        """The file of the records; a description if they come with the project."""
        return str(self.given or f"records of the scenario {self.scenario.name} in the project")

    @property
    def description(self) -> str:
        """Text that describes the records in tables and figures."""
        return f"records of the scenario {self.scenario.name.replace('_', ' ')}"

    def read(self, _: np.random.Generator) -> pd.DataFrame:
        """Read the table, as `read_scenario_records` does; no sample is drawn."""
        return read_scenario_records(self.scenario, self.given)

    def for_checks(self, raw: pd.DataFrame, simulate: Simulate | None = None) -> Records:
        """Return the table in the form for the checks of records."""
        return records_to_check(self.scenario, raw, simulate)

    def encounters(self, raw: pd.DataFrame, keep: Callable[[pd.DataFrame], None]) -> pd.DataFrame:
        """Return the table, which has flags for the rows to which no laws are fitted."""
        keep(records_account(self.scenario, raw))
        return raw

    def exposure(self, _: pd.DataFrame) -> Mapping[str, float | None]:
        """Return unknown kilometres and hours, because a table does not state them."""
        return UNKNOWN

    def write(self, path: str | os.PathLike, encounters: pd.DataFrame) -> None:
        """Write the table as a Parquet file."""
        write_parquet(path, encounters)


def named_records_of(scenario: Scenario, config: Mapping[str, Any]) -> NamedRecords:
    """Return the records of a scenario that a configuration names."""
    return (scenario.records.named or partial(TableRecords.of, scenario))(config)


def records_to_check(scenario: Scenario, table: pd.DataFrame, simulate: Simulate | None = None) -> Records:
    """Return records of a scenario other than the cut-in in the form for the checks of records.

    The rows of the table are counted from 1. Without ``simulate``, the check that replays the records is
    skipped.
    """
    names = list(scenario.names)
    shipped = scenario.records.file and project_file(scenario.records.file)
    rows = table[[*names, CLUSTER]].set_axis(range(1, len(table) + 1))
    values, (low, high) = rows[names].to_numpy(float), scenario.limits.T
    return Records(
        units={each.name: each.unit for each in scenario.variables},
        limits={each.name: (each.low, each.high) for each in scenario.variables},
        valid=rows,
        kept=rows[((values >= low) & (values <= high)).all(axis=1)],
        repeated=rows.index[rows.duplicated()],
        simulate=simulate,
        known=None if shipped is None or not shipped.exists() else _read_records(scenario, shipped),
    )


def account(table: pd.DataFrame) -> pd.Series:
    """Return the number of ``records``, and of those that are `FITTED`, `REPEATED` and `OUTSIDE`.

    The last three add up to the first. A repeated row that is also outside the limits counts as repeated.
    """
    outside = table[OUTSIDE] & ~table[REPEATED]
    parts = {FITTED: table[FITTED], REPEATED: table[REPEATED], OUTSIDE: outside}
    return pd.Series({"records": len(table)} | {name: int(flags.sum()) for name, flags in parts.items()})


def records_account(scenario: Scenario, records: pd.DataFrame) -> pd.DataFrame:
    """Describe the records of a scenario: number of rows and clusters, and quantiles of each variable.

    There is a row for each variable. The numbers of records are those of `account`, with those for the fit as
    ``fitted``.
    """
    repeated = int(records.duplicated(list(scenario.names)).sum())
    rows = []
    for each in scenario.variables:
        values = records[each.name]
        rows.append(
            {
                "variable": each.name,
                "unit": each.unit,
                "records": len(records),
                "fitted": int(records[FITTED].sum()),
                "clusters": records[CLUSTER].nunique(),
                "repeated": repeated,
                "outside": int((~values.between(each.low, each.high)).sum()),
                "smallest": values.min(),
                "median": values.median(),
                "largest": values.max(),
            }
        )
    return pd.DataFrame(rows)


def _read_records(scenario: Scenario, path: Path) -> pd.DataFrame:
    if scenario.records.read is None:
        return read_record_table(scenario, path, scenario.records.cluster)
    return scenario.records.read(path)


def _names_of_clusters(column: pd.Series, path: str) -> pd.Series:
    """Return the names of the clusters as text; raise InputError if a row has none."""
    empty = column.isna() | (column.astype(str).str.strip() == "")
    if empty.any():
        raise InputError(
            f"{path}, row {int(np.argmax(empty)) + 2}, column {column.name}",
            seen=f"no name; {empty.sum():,} of {len(column):,} rows have none",
            expected="the name of the driver or device that made the record, in every row",
            change="Fill the column. If nobody knows who made a record, give each such record its own name, "
            "and expect intervals that may be too short.",
        )
    return column.astype(str)


def _numbers(column: pd.Series, path: str) -> pd.Series:
    """Return a column as finite numbers."""
    return column_of_numbers(column, lambda row: f"{path}, row {row + 2}", "Correct or remove this record.")
