"""The records of a scenario in the form in which laws are fitted to them."""

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np
import pandas as pd

from accelerated_evaluation.answer.candidates.joint_family import ClusteredRecords
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.checking import checked
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.tables import read_parquet, write_parquet
from accelerated_evaluation.laws import Box
from accelerated_evaluation.laws.smooth.family import DistinctRecords
from accelerated_evaluation.laws.smooth.support import Support
from accelerated_evaluation.records.checks import Records
from accelerated_evaluation.records.named import NamedRecords
from accelerated_evaluation.records.segments import read_encounters, write_encounters
from accelerated_evaluation.records.sources import UNKNOWN
from accelerated_evaluation.scenarios import A_SCENARIO
from accelerated_evaluation.scenarios.protocol import CLUSTER, FITTED, Scenario

FEWEST = 50  # smallest number of records, so that the region near the event, with a tenth of them, has a few
TIED = 1e-9  # relative size of the residuals of a variable that is a linear function of others


@dataclass(frozen=True, repr=False)
class FittedRecords:
    """The records of a scenario to which laws are fitted, with the distance and time in which they were made.

    Cut-ins are in the order of the recording, and a row that repeats the row before it is left out. Records
    of other scenarios come in clusters, such as those of one driver.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> turns = ae.read_records("left_turn")
    >>> half = ae.FittedRecords.of(turns.scenario, turns.table[::2])
    >>> turns.size, half.size
    (1028, 512)
    """

    scenario: Scenario
    table: pd.DataFrame  # the encounter table
    data: DistinctRecords | ClusteredRecords
    exposure: Mapping[str, float | None] = field(default_factory=lambda: UNKNOWN)
    account: pd.DataFrame | None = None  # number of records that each filter has removed

    @classmethod
    @checked(scenario=A_SCENARIO)
    def of(
        cls,
        scenario: Scenario,
        table: pd.DataFrame,
        support: Support | None = None,
        exposure: Mapping[str, float | None] = UNKNOWN,
    ) -> Self:
        """Return the records of an encounter table; a support is the limits of cut-ins for smooth laws."""
        needed = scenario.names if support is not None else (*scenario.names, FITTED, CLUSTER)
        if missing := [name for name in needed if name not in table]:
            raise InputError(
                "FittedRecords.of, argument table",
                seen=f"a table without {', '.join(missing)}",
                expected=f"an encounter table of the scenario {scenario.name}: {', '.join(needed)}",
                change="Read your own table with read_records, which makes it.",
            )
        data = clustered(scenario, table) if support is None else DistinctRecords.of(table, support)
        return cls(scenario, table, data, exposure)

    def __repr__(self) -> str:
        """Return the number of records and their scenario."""
        return f"{self.size:,} records of {self.scenario.one}, with {', '.join(self.scenario.names)}"

    @property
    def x(self) -> Array:
        """The records as points, shape (n, d)."""
        return self.data.x

    @property
    def in_clusters(self) -> bool:
        """Whether the records come in clusters, for which the candidates are joint laws."""
        return isinstance(self.data, ClusteredRecords)

    @property
    def distinct(self) -> DistinctRecords:
        """The records as cut-ins to which smooth laws can be fitted; InputError for other records."""
        if isinstance(self.data, ClusteredRecords):
            raise InputError(
                f"the records of the scenario {self.scenario.name}",
                seen="records in clusters, whose candidates are joint laws",
                expected="cut-ins with the limits of smooth laws",
                change="Use records of cut-ins, or a function for all records.",
            )
        return self.data

    @property
    def size(self) -> int:
        """Number of records."""
        return len(self.x)

    @checked()
    def write(self, path: str | os.PathLike) -> None:
        """Write the encounter table as a Parquet file."""
        if self.in_clusters:
            write_parquet(path, self.table)
        else:
            write_encounters(path, self.table, self.table.attrs.get("description", "not described"))

    @property
    def per_km(self) -> float | None:
        """Records per kilometre [1/km]; None if the distance is not known."""
        kilometres = self.exposure["kilometres"]
        return None if kilometres is None else self.size / kilometres


def records_of(
    scenario: Scenario,
    named: NamedRecords,
    generator: np.random.Generator,
    support: Support | None = None,
    check: Callable[[Records], None] | None = None,
) -> FittedRecords:
    """Read records, and filter and segment cut-ins; the generator draws a sample if one is asked for.

    ``support`` is the limits of cut-ins for smooth laws. ``check`` gets the records as the checks of records
    need them, and may raise an error. Records without a support are replayed with the vehicle that is known
    to the scenario, and no records with the vehicle under test.
    """
    raw = named.read(generator)
    if check is not None:
        known = None if support is not None else scenario.known_vehicle().simulate
        check(named.for_checks(raw, known))
    accounts: list[pd.DataFrame] = []
    records = FittedRecords.of(scenario, named.encounters(raw, accounts.append), support, named.exposure(raw))
    return replace(records, account=accounts[0])


def stored_records(
    scenario: Scenario,
    path: str | os.PathLike,
    support: Mapping[str, Any] | None,
    exposure: Mapping[str, float | None] = UNKNOWN,
) -> FittedRecords:
    """Read the encounter table of a study; cut-ins need the content of the limits of their laws."""
    if support is not None:
        return FittedRecords.of(scenario, read_encounters(path), Support.of(support), exposure)
    return FittedRecords.of(scenario, read_parquet(path), exposure=exposure)


def clustered(scenario: Scenario, table: pd.DataFrame) -> ClusteredRecords:
    """Return the fitted records of a table with their clusters; InputError if no law can be fitted."""
    fitted = table[table[FITTED]]
    if len(fitted) < FEWEST:
        raise InputError(
            f"the records of the scenario {scenario.name}",
            seen=f"{len(fitted)} of {len(table)} within the limits of the variables and not repeated",
            expected=f"{FEWEST} or more, to which laws can be fitted",
            change="Check the units of the columns with the command inspect, or name more records.",
        )
    box = Box(scenario.names, *(tuple(map(float, side)) for side in scenario.law_limits.T))
    x = scenario.as_in_law(fitted[list(scenario.names)].to_numpy(float))
    for k, name in enumerate(scenario.names):
        _require_variation(x[:, : k + 1], f"the records of the scenario {scenario.name}, column {name}")
    return ClusteredRecords.of(x, fitted[CLUSTER], box)


def _require_variation(x: Array, where: str) -> None:
    """Raise InputError if the last column of x, shape (n, d), is constant, or determined by the others."""
    others, last = np.column_stack([np.ones(len(x)), x[:, :-1]]), x[:, -1]
    rest = last - others @ np.linalg.lstsq(others, last, rcond=None)[0]
    if np.abs(rest).max() <= TIED * np.abs(last).max():
        raise InputError(
            where,
            seen="one value in all records" if np.ptp(last) == 0 else "a linear function of earlier columns",
            expected="values that vary, to which a joint distribution can be fitted",
            change="Check how the column was made.",
        )
