"""The records of a scenario: where they come from, and how they become a table of encounters."""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, Self

import numpy as np
import pandas as pd

from accelerated_evaluation.base.sections import OR_AUTO, TEXT, choice, integer, listed, number, section, text
from accelerated_evaluation.records.checks import Records, Simulate
from accelerated_evaluation.records.ingest import Account, ingest
from accelerated_evaluation.records.segments import require_rows, write_encounters
from accelerated_evaluation.records.sources import describe, read_source, record_files

SPEED = {"type": "number", "minimum": 0, "maximum": 100}  # [m/s], as an element of a list
DATA = section(  # and a section of each source, which its module owns
    source=text(
        "spmd", "Source of the lane changes (section II); its settings are in the section of this name."
    ),
    sample=integer(
        None,
        100,
        100_000_000,
        "Number of records that are drawn at random from the source; null for all of them.",
        null=True,
    ),
    invalid_rows=choice(
        "refuse",
        ["refuse", "drop"],
        "Treatment of rows with a missing, infinite, negative or non-numeric value, which are always "
        "reported.",
    ),
    repeated_rows=choice(
        "keep",
        ["keep", "drop"],
        "Treatment of rows that repeat the row before them, which are always counted.",
    ),
    accepted_warnings=listed(
        [],
        TEXT,
        "Checks of the records whose verdict stop you accept, by name, such as speed unit. A study in "
        "which another check says stop ends with an error after its results are made.",
        fewest=0,
        uniqueItems=True,
    ),
)
FILTERS = section(
    lead_speed_min=number(5, 0, 100, "Smallest v_L that is kept [m/s] (section II).", auto=True),
    lead_speed_max=number(
        35, 0, 100, "Smallest v_L that is excluded [m/s] (section II).", exclusive=True, auto=True
    ),
    range_max=number(
        75,
        1,
        1000,
        "Largest R that is kept [m]; its inverse is the lower end of the models of R^-1.",
        auto=True,
    ),
)
SEGMENTS = section(
    lead_speed_edges=listed(
        [5, 15, 25, 35],
        SPEED,
        "Edges of the segments of v_L [m/s], increasing, around the filter's limits (section II).",
        fewest=2,
        **OR_AUTO,
    ),
)


class NamedRecords(Protocol):
    """The records of a scenario, as a configuration names them."""

    @property
    def key(self) -> str:
        """Key of the configuration that names the file or folder of the records."""

    @property
    def path(self) -> str:
        """File or folder of the records."""

    @property
    def files(self) -> list[str]:
        """Paths of all files that are read."""

    @property
    def name(self) -> str:
        """File or folder of the records, or a description of it, for messages."""

    @property
    def description(self) -> str:
        """Text that describes the records in tables and figures."""

    def read(self, generator: np.random.Generator) -> pd.DataFrame:
        """Read the records; if the configuration asks for a sample, the generator draws it."""

    def for_checks(self, raw: pd.DataFrame, simulate: Simulate | None = None) -> Records:
        """Return what was read in the form for the checks of records.

        Without ``simulate``, the check that replays the records is skipped.
        """

    def encounters(self, raw: pd.DataFrame, keep: Callable[[pd.DataFrame], None]) -> pd.DataFrame:
        """Return the encounter table of what was read.

        ``keep`` gets the account of all rows, also if InputError is raised because no table can be made.
        """

    def exposure(self, raw: pd.DataFrame) -> Mapping[str, float | None]:
        """Return the kilometres and hours in which the records were made; None where they are unknown."""

    def write(self, path: str | os.PathLike, encounters: pd.DataFrame) -> None:
        """Write an encounter table as a Parquet file."""


@dataclass(frozen=True)
class CutInRecords:
    """Recorded cut-ins from a source, which are filtered and segmented."""

    data: Mapping[str, Any]  # the source, its own section, and the treatment of invalid and repeated rows
    filters: Mapping[str, float]  # limits of the lead speed [m/s] and the range [m]
    edges: Sequence[float]  # edges of the segments of the lead speed [m/s]

    @classmethod
    def of(cls, config: Mapping[str, Any]) -> Self:
        """Return the records of a configuration with the sections ``data``, ``filters`` and ``segments``."""
        return cls(config["data"], config["filters"], config["segments"]["lead_speed_edges"])

    @property
    def key(self) -> str:
        """Key ``path`` of the section of the source."""
        return f"data.{self.data['source']}.path"

    @property
    def path(self) -> str:
        """File or folder of the source."""
        return str(self.data[self.data["source"]]["path"])

    @property
    def files(self) -> list[str]:
        """The file, or all files in the folder that the source reads."""
        return record_files(self.data[self.data["source"]])

    @property
    def name(self) -> str:
        """File or folder of the source."""
        return self.path

    @property
    def description(self) -> str:
        """Description of the source, with the size of a sample."""
        return describe(self.data)

    def read(self, generator: np.random.Generator) -> pd.DataFrame:
        """Read the records of the source, as `read_source` does."""
        return read_source(self.data, generator)

    def for_checks(self, raw: pd.DataFrame, simulate: Simulate | None = None) -> Records:
        """Return the unfiltered records in the form for the checks."""
        return Records.of(raw, self.filters, self.edges, simulate)

    def encounters(self, raw: pd.DataFrame, keep: Callable[[pd.DataFrame], None]) -> pd.DataFrame:
        """Filter and segment the records; InputError is raised if too few remain to fit a law."""
        account = Account.of(raw)
        try:
            found = ingest(raw, self.data, self.filters, self.edges, account)
            require_rows(found)
        finally:
            keep(account.table())
        return found

    def exposure(self, raw: pd.DataFrame) -> Mapping[str, float | None]:
        """Return the exposure that the source knows."""
        return raw.attrs["exposure"]

    def write(self, path: str | os.PathLike, encounters: pd.DataFrame) -> None:
        """Write the encounter table with the description of the source."""
        write_encounters(path, encounters, self.description)
