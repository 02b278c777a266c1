"""Compute the encounter table, and the account of dropped rows, from a source of lane-change records."""

from collections.abc import Mapping
from typing import Any

import pandas as pd

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.records.encounter_table import COLUMNS
from accelerated_evaluation.records.filters import (
    Account,
    apply_filters,
    apply_limits,
    drop_invalid,
    drop_repeated,
)
from accelerated_evaluation.records.segments import assign_segments


def ingest(raw: pd.DataFrame, config: Mapping[str, Any], account: Account) -> pd.DataFrame:
    """Validate, filter and segment the records of a source, and return the encounter table.

    The records have the columns of `encounter_table.complete`, and an index ``row`` from 1. The account
    contains the dropped rows even if an error is raised later. InputError is raised if the configuration
    refuses invalid rows and there is one, if no row remains, if a segment is empty, or if an outlier row
    named in the configuration does not exist.
    """
    data = config["data"]
    source = data[data["source"]]
    encounters = drop_invalid(raw, account, policy=data["invalid_rows"], where=source["path"])
    encounters = drop_repeated(encounters, account, policy=data["repeated_rows"])
    encounters = apply_filters(encounters, account, config["filters"])
    if encounters.empty:
        raise InputError(
            source["path"],
            seen=f"{len(raw):,} rows, none of which passed the filters ({account.summary()})",
            expected="at least one row that passes the filters",
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


def opening_cut_ins(raw: pd.DataFrame, config: Mapping[str, Any]) -> pd.DataFrame:
    """Return the cut-ins whose closing speed is 0 or negative, within the limits of lead speed and range.

    The paper leaves these cut-ins out, because they cannot end in a crash while the lead vehicle keeps its
    speed. Records with a negative host speed (lead speed plus closing speed) are left out here. The table is
    empty if the source has only closing cut-ins, like the published lane changes of the paper.
    """
    data, account = config["data"], Account.of(raw)
    found = drop_invalid(raw, account, policy=data["invalid_rows"], where=data[data["source"]]["path"])
    found = drop_repeated(found, account, policy=data["repeated_rows"])
    opening = (found["closing_speed"] <= 0) & (found["closing_speed"] >= -found["lead_speed"])
    return apply_limits(found[opening], account, config["filters"]).reset_index(drop=True)
