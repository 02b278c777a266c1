"""Checks of the records, which precede all results; each check is one function in a module of this package.

A check takes `Records` and returns a `Finding`, with the verdict ``fine``, ``warning`` or ``stop``:

- ``warning``: the finding is unlikely to be due to chance, at the significance level `LEVEL`, or single rows
  exceed a physical limit. The user should inspect the rows that the finding names.
- ``stop``: the finding makes the results wrong, because most of the records exceed a physical limit (a wrong
  unit or a wrong sign), or because more than a share `MANY` of the rows has a fault.

A new check is one function with the decorator ``@CHECKS.add("<name>")``.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.registry import Registry
from accelerated_evaluation.records.encounter_table import NUMBERS
from accelerated_evaluation.records.filters import Account, apply_filters, drop_invalid
from accelerated_evaluation.records.segments import MINIMUM_ROWS, segment_names

LEVEL = 0.001  # significance level of a test: one table without faults in a thousand gets a warning
MANY = 0.01  # share of the rows; it is a fifth of the uppermost 5 % of the rows, to which tails are fitted
NAMED_ROWS = 5  # number of example rows in a report
FINE, WARNING, STOP = VERDICTS = ("fine", "warning", "stop")


class Replayed(Protocol):
    """The outcomes of n simulated cut-ins: crash, smallest range [m] and smallest time to collision [s]."""

    crash: NDArray[np.bool_]
    min_range: Array
    min_ttc: Array


Simulate = Callable[[Array, Array, Array], Replayed]


@dataclass(frozen=True)
class Finding:
    """The result of a check.

    Attributes
    ----------
    verdict
        ``fine``, ``warning`` or ``stop``.
    looked_at, seen
        Descriptions of what was checked and of what was found.
    number
        The number on which the verdict is based.
    advice
        What to do; empty if the verdict is fine.
    rows
        Affected rows of the source, the worst first.
    """

    verdict: str
    looked_at: str
    seen: str
    number: float
    advice: str = ""
    rows: Sequence[int] = ()


@dataclass(frozen=True)
class Records:
    """The records of a source in the forms that the checks need; all tables are indexed by row of the source.

    Attributes
    ----------
    valid
        All rows with three finite numbers: columns ``lead_speed`` [m/s], ``range`` [m], ``closing_speed``
        [m/s], ``inverse_range`` [1/m] and ``inverse_ttc`` [1/s].
    invalid
        Row numbers of the records that are not a valid encounter.
    kept
        The valid rows that pass the filters.
    edges
        Edges of the segments of the lead speed [m/s].
    simulate
        Function that simulates cut-ins with the vehicle under test, given lead speed [m/s], range [m] and
        closing speed [m/s]; None if there is no vehicle.
    warnings
        Texts about units of the source that could not be checked.
    """

    valid: pd.DataFrame
    invalid: Sequence[int]
    kept: pd.DataFrame
    edges: Sequence[float]
    simulate: Simulate | None = None
    warnings: Sequence[str] = ()

    @classmethod
    def of(cls, raw: pd.DataFrame, config: Mapping[str, Any], simulate: Simulate | None = None) -> "Records":
        """Return the records of a source in the forms that the checks need.

        Parameters
        ----------
        raw
            Unfiltered records of a source: columns ``lead_speed`` [m/s], range and closing speed (or their
            inverses, as in `encounter_table.complete`), index ``row`` from 1.
        config
            A resolved configuration; its sections ``filters`` and ``segments`` are used.
        simulate
            Function that simulates cut-ins with the vehicle under test, given lead speed [m/s], range [m] and
            closing speed [m/s]; None if there is no vehicle.
        """
        account = Account(len(raw))
        valid = drop_invalid(raw, account, policy="drop", where="the records")
        kept = apply_filters(valid, account, config["filters"])
        invalid, warnings = raw.index.difference(valid.index), raw.attrs.get("warnings", ())
        return cls(valid, invalid, kept, config["segments"]["lead_speed_edges"], simulate, warnings)

    @cached_property
    def distinct(self) -> pd.DataFrame:
        """The valid rows without those that repeat the row before them."""
        return self.valid[(self.valid != self.valid.shift()).any(axis=1)]

    @cached_property
    def closing(self) -> pd.DataFrame:
        """The distinct rows in which the gap closes."""
        return self.distinct[self.distinct["closing_speed"] > 0]

    @cached_property
    def host_speed(self) -> pd.Series:
        """Speed of the recording vehicle [m/s] in the valid rows."""
        return self.valid["lead_speed"] + self.valid["closing_speed"]

    @cached_property
    def segments(self) -> dict[str, pd.DataFrame]:
        """The distinct rows that pass the filters, by name of the segment; a segment may have no rows."""
        rows = self.kept[self.kept.index.isin(self.distinct.index)]
        place = np.searchsorted(self.edges, rows["lead_speed"].to_numpy(), side="right") - 1
        return {name: rows[place == number] for number, name in enumerate(segment_names(self.edges))}

    @cached_property
    def outcomes(self) -> pd.DataFrame:
        """The outcomes of replaying the kept rows: ``crash``, ``min_range`` [m] and ``min_ttc`` [s]."""
        found = self.simulate(*(self.kept[name].to_numpy() for name in NUMBERS[:3]))
        names = ("crash", "min_range", "min_ttc")
        return pd.DataFrame({name: getattr(found, name) for name in names}, index=self.kept.index)


Check = Callable[[Records], Finding]
CHECKS: Registry[Check] = Registry("check", __name__, __path__)


def by_share(count: int, size: int) -> str:
    """Return the verdict if ``count`` of ``size`` rows have a fault.

    The verdict is ``fine`` without faults, ``stop`` if more than a share `MANY` of the rows has a fault, and
    otherwise ``warning``.
    """
    if count == 0:
        return FINE
    return STOP if count > MANY * size else WARNING


def inspect_records(records: Records) -> pd.DataFrame:
    """Run all checks on the records.

    Parameters
    ----------
    records
        Records of a source.

    Returns
    -------
    pandas.DataFrame
        One row for each check, ordered by verdict (``stop``, ``warning``, ``fine``). Columns: ``check``,
        ``verdict``, ``looked_at``, ``seen`` and ``number`` (what was checked and found, and the number on
        which the verdict is based), ``rows`` (number of affected rows), ``example_rows`` (rows of the source,
        counted from 1) and ``advice``.

    Raises
    ------
    InputError
        If there are fewer than `MINIMUM_ROWS` valid rows.
    """
    if len(records.valid) < MINIMUM_ROWS:
        raise InputError(
            "the records",
            seen=f"{len(records.valid):,} valid rows, and {len(records.invalid):,} invalid ones",
            expected=f"at least {MINIMUM_ROWS} valid rows to check",
            change="Check the columns and their units.",
        )
    return report_of({name.replace("_", " "): check(records) for name, check in CHECKS.items()})


def report_of(findings: Mapping[str, Finding]) -> pd.DataFrame:
    """Return the findings of checks, given by name of the check, as the table of `inspect_records`."""
    table = pd.DataFrame([_line(name, found) for name, found in findings.items()])
    order = table["verdict"].map(VERDICTS[::-1].index).sort_values(kind="stable").index  # stops first
    return table.loc[order].reset_index(drop=True)


def _line(name: str, found: Finding) -> dict[str, Any]:
    return {
        "check": name,
        "verdict": found.verdict,
        "looked_at": found.looked_at,
        "seen": found.seen,
        "number": found.number,
        "rows": len(found.rows),
        "example_rows": "; ".join(map(str, list(found.rows)[:NAMED_ROWS])),
        "advice": found.advice if found.verdict != FINE else "",
    }
