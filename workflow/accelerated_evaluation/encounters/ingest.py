"""From a source of lane-change records to the encounter table and the account of what was left out."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from accelerated_evaluation.encounters import spmd, table, twin
from accelerated_evaluation.encounters.contract import COLUMNS
from accelerated_evaluation.encounters.filters import Account, apply_filters, drop_invalid, drop_repeated
from accelerated_evaluation.encounters.segments import assign_segments


def read_source(
    data: Mapping[str, Any], *, model: twin.Twin | None = None, generator: np.random.Generator | None = None
) -> pd.DataFrame:
    """Read the records of the source that the section ``data`` of the configuration names.

    Parameters
    ----------
    data
        Section ``data`` of a valid configuration.
    model, generator
        What the source ``twin`` is drawn from; the other sources take no notice of them.

    Returns
    -------
    pandas.DataFrame
        Three columns as `contract.complete` takes them, index ``row`` from 1.
    """
    settings = data[data["source"]]
    if data["source"] == "twin":
        return twin.generate(model, generator, settings["events"])
    if data["source"] == "spmd":
        return spmd.read(settings["path"], settings["sha256"])
    return table.read(settings["path"], settings["columns"])


def ingest(raw: pd.DataFrame, config: Mapping[str, Any]) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Validate, filter and segment the records of a source.

    Parameters
    ----------
    raw
        Records as `read_source` returns them.
    config
        A valid configuration; its sections ``data``, ``filters`` and ``segments`` are used.

    Returns
    -------
    encounters : pandas.DataFrame
        The encounter table, columns ``contract.COLUMNS``, in the order of the source.
    account : pandas.DataFrame
        One line a step and reason: ``rows_in``, ``rows_found``, ``rows_dropped``, ``rows_kept`` and the first
        ``example_rows``, counted from 1 in the source.

    Raises
    ------
    InputError
        If a row is invalid and the configuration refuses such, or if a segment is empty.
    """
    data = config["data"]
    source = data[data["source"]]
    where = source.get("path", source["description"])
    account = Account(len(raw))
    encounters = drop_invalid(raw, account, policy=data["invalid_rows"], where=where)
    encounters = drop_repeated(encounters, account, policy=data["repeated_rows"])
    encounters = apply_filters(encounters, account, config["filters"])
    encounters = assign_segments(encounters, config["segments"]["lead_speed_edges"])
    return encounters[list(COLUMNS)].reset_index(drop=True), account.table()
