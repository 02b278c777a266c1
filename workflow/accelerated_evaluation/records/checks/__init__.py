"""Checks of the records, which precede all results; each check is one function in a module of this package.

The checks are the same for every scenario. A check that is only possible for some records, such as that of
the time gap, names the columns that it needs.

A check takes `Records` and returns a `Finding`, with the verdict ``fine``, ``warning`` or ``stop``:

- ``warning``: the finding is unlikely to be due to chance, at the significance level `LEVEL`, or single rows
  exceed a physical limit. The user should inspect the rows that the finding names.
- ``stop``: the finding makes the results wrong, because most of the records exceed a physical limit (a wrong
  unit or a wrong sign), or because more than a share `MANY` of the rows has a fault.

A new check is one function with the decorator ``@CHECKS.add("<name>")``, and with `needs` below it if it
needs certain columns.
"""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
import pandas as pd
import scipy  # loads scipy.stats where it is used; see `answer.calibration`
from numpy.typing import NDArray

from accelerated_evaluation.base.arguments import a_choice, one_of
from accelerated_evaluation.base.checking import checked
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.registry import Registry
from accelerated_evaluation.base.tables import CLUSTER
from accelerated_evaluation.base.users_code import call
from accelerated_evaluation.records.ingest import Account, apply_filters, drop_invalid, no_number
from accelerated_evaluation.records.limits import FARTHEST, FASTEST
from accelerated_evaluation.records.segments import MINIMUM_ROWS, segment_names

LEVEL = 0.001  # significance level of a test: one table without faults in a thousand gets a warning
MANY = 0.01  # share of the rows; it is a fifth of the uppermost 5 % of the rows, to which tails are fitted
NAMED_ROWS = 5  # number of example rows in a report
# Beginnings of the SHA-256 of the records of cut-ins, left turns and pedestrians that come with the project.
# The guide docs/records_report.md explains their warnings.
SHIPPED = frozenset({"3b1ebe9e1357b242", "d21f72d71f394a0c", "2b25f81b7a8cf667"})
UNITS_OF_CUT_INS = {"lead_speed": "m/s", "range": "m", "closing_speed": "m/s"}
CUT_INS = (*UNITS_OF_CUT_INS, "inverse_range", "inverse_ttc")  # columns that only records of cut-ins have
ORDER = "order"  # what checks need that compare rows with those before them
FINE, WARNING, STOP = VERDICTS = ("fine", "warning", "stop")


class SimulatedOutcomes(Protocol):
    """The outcomes of n simulated encounters; cut-ins also have the smallest time to collision and range."""

    crash: NDArray[np.bool_]


Simulate = Callable[..., SimulatedOutcomes]


@checked(verdict=a_choice(VERDICTS))
@dataclass(frozen=True)
class Finding:
    """The result of a check."""

    verdict: str  # ``fine``, ``warning`` or ``stop``
    looked_at: str  # description of what was checked
    seen: str  # description of what was found
    number: float  # the number on which the verdict is based
    advice: str = ""  # what to do; empty if the verdict is fine
    rows: Sequence[int] = ()  # affected rows of the source, the worst first


@dataclass(frozen=True)
class Records:
    """The records of a source in the forms that the checks need; all tables are indexed by its rows."""

    units: Mapping[str, str]  # of the columns of the variables, such as ``m/s``
    limits: Mapping[str, tuple[float, float]]  # smallest and largest possible value of each variable
    # All rows with finite numbers: the variables, and further columns that some checks need.
    valid: pd.DataFrame
    kept: pd.DataFrame  # the valid rows within the limits of the study, to which laws are fitted
    repeated: pd.Index  # row numbers of the valid rows that repeat another row; laws count equal rows once
    invalid: Sequence[int] = ()  # row numbers of the records that are not a valid encounter
    no_number: tuple[str, str] = "", ""  # the first cell without a number, and how to correct it
    edges: Sequence[float] = ()  # for cut-ins, the edges of the segments of the lead speed [m/s]
    # Simulates encounters with the vehicle under test, given their variables; None without a vehicle.
    simulate: Simulate | None = None
    # Records of the same scenario that come with the project; None if there are none.
    known: pd.DataFrame | None = None
    warnings: Sequence[str] = ()  # texts of the source about units and rows that it could not check

    @classmethod
    def of(
        cls,
        raw: pd.DataFrame,
        filters: Mapping[str, float],
        edges: Sequence[float],
        simulate: Simulate | None = None,
    ) -> "Records":
        """Return the records of cut-ins in the forms that the checks need.

        The unfiltered records are as for `ingest`; ``filters`` and ``edges`` as in `CutInRecords`.
        """
        account = Account(len(raw))
        valid = drop_invalid(raw, account, policy="drop", where="the records")
        return cls(
            units=UNITS_OF_CUT_INS,
            limits={"lead_speed": (0.0, FASTEST), "range": (0.0, FARTHEST)},
            valid=valid,
            kept=apply_filters(valid, account, filters),
            repeated=valid.index[(valid == valid.shift()).all(axis=1)],
            invalid=raw.index.difference(valid.index),
            no_number=no_number(raw),
            edges=edges,
            simulate=simulate,
            warnings=raw.attrs.get("warnings", ()),
        )

    @property
    def variables(self) -> list[str]:
        """Names of the columns of the variables."""
        return list(self.units)

    @property
    def are_cut_ins(self) -> bool:
        """Whether the records have the columns of cut-ins."""
        return set(CUT_INS) <= set(self.valid.columns)

    @cached_property
    def sorted_by(self) -> str:
        """The quantity by which the rows are sorted, or the parts of which the table consists; or empty.

        Hardly any rows change against the order, and so many along it that this is not by chance.
        """
        for name in self.valid.columns.difference([CLUSTER], sort=False):
            steps = np.sign(self.valid[name].diff())
            count, against = (steps != 0).sum() - 1, min((steps > 0).sum(), (steps < 0).sum())
            if against <= MANY * count and 2 * scipy.stats.binom.cdf(against, count, 0.5) < LEVEL:
                return name
        return ""

    @cached_property
    def distinct(self) -> pd.DataFrame:
        """The valid rows without those that repeat another row."""
        return self.valid.drop(index=self.repeated)

    @cached_property
    def fitted(self) -> pd.DataFrame:
        """The distinct rows within the limits of the study."""
        return self.kept.drop(index=self.repeated, errors="ignore")

    @cached_property
    def closing(self) -> pd.DataFrame:
        """The distinct cut-ins in which the gap closes."""
        return self.distinct[self.distinct["closing_speed"] > 0]

    @cached_property
    def host_speed(self) -> pd.Series:
        """Speed of the recording vehicle [m/s] in the valid rows of cut-ins."""
        return self.valid["lead_speed"] + self.valid["closing_speed"]

    @cached_property
    def segments(self) -> dict[str, pd.DataFrame]:
        """The fitted cut-ins by name of the segment of the lead speed; a segment may have no rows."""
        place = np.searchsorted(self.edges, self.fitted["lead_speed"].to_numpy(), side="right") - 1
        return {name: self.fitted[place == number] for number, name in enumerate(segment_names(self.edges))}

    @property
    def are_shipped(self) -> bool:
        """Whether these are records that come with the project, unchanged and within the default limits."""
        values = np.ascontiguousarray(self.kept[self.variables].to_numpy(float).round(6))
        return hashlib.sha256(values.tobytes()).hexdigest()[:16] in SHIPPED

    @cached_property
    def outcomes(self) -> pd.DataFrame:
        """The outcomes of replaying the kept rows."""
        found = self.simulate(*(self.kept[name].to_numpy(float) for name in self.variables))
        return pd.DataFrame(vars(found), index=self.kept.index)

    def measured(self, name: str) -> pd.Series:
        """Return the distinct values of a variable; of the closing speed, only those above 0."""
        closes = self.are_cut_ins and name == "closing_speed"
        return (self.closing if closes else self.distinct)[name]


A_FINDING = one_of(Finding, words="a Finding", change="Correct the check; docs/extensions.md has an example.")
Check = Callable[[Records], Finding]
CHECKS: Registry[Check] = Registry("check", __name__, __path__, contract=[Callable])


def needs(*columns: str) -> Callable[[Check], Check]:
    """Return a decorator for a check that is only made of records with certain columns, or with `ORDER`."""

    def limited(check: Check) -> Check:
        check.needs = frozenset(columns)
        return check

    return limited


def by_share(count: int, size: int) -> str:
    """Return the verdict if ``count`` of ``size`` rows have a fault.

    The verdict is ``fine`` without faults, ``stop`` if more than a share `MANY` of the rows has a fault, and
    otherwise ``warning``.
    """
    if count == 0:
        return FINE
    return STOP if count > MANY * size else WARNING


def inspect_records(records: Records) -> pd.DataFrame:
    """Run all checks that are possible for the records, and return a table ordered by verdict.

    There is a row for each check; the first is the worst. ``number`` is the number on which the verdict is
    based, ``rows`` the number of affected rows, ``example_rows`` are rows of the source, counted from 1, and
    ``explained`` says whether the documentation explains this warning about records that come with the
    project. InputError is raised if there are fewer than `MINIMUM_ROWS` valid rows.
    """
    if len(records.valid) < MINIMUM_ROWS:
        raise InputError(
            "the records",
            seen=f"{len(records.valid):,} valid rows, and {len(records.invalid):,} invalid ones",
            expected=f"at least {MINIMUM_ROWS} valid rows to check",
            change="Check the columns and their units.",
        )
    columns = {*records.valid.columns, *([] if records.sorted_by else [ORDER])}
    made = {name: check for name, check in CHECKS.items() if getattr(check, "needs", frozenset()) <= columns}
    found = {
        name: call(check, records, where=f"check {name}", returns=A_FINDING) for name, check in made.items()
    }
    table = pd.DataFrame([_line(name.replace("_", " "), finding) for name, finding in found.items()])
    table["explained"] = records.are_shipped & (table["verdict"] == WARNING)
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
