"""Compute the encounter table from a source of records, with filters and an account of the dropped rows."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Self

import numpy as np
import pandas as pd

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.tables import cut, is_empty, number_fault
from accelerated_evaluation.records.segments import COLUMNS, QUANTITIES, assign_segments, complete

NAMED_ROWS = 5  # number of example rows that the account and the messages show
FASTEST = 300.0  # [m/s]; a larger speed is a wrong unit or a code for a missing value


class Account:
    """The account of the records: the number of rows that each step found, dropped and kept.

    The lines of an earlier account, of an extraction that found these ``rows`` rows in recordings, come
    first.
    """

    def __init__(self, rows: int, earlier: Iterable[dict] = ()) -> None:
        self._lines: list[dict] = list(earlier)
        self._rows = rows

    @classmethod
    def of(cls, raw: pd.DataFrame) -> Self:
        """Return a new account of the records of a source, which counts the rows that filters drop.

        The account of the extraction, if the records were extracted from recordings, comes first. It is in
        ``raw.attrs["account"]``.
        """
        return cls(len(raw), raw.attrs.get("account", ()))

    def take(
        self, table: pd.DataFrame, found: pd.Series, *, step: str, reason: str, drop: bool = True
    ) -> pd.DataFrame:
        """Add one line to the account, and return ``table`` without the rows that were found.

        If ``drop`` is false, the rows are only counted and the complete table is returned.
        """
        self.enter(
            int(found.sum()), step=step, reason=reason, drop=drop, examples=table.index[found][:NAMED_ROWS]
        )
        return table[~found] if drop else table

    def enter(
        self, count: int, *, step: str, reason: str, drop: bool = True, examples: Iterable[object] = ()
    ) -> None:
        """Add one line to the account about rows that are counted elsewhere, for example in a database.

        If ``drop`` is false, the rows are only counted; ``examples`` are the names of a few of them.
        """
        dropped = count if drop else 0
        rows_in, self._rows = self._rows, self._rows - dropped
        self._lines.append(
            {
                "step": step,
                "reason": reason,
                "rows_in": rows_in,
                "rows_found": count,
                "rows_dropped": dropped,
                "rows_kept": self._rows,
                "example_rows": "; ".join(map(str, examples)),
            }
        )

    def summary(self) -> str:
        """Return a text with the number of rows that each filter dropped, and the reasons."""
        dropped = [line for line in self._lines if line["rows_dropped"]]
        counts = (f"{line['rows_dropped']:,} by {line['step']}: {line['reason']}" for line in dropped)
        return "; ".join(counts) or "none were dropped"

    def table(self) -> pd.DataFrame:
        """Return the account as a table with one row per line, in the order of the filters.

        The columns are ``step``, ``reason``, ``rows_in``, ``rows_found``, ``rows_dropped``, ``rows_kept`` and
        ``example_rows`` (a text).
        """
        return pd.DataFrame(self._lines)


def drop_invalid(raw: pd.DataFrame, account: Account, *, policy: str, where: str) -> pd.DataFrame:
    """Compute the numbers of the encounter table, and drop or refuse rows that are not a valid encounter.

    Cells may be missing or text, and other columns than those of `segments.complete` are ignored. The
    columns of the result are finite, and the account gets one line for each reason. With the policy
    ``"refuse"`` instead of ``"drop"``, InputError names the first few invalid rows with their values.
    """
    raw = raw[[name for name in raw if name in QUANTITIES]]
    numbers = raw.apply(pd.to_numeric, errors="coerce").astype(float)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        encounters = complete(numbers)
    reasons = {
        "missing value": raw.isna(),
        "text in place of a number": numbers.isna() & raw.notna(),
        "infinite value, or zero for a range or TTC": np.isinf(pd.concat([numbers, encounters], axis=1)),
        "negative lead speed or range": encounters[["lead_speed", "range"]] < 0,
    }
    too_fast = (
        encounters[["lead_speed", "closing_speed"]].abs().gt(FASTEST)
        & np.isfinite(encounters).all(axis=1).to_numpy()[:, None]
    )
    if too_fast.any(axis=None):  # no line in the account otherwise, because the paper has no such filter
        reasons[f"speed above {FASTEST:g} m/s"] = too_fast
    masks = {reason: cells.any(axis=1) for reason, cells in reasons.items()}
    if policy == "refuse" and any(mask.any() for mask in masks.values()):
        raise InputError(
            where,
            seen="; ".join(_describe(raw, mask, reason) for reason, mask in masks.items() if mask.any()),
            expected="finite numbers, a lead speed and a range that are not negative, and possible speeds",
            change=f"{no_number(raw)[1]}Correct these rows, or set data.invalid_rows to drop.",
        )
    for reason, mask in masks.items():
        encounters = account.take(encounters, mask.loc[encounters.index], step="invalid", reason=reason)
    return encounters


def no_number(raw: pd.DataFrame) -> tuple[str, str]:
    """Return the first cell that is not a number, in words, and how to correct it; both may be empty."""
    raw = raw[[name for name in raw if name in QUANTITIES]]
    wrong = raw.apply(pd.to_numeric, errors="coerce").isna() & raw.notna()
    if not wrong.any(axis=None):
        wrong = raw.isna()
    if not wrong.any(axis=None):
        return "", ""
    row, column = np.argwhere(wrong.to_numpy())[0]
    cell = raw.iloc[row, column]
    shown = "no value" if is_empty(cell) else cut(str(cell))
    return f"row {raw.index[row]} has {shown} as {raw.columns[column]}", number_fault(cell)


def drop_repeated(encounters: pd.DataFrame, account: Account, *, policy: str) -> pd.DataFrame:
    """Count the rows that are equal to the row before them and, if the policy is ``"drop"``, drop them."""
    repeated = (encounters == encounters.shift()).all(axis=1)
    return account.take(
        encounters, repeated, step="repeated", reason="same as the row before", drop=policy == "drop"
    )


def apply_filters(encounters: pd.DataFrame, account: Account, filters: Mapping[str, float]) -> pd.DataFrame:
    """Return the rows in which the gap closes, and lead speed and range are within the limits.

    These are the rows that section II of the paper keeps. The account gets one line for each filter:
    ``lead_speed_min`` [m/s] (inclusive), ``lead_speed_max`` [m/s] (exclusive) and ``range_max`` [m].
    """
    opening = encounters["closing_speed"] <= 0
    encounters = account.take(encounters, opening, step="closing", reason="range rate not negative")
    return apply_limits(encounters, account, filters)


def apply_limits(encounters: pd.DataFrame, account: Account, filters: Mapping[str, float]) -> pd.DataFrame:
    """Return the rows whose lead speed and range are within the limits of `apply_filters`."""
    low, high, range_max = (filters[key] for key in ("lead_speed_min", "lead_speed_max", "range_max"))
    outside = ~encounters["lead_speed"].between(low, high, inclusive="left")
    encounters = account.take(
        encounters, outside, step="lead_speed", reason=f"v_L outside [{low:g}, {high:g}) m/s"
    )
    # The inverse range is compared: 1/R >= 1/R_max is true for every R <= R_max even after rounding, and
    # 1/R_max is the lower end of the distributions of R^-1.
    far = encounters["inverse_range"] < 1 / range_max
    return account.take(encounters, far, step="range", reason=f"R above {range_max:g} m")


def _describe(raw: pd.DataFrame, mask: pd.Series, reason: str) -> str:
    rows = raw[mask].head(NAMED_ROWS)
    named = ", ".join(
        f"{row} ({', '.join(f'{column} {cell}' for column, cell in cells.items())})"
        for row, cells in rows.iterrows()
    )
    more = f" and {mask.sum() - len(rows):,} more" if mask.sum() > len(rows) else ""
    return f"{reason} in row {named}{more}"


def ingest(
    raw: pd.DataFrame,
    data: Mapping[str, Any],
    filters: Mapping[str, float],
    edges: Sequence[float],
    account: Account,
) -> pd.DataFrame:
    """Validate, filter and segment the records of a source, and return the encounter table.

    The records have the columns of `segments.complete`, and an index ``row`` from 1; ``data``, ``filters``
    and ``edges`` are those of `CutInRecords`. The account contains the dropped rows even if an error is
    raised later. InputError is raised if ``data`` refuses invalid rows and there is one, if no row remains,
    if a segment is empty, or if an outlier row named in ``data`` does not exist.
    """
    source = data[data["source"]]
    encounters = drop_invalid(raw, account, policy=data["invalid_rows"], where=source["path"])
    encounters = drop_repeated(encounters, account, policy=data["repeated_rows"])
    encounters = apply_filters(encounters, account, filters)
    if encounters.empty:
        raise InputError(
            source["path"],
            seen=f"{len(raw):,} rows, none of which passed the filters ({account.summary()})",
            expected="at least one row that passes the filters",
            change=f"Check the columns and units of data.{data['source']}, and the limits in filters.",
        )
    encounters = assign_segments(encounters, edges)
    if max(source["outlier_rows"], default=0) > len(encounters):
        raise InputError(
            f"data.{data['source']}.outlier_rows",
            seen=f"row {max(source['outlier_rows']):,}",
            expected=f"rows of the encounter table, which has {len(encounters):,}",
            change="Correct the list, or leave it empty.",
        )
    return encounters[list(COLUMNS)].reset_index(drop=True)


def opening_cut_ins(raw: pd.DataFrame, data: Mapping[str, Any], filters: Mapping[str, float]) -> pd.DataFrame:
    """Return the cut-ins whose closing speed is 0 or negative, within the limits of lead speed and range.

    The paper leaves these cut-ins out, because they cannot end in a crash while the lead vehicle keeps its
    speed. Records with a negative host speed (lead speed plus closing speed) are left out here. The table is
    empty if the source has only closing cut-ins, like the published lane changes of the paper.
    """
    account = Account.of(raw)
    found = drop_invalid(raw, account, policy=data["invalid_rows"], where=data[data["source"]]["path"])
    found = drop_repeated(found, account, policy=data["repeated_rows"])
    opening = (found["closing_speed"] <= 0) & (found["closing_speed"] >= -found["lead_speed"])
    return apply_limits(found[opening], account, filters).reset_index(drop=True)
