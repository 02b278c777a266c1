"""Sources of lane-change records: one module for each, with its section of the configuration.

A source is a function ``read(settings)`` with the decorator `source`, which states the keys of its section.
The function takes its section of the configuration, ``data.<name>``, and returns the unfiltered records:
three columns as `segments.complete` takes them, and an index ``row`` that counts from 1. Further
columns may say where in the original data a record was found; they are not used in computations. The section
has the keys ``description``, ``path`` and ``outlier_rows``, and any other key that the source needs, such as
``exposure``.

A source that finds cut-ins in recordings also returns the account of dropped rows, and the time and distance
that the hosts drove. Both are attributes of the table; see `recordings.cut_ins.finished`.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from accelerated_evaluation.base.arguments import Argument, if_it
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.registry import Registry
from accelerated_evaluation.base.sections import Check, Schema, listed, number, section, text
from accelerated_evaluation.base.users_code import call

RECORDINGS = (".csv", ".mcap", ".osi")  # endings of the names of files that sources read from a folder
UNKNOWN: Mapping[str, float | None] = {"kilometres": None, "hours": None}
Reader = Callable[[Mapping[str, Any]], pd.DataFrame]


@dataclass(frozen=True)
class Source:
    """A source of records."""

    read: Reader  # takes the section of the source in the configuration and returns the records
    files: str  # kind of file or folder that the key ``path`` names, for messages
    section: Schema  # schema of the section, with defaults
    # Conditions on several keys of the section, which the schema cannot state.
    checks: tuple[Check, ...] = ()


SOURCES: Registry[Source] = Registry("source", __name__, __path__, contract=[Source])
NEEDED = (  # columns of the records, of which one in each line is needed
    {"lead_speed"},
    {"range", "inverse_range"},
    {"closing_speed", "range_rate", "ttc", "inverse_ttc"},
)


A_TABLE = Argument(
    "a table with the columns lead_speed, range and closing_speed, or their inverse_range and ttc",
    if_it(lambda value: isinstance(value, pd.DataFrame) and all(names & set(value) for names in NEEDED)),
    "Correct the source; docs/extensions.md has an example.",
)


def exposure(kilometres: float | None = None, hours: float | None = None) -> Schema:
    """Return the schema of ``exposure``: distance [km] and time [h] in which the records were made."""

    def measure(default: float | None, what: str) -> Schema:
        description = f"{what}; null if unknown."
        return number(default, 0, 1.0e15, description, exclusive=True, null=True)

    return section(
        kilometres=measure(kilometres, "Distance driven while all of the records were made [km]"),
        hours=measure(hours, "Time driven while all of the records were made [h]"),
    )


def source(
    name: str,
    *,
    description: str,
    files: str,
    path: str | None = None,
    outlier_rows: tuple[int, ...] = (),
    checks: tuple[Check, ...] = (),
    **keys: Schema,
) -> Callable[[Reader], Reader]:
    """Return a decorator that registers a function as a source, with its section of the configuration.

    Defaults are the description of the data in outputs, ``path`` and ``outlier_rows``. ``files`` names the
    kind of file, such as ``"CSV file"``, ``checks`` are conditions on several keys, which the schema cannot
    state, and ``keys`` are the schemas of further keys.
    """
    row = {"type": "integer", "minimum": 1, "maximum": 1_000_000_000}
    shared = {
        "description": text(description, "Name of the data in figures, tables and texts."),
        "path": text(path, f"{files}; null as long as another source is used.", type=["string", "null"]),
        "outlier_rows": listed(
            outlier_rows,
            row,
            "Rows of the encounter table, counted from 1, that one variant of the sensitivity study omits.",
            fewest=0,
        ),
    }

    def register(read: Reader) -> Reader:
        SOURCES.add(name)(Source(read, files, section(**shared | keys), checks))
        return read

    return register


def read_source(data: Mapping[str, Any], generator: np.random.Generator) -> pd.DataFrame:
    """Read the records of the configured source, or a random sample of them in the order of the source.

    The columns are those of `segments.complete`, and the index ``row`` counts the rows of the source
    from 1. ``attrs["exposure"]`` contains the kilometres and hours in which all records were made, if they
    are known; they are unknown for a sample. InputError is raised if the source cannot be read, or has fewer
    records than the size of the sample.
    """
    settings = data[data["source"]]
    where = f"source {data['source']}"
    raw = call(SOURCES[data["source"]].read, settings, where=where, returns=A_TABLE)
    raw.attrs.setdefault("exposure", settings.get("exposure", UNKNOWN))
    size = data["sample"]
    if size is None:
        return raw
    if size > len(raw):
        raise InputError(
            "data.sample",
            seen=f"{size:,}, but only {len(raw):,} records in {data[data['source']]['path']}",
            expected="at most as many as there are records",
            change="Lower data.sample, or set it to null to take all records.",
        )
    sample = raw.iloc[np.sort(generator.choice(len(raw), size, replace=False))]
    sample.attrs["exposure"] = UNKNOWN
    return sample


def record_files(settings: Mapping[str, Any]) -> list[str]:
    """Return the paths of the files that a source reads.

    They are the file that the key ``path`` names or, if ``path`` is a folder, all files in the folder whose
    ending is in `RECORDINGS`.
    """
    path = Path(settings["path"])
    if not path.is_dir():
        return [str(path)]
    return sorted(str(file) for file in path.iterdir() if file.suffix in RECORDINGS)


def describe(data: Mapping[str, Any]) -> str:
    """Return the name of the data in outputs: the description of the source, and the size of a sample."""
    description = data[data["source"]]["description"]
    return description if data["sample"] is None else f"{description}, a sample of {data['sample']:,}"
