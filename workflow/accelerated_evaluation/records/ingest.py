"""From a source of lane-change records to the encounter table and the account of what was left out."""

from collections.abc import Mapping
from typing import Any

import pandas as pd

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.records.encounter_table import COLUMNS
from accelerated_evaluation.records.filters import Account, apply_filters, drop_invalid, drop_repeated
from accelerated_evaluation.records.segments import assign_segments


def ingest(raw: pd.DataFrame, config: Mapping[str, Any], account: Account) -> pd.DataFrame:
    """Validate, filter and segment the records of a source.

    Parameters
    ----------
    raw
        Records as `sources.read_source` returns them.
    config
        A valid configuration; its sections ``data``, ``filters`` and ``segments`` are used.
    account
        A new account of the records. Every row that is dropped is entered in it, also if the ingest fails.

    Returns
    -------
    pandas.DataFrame
        The encounter table, columns ``contract.COLUMNS``, in the order of the source.

    Raises
    ------
    InputError
        If a row is invalid and the configuration refuses such, if no row is left, if a segment is empty, or
        if an outlier row that the configuration names is not in the table.
    """
    data = config["data"]
    source = data[data["source"]]
    encounters = drop_invalid(raw, account, policy=data["invalid_rows"], where=source["path"])
    encounters = drop_repeated(encounters, account, policy=data["repeated_rows"])
    encounters = apply_filters(encounters, account, config["filters"])
    if encounters.empty:
        raise InputError(
            source["path"],
            seen=f"{len(raw):,} rows, of which none is left ({account.summary()})",
            expected="rows that pass the filters",
            change=f"Check the columns and units of data.{data['source']}, and the limits in filters.",
        )
    encounters = assign_segments(encounters, config["segments"]["lead_speed_edges"])
    if max(source["outlier_rows"], default=0) > len(encounters):
        raise InputError(
            f"data.{data['source']}.outlier_rows",
            seen=f"row {max(source['outlier_rows']):,}",
            expected=f"rows of the encounter table, which has {len(encounters):,}",
            change="Correct the list, or leave it empty.",
        )
    return encounters[list(COLUMNS)].reset_index(drop=True)
