"""Sources of lane-change records: one module for each, found by name, with its section in the configuration.

A source is a function ``read(settings)``. It takes its section of the configuration, ``data.<name>``, and
returns the records as they are: three columns as `contract.complete` takes them, and an index ``row`` that
counts from 1. It may have further columns, which say where a record comes from and go no further. Its section
has the keys ``description``, ``path`` and ``outlier_rows``, and any other that the source needs, such as
``exposure``.

A source that finds the cut-ins in recordings tells more in the attributes of what it returns, see
`recordings.cut_ins.finished`: the account of what it dropped, and how far and how long the hosts drove.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.registry import Registry

RECORDINGS = (".csv", ".mcap", ".osi")  # endings of files that some source reads from a folder
UNKNOWN: Mapping[str, float | None] = {"kilometres": None, "hours": None}
SOURCES: Registry[Callable[[Mapping[str, Any]], pd.DataFrame]] = Registry("source", __name__, __path__)


def read_source(data: Mapping[str, Any], generator: np.random.Generator) -> pd.DataFrame:
    """Read the records of the source that the configuration names, or a random sample of them.

    Parameters
    ----------
    data
        Section ``data`` of a valid configuration.
    generator
        Draws the sample, if ``data.sample`` asks for one.

    Returns
    -------
    pandas.DataFrame
        Three columns as `contract.complete` takes them; the index ``row`` counts the rows of the source from
        1. A sample keeps the order of the source. ``attrs["exposure"]`` has the kilometres and hours in which
        all records were made, where the source or the configuration tells; of a sample it is not known.

    Raises
    ------
    InputError
        If the source has fewer records than the sample asks for, or cannot be read.
    """
    settings = data[data["source"]]
    raw = SOURCES[data["source"]](settings)
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
    """Return the files that a source reads: that of its path, or all recordings if it is a folder.

    Parameters
    ----------
    settings
        Section of the source.
    """
    path = Path(settings["path"])
    if not path.is_dir():
        return [str(path)]
    return sorted(str(file) for file in path.iterdir() if file.suffix in RECORDINGS)


def describe(data: Mapping[str, Any]) -> str:
    """Return what outputs call the data of a study: the source's description, and whether it is a sample.

    Parameters
    ----------
    data
        Section ``data`` of a valid configuration.
    """
    description = data[data["source"]]["description"]
    return description if data["sample"] is None else f"{description}, a sample of {data['sample']:,}"
