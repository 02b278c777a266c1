"""The verdict on the records, which every command states with its numbers, and the report as text.

Every command that computes a number from records runs the checks of the records first. If the verdict of a
check is ``stop``, the command raises an error, unless the user accepts this check by name. An accepted
``stop`` is printed next to the number. The checks with the verdict ``warning`` are named in one line.
"""

import os
import textwrap
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Self

import pandas as pd

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.records.checks import CHECKS, STOP, VERDICTS, WARNING, Records, inspect_records
from accelerated_evaluation.records.segments import NUMBERS

WIDTH = 100
FLAG = "--accept"
KEY = "data.accepted_warnings"
# Warnings that say which fault is likely, and what would change without it.
IN_FULL = ("known records", "selection", "speed unit")


def read_report(path: str | os.PathLike) -> pd.DataFrame:
    """Return the report on the records that a study has written, one row for each check."""
    return pd.read_csv(path, keep_default_na=False)


def report_in_words(report: pd.DataFrame) -> str:
    """Return the table of `checks.inspect_records` as readable text, in the order of the table."""
    lines = [summary(report), ""]
    for row in report.to_dict("records"):
        known = " (explained in docs/records_report.md)" if row["explained"] else ""
        lines.append(f"{row['verdict'].upper():5} {row['check']}: {row['seen']}{known}")
        if row["advice"]:
            rows = f"rows {row['example_rows']}" if row["rows"] else ""
            more = (
                f" and {row['rows'] - row['example_rows'].count(';') - 1:,} more" if row["rows"] > 5 else ""
            )
            parts = [f"looked at: {row['looked_at']}", f"{rows}{more}", row["advice"]]
            lines += [
                textwrap.fill(part, WIDTH, initial_indent=" " * 6, subsequent_indent=" " * 6)
                for part in parts
                if part
            ]
    return "\n".join(lines)


def summary(report: pd.DataFrame) -> str:
    """Return a summary of the table of `checks.inspect_records`.

    The summary states the number of checks for each verdict, and the names of the checks whose verdict is
    ``stop``.
    """
    counts = ", ".join(f"{(report['verdict'] == verdict).sum()} {verdict}" for verdict in VERDICTS)
    stops = report.loc[report["verdict"] == STOP, "check"]
    if stops.empty:
        return f"{len(report)} checks of the records: {counts}."
    return (
        f"{len(report)} checks of the records: {counts}. STOP: {', '.join(stops)}. "
        "No result of these records can be trusted before this is explained."
    )


@dataclass(frozen=True)
class Verdict:
    """The results of the checks of the records, and which of them the user accepts.

    Attributes
    ----------
    stops
        Mapping from the name of each check with the verdict ``stop`` to what the check found.
    warnings
        Names of the checks with the verdict ``warning``, unless the documentation explains the warning.
    accepted
        Names of the checks that the user accepts even if their verdict is ``stop``.
    advice
        Mapping from the name of each check with the verdict ``stop`` to what the user should do.
    reasons
        Mapping from the names of those warnings that are stated in full next to each number to what the check
        found.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> found = ae.estimate("left_turn", ae.Request(law="independent_variables"))
    >>> found.verdict.stops
    {}
    """

    stops: Mapping[str, str]
    warnings: tuple[str, ...]
    accepted: frozenset[str]
    advice: Mapping[str, str]
    reasons: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def of(cls, report: pd.DataFrame, accepted: Iterable[str] = ()) -> Self:
        """Return the verdict that follows from a report, the table of the checks of the records.

        Parameters
        ----------
        report
            Table that `checks.inspect_records` returns.
        accepted
            Names of the checks that the user accepts.

        Raises
        ------
        InputError
            If ``accepted`` contains a name that is not the name of a check.
        """
        accepted = frozenset(accepted)
        require_checks(accepted)
        stops = report[report["verdict"] == STOP].set_index("check")
        warned = report[(report["verdict"] == WARNING) & ~report["explained"].astype(bool)].set_index("check")
        reasons = warned.loc[warned.index.isin(IN_FULL), "seen"].to_dict()
        found, advice = stops["seen"].to_dict(), stops["advice"].to_dict()
        return cls(found, tuple(warned.index), accepted, advice, reasons)

    @property
    def refused(self) -> list[str]:
        """Names of the checks with the verdict ``stop`` that the user does not accept."""
        return [name for name in self.stops if name not in self.accepted]

    def require_accepted(self, where: str) -> None:
        """Raise InputError if a check has the verdict ``stop`` and the user does not accept this check.

        Parameters
        ----------
        where
            Name of the records, for the error.
        """
        if not self.refused:
            return
        flags = " ".join(f'{FLAG} "{name}"' for name in self.refused)
        raise InputError(
            f"the records ({where})",
            seen="; ".join(f"STOP: {name}: {self.stops[name]}" for name in self.refused),
            expected="records for which no check says stop, because other results cannot be trusted",
            change=f"{' '.join(self.advice[name] for name in self.refused)} `accelerated-evaluation inspect` "
            f"names the rows. If the records are right as they are, accept each check by its name: {flags}, "
            f"or {KEY}: [{', '.join(self.refused)}] in the configuration.",
        )

    def lines(self) -> list[str]:
        """Return a line of text for each ``stop`` and one line for all warnings; no lines if all is fine."""
        return [*self.stop_lines(), *self.warning_lines()]

    def stop_lines(self) -> list[str]:
        """Return a line of text for each ``stop``."""
        notes = {name: " (accepted by name)" for name in self.accepted}
        return [
            f"STOP{notes.get(name, '')}: {name} of the records: {seen}" for name, seen in self.stops.items()
        ]

    def warning_lines(self) -> list[str]:
        """Return one line of text for all warnings, if there are any, with those that are stated in full."""
        advice = "`accelerated-evaluation inspect` names the rows of the records"
        named = ", ".join(
            f"{name} ({self.reasons[name]})" if name in self.reasons else name for name in self.warnings
        )
        return [f"warning: {named}; {advice}"] if self.warnings else []

    @property
    def in_short(self) -> str:
        """Names of the checks that found a fault, by verdict; empty if there is none."""
        found = {"STOP": ", ".join(self.stops), "warning": ", ".join(self.warnings)}
        return "; ".join(f"{verdict}: {names}" for verdict, names in found.items() if names)

    def added_to(self, table: pd.DataFrame) -> pd.DataFrame:
        """Return a table of results with the column ``records``, which names the checks that found a fault.

        If there is no such check, the table is returned unchanged.
        """
        return table.assign(records=self.in_short) if self.in_short else table

    def added_to_answers(self, tables: Mapping[str, pd.DataFrame]) -> dict[str, pd.DataFrame]:
        """Return tables by name, in which ``answer`` and ``estimate`` have the column of `added_to`."""
        return {
            name: self.added_to(table) if name in ("answer", "estimate") else table
            for name, table in tables.items()
        }

    def content(self) -> dict[str, Any]:
        """Return the findings for a file of a law; `from_content` reads them."""
        return {"stops": dict(self.stops), "warnings": list(self.warnings), "advice": dict(self.advice)} | (
            {"reasons": dict(self.reasons)} if self.reasons else {}
        )

    @classmethod
    def from_content(cls, content: Mapping[str, Any], accepted: Iterable[str] = ()) -> Self:
        """Return the verdict that a file of a law contains, with the checks that the user accepts."""
        accepted = frozenset(accepted)
        require_checks(accepted)
        stops = {name: str(seen) for name, seen in dict(content["stops"]).items()}
        advice = {name: str(content["advice"][name]) for name in stops}
        reasons = {name: str(seen) for name, seen in dict(content.get("reasons", {})).items()}
        return cls(stops, tuple(map(str, content["warnings"])), accepted, advice, reasons)


def verdict_on(records: Records, where: str, accepted: Iterable[str] = ()) -> Verdict:
    """Check records of any scenario, and raise InputError unless the user accepts each ``stop``.

    ``where`` is the file of the records, for the error.
    """
    verdict = Verdict.of(inspect_records(records), accepted)
    verdict.require_accepted(where)
    return verdict


def verdict_on_encounters(encounters: pd.DataFrame, where: str, accepted: Iterable[str] = ()) -> Verdict:
    """Check an encounter table, and raise InputError unless the user accepts each ``stop``.

    The limits and segments for the checks are those of the table itself.
    """
    edges = sorted({float(edge) for name in encounters["segment"].unique() for edge in name.split("-")})
    filters = {
        "lead_speed_min": edges[0],
        "lead_speed_max": edges[-1],
        "range_max": float(encounters["range"].max()) * (1 + 1e-9),  # so that rounding drops no row
    }
    rows = encounters[list(NUMBERS[:3])].set_axis(range(1, len(encounters) + 1))
    records = Records.of(rows, filters, edges)
    return verdict_on(records, where, accepted)


def require_checks(names: Iterable[str]) -> None:
    """Raise InputError unless each name is the name of a check of the records."""
    if not (names := set(names)):
        return  # without the half second that the import of the checks and of SciPy's distributions takes
    known = [name.replace("_", " ") for name in CHECKS]
    if unknown := sorted(names - set(known)):
        raise InputError(
            f"{KEY} or {FLAG}",
            seen=", ".join(map(repr, unknown)),
            expected=f"names of checks of the records: {', '.join(sorted(known))}",
            change="Correct the name.",
        )
