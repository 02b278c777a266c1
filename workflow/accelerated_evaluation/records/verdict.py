"""The verdict on the records that goes with every number made from them.

Every command that gives a number asks for this verdict first. A check that says ``stop`` refuses the number,
unless the user accepts that check by name. An accepted stop is printed next to the number. Checks that say
``warning`` are named in one line.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Self

import pandas as pd

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.records.checks import (
    CHECKS,
    STOP,
    WARNING,
    Records,
    Simulate,
    inspect_records,
)
from accelerated_evaluation.records.encounter_table import NUMBERS

FLAG = "--accept"
KEY = "data.accepted_warnings"


@dataclass(frozen=True)
class Verdict:
    """What the checks of the records say.

    Attributes
    ----------
    stops
        What each check found that says ``stop``, by the name of the check.
    warnings
        Names of the checks that say ``warning``.
    accepted
        Names of the checks whose ``stop`` the user accepts.
    advice
        What to do about each stop, by the name of the check.
    """

    stops: Mapping[str, str]
    warnings: tuple[str, ...]
    accepted: frozenset[str]
    advice: Mapping[str, str]

    @classmethod
    def of(cls, report: pd.DataFrame, accepted: Iterable[str] = ()) -> Self:
        """Return the verdict that the report of `checks.inspect_records` gives.

        Raises
        ------
        InputError
            If the user accepts a check that does not exist.
        """
        accepted = frozenset(accepted)
        require_checks(accepted)
        stops = report[report["verdict"] == STOP].set_index("check")
        warnings = report.loc[report["verdict"] == WARNING, "check"]
        return cls(stops["seen"].to_dict(), tuple(warnings), accepted, stops["advice"].to_dict())

    @property
    def refused(self) -> list[str]:
        """Names of the checks that say ``stop`` and that the user does not accept."""
        return [name for name in self.stops if name not in self.accepted]

    def require_accepted(self, where: str) -> None:
        """Raise InputError if a check says ``stop`` and the user does not accept it.

        Parameters
        ----------
        where
            What the records are called, for the error.
        """
        if not self.refused:
            return
        flags = " ".join(f'{FLAG} "{name}"' for name in self.refused)
        raise InputError(
            f"the records ({where})",
            seen="; ".join(f"STOP: {name}: {self.stops[name]}" for name in self.refused),
            expected="records about which no check says stop, because no result of others can be trusted",
            change=f"{' '.join(self.advice[name] for name in self.refused)} `accelerated-evaluation inspect` "
            f"names the rows. If the records are right as they are, accept each check by its name: {flags}, "
            f"or {KEY}: [{', '.join(self.refused)}] in the configuration.",
        )

    def lines(self) -> list[str]:
        """Return a line for each stop and one line for all warnings; no line where all checks are fine."""
        if not self.warnings:
            return self.stop_lines()
        names = ", ".join(self.warnings)
        advice = "`accelerated-evaluation inspect` names the rows of the records"
        return [*self.stop_lines(), f"warning: {names}; {advice}"]

    def stop_lines(self) -> list[str]:
        """Return a line for each stop, with what was found."""
        said = {name: " (accepted by name)" for name in self.accepted}
        return [
            f"STOP{said.get(name, '')}: {name} of the records: {seen}" for name, seen in self.stops.items()
        ]

    def beside(self, table: pd.DataFrame) -> pd.DataFrame:
        """Return a table of results with the column ``records``, which names the stops if there are any."""
        return table.assign(records=f"STOP: {', '.join(self.stops)}") if self.stops else table


def verdict_on(raw: pd.DataFrame, config: Mapping[str, Any], simulate: Simulate | None = None) -> Verdict:
    """Check the records of a source, and raise unless each stop is accepted.

    Parameters
    ----------
    raw
        Records as `sources.read_source` returns them.
    config
        A resolved configuration; its sections ``data``, ``filters`` and ``segments`` are used.
    simulate
        Replays the records; None where that would take too long.

    Raises
    ------
    InputError
        If a check says ``stop`` and ``data.accepted_warnings`` does not name it.
    """
    report = inspect_records(Records.of(raw, config, simulate))
    verdict = Verdict.of(report, config["data"]["accepted_warnings"])
    verdict.require_accepted(config["data"][config["data"]["source"]]["path"])
    return verdict


def verdict_on_encounters(encounters: pd.DataFrame, where: str, accepted: Iterable[str] = ()) -> Verdict:
    """Check an encounter table, whose own limits and segments are used, as `verdict_on` checks records.

    Parameters
    ----------
    encounters
        Encounter table.
    where
        Its file, for the error.
    accepted
        Names of the checks whose stop is accepted.
    """
    edges = sorted({float(edge) for name in encounters["segment"].unique() for edge in name.split("-")})
    filters = {
        "lead_speed_min": edges[0],
        "lead_speed_max": edges[-1],
        "range_max": float(encounters["range"].max()) * (1 + 1e-9),  # so that rounding drops no row
    }
    rows = encounters[list(NUMBERS[:3])].set_axis(range(1, len(encounters) + 1))
    report = inspect_records(Records.of(rows, {"filters": filters, "segments": {"lead_speed_edges": edges}}))
    verdict = Verdict.of(report, accepted)
    verdict.require_accepted(where)
    return verdict


def require_checks(names: Iterable[str]) -> None:
    """Raise InputError unless all names are those of checks of the records."""
    if not (names := set(names)):
        return  # to know the checks, their modules and SciPy's distributions are imported: half a second
    known = [name.replace("_", " ") for name in CHECKS]
    if unknown := sorted(names - set(known)):
        raise InputError(
            f"{KEY} or {FLAG}",
            seen=", ".join(map(repr, unknown)),
            expected=f"names of checks of the records: {', '.join(sorted(known))}",
            change="Correct the name.",
        )
