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
    """Validate, filter and segment the records of a source.

    Parameters
    ----------
    raw
        Unfiltered records of a source: columns ``lead_speed`` [m/s], range and closing speed (or their
        inverses, as in `encounter_table.complete`), index ``row`` from 1.
    config
        A valid configuration; its sections ``data``, ``filters`` and ``segments`` are used.
    account
        A new account of the records. It contains the dropped rows even if an error is raised later.

    Returns
    -------
    pandas.DataFrame
        The encounter table, in the order of the source: columns ``lead_speed`` [m/s], ``range`` [m],
        ``closing_speed`` [m/s], ``inverse_range`` [1/m], ``inverse_ttc`` [1/s] and ``segment``.

    Raises
    ------
    InputError
        If the configuration refuses invalid rows and there is one, if no row remains, if a segment is empty,
        or if an outlier row named in the configuration does not exist.
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
    speed. Records with a negative host speed (lead speed plus closing speed) are left out here.

    Parameters
    ----------
    raw
        Unfiltered records of a source: columns ``lead_speed`` [m/s], range and closing speed (or their
        inverses, as in `encounter_table.complete`), index ``row`` from 1.
    config
        A valid configuration; its sections ``data`` and ``filters`` are used.

    Returns
    -------
    pandas.DataFrame
        Columns ``lead_speed`` [m/s], ``range`` [m], ``closing_speed`` [m/s], ``inverse_range`` [1/m] and
        ``inverse_ttc`` [1/s]. The table is empty if the source has only closing cut-ins, like the published
        lane changes of the paper.
    """
    data, account = config["data"], Account.of(raw)
    found = drop_invalid(raw, account, policy=data["invalid_rows"], where=data[data["source"]]["path"])
    found = drop_repeated(found, account, policy=data["repeated_rows"])
    opening = (found["closing_speed"] <= 0) & (found["closing_speed"] >= -found["lead_speed"])
    return apply_limits(found[opening], account, config["filters"]).reset_index(drop=True)
