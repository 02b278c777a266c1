"""Tables of outcomes from the track: reading, with checks against the requested runs, and writing."""

import math
import os
from collections.abc import Iterable, Mapping

import pandas as pd

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.tables import listed, read_csv, require_file
from accelerated_evaluation.scenarios.protocol import Scenario
from accelerated_evaluation.track.campaign import Campaign, Run
from accelerated_evaluation.track.driven import BEYOND, DrivenOutcome, outcome_in_words

FLAGS = {
    "1": True,
    "0": False,
    "1.0": True,
    "0.0": False,
    "true": True,
    "false": False,
    "yes": True,
    "no": False,
}
# Largest allowed difference between a reported variable of an encounter and the requested value, in the unit
# of the variable; it allows for the rounding of a spreadsheet. A run that differs more has to be driven
# again.
TOLERANCE = 0.01


def read_results(path: str | os.PathLike, campaign: Campaign) -> dict[int, DrivenOutcome]:
    """Read a table of outcomes with the columns ``run`` and ``crash``, and optional measurements.

    The table may be one that `write_table` wrote and that was filled in, or the output of
    ``accelerated-evaluation simulate`` for it. Rows without a crash flag are ignored, because these runs have
    not been driven yet. The result has the outcomes by the number of the run. InputError, which contains the
    row number as in a spreadsheet, is raised if a row cannot be interpreted, names a run that was not
    requested, or contradicts itself, the requested run or another row.
    """
    require_file(path, "Write the table, or correct its path.")
    table = read_csv(path)
    table.columns = [str(name).strip() for name in table.columns]
    for name in ("run", "crash"):
        if name not in table:
            seen = f"only the columns {listed(list(table.columns), name)}"
            change = "Fill in the table that `campaign ask` wrote."
            raise InputError(str(path), seen=seen, expected=f"a column {name}", change=change)
    results: dict[int, DrivenOutcome] = {}
    for row, cells in enumerate(table.to_dict("records"), start=2):
        given = {
            name: str(cell).strip() for name, cell in cells.items() if not pd.isna(cell) and str(cell).strip()
        }
        if not given:
            continue
        where = f"{path}, row {row}"
        run = _run_of(given, campaign, where)
        outcome = _driven_outcome(given, run, campaign, where)
        if outcome is None:
            continue
        if results.setdefault(run.number, outcome) != outcome:
            seen = f"run {run.number} a second time, with another outcome"
            expected = f"{outcome_in_words(results[run.number])}, as in the row before"
            raise InputError(where, seen=seen, expected=expected, change="Remove the wrong row.")
    return results


def _run_of(given: Mapping[str, str], campaign: Campaign, where: str) -> Run:
    number = _number(given, "run", f"{where}, column run")
    if number is None or number not in range(1, len(campaign.runs) + 1):
        last = len(campaign.runs)
        raise InputError(
            f"{where}, column run",
            seen=given.get("run", "nothing"),
            expected=f"the number of a requested run, 1 to {last}"
            if last
            else "no row, because no run was requested",
            change="Correct the number, or request runs with `campaign ask` first.",
        )
    run = campaign.runs[int(number) - 1]
    if run.outcome == BEYOND:
        raise InputError(
            f"{where}, column run",
            seen=f"run {run.number}, which is beyond the limits of the campaign",
            expected="the number of a requested run",
            change="Remove the row.",
        )
    for name, asked in zip(campaign.scenario.names, run.encounter, strict=True):
        driven = _number(given, name, f"{where}, column {name}")
        if driven is not None and not abs(driven - asked) <= TOLERANCE + 1e-6 * abs(asked):
            raise InputError(
                f"{where}, column {name}",
                seen=f"{driven:g}",
                expected=f"{asked:g}, as requested for run {run.number}",
                change="Correct the number of the run, or drive the run as it was requested.",
            )
    return run


def _driven_outcome(
    given: Mapping[str, str], run: Run, campaign: Campaign, where: str
) -> DrivenOutcome | None:
    """Return the outcome of a run from a row of a table; None if the row has no outcome yet."""
    scenario, event = campaign.scenario, campaign.event
    numbers = {name: _number(given, name, f"{where}, column {name}") for name in scenario.measured}
    measured = {name: value for name, value in numbers.items() if value is not None}
    if "crash" not in given:
        if measured:
            _refuse(where, "crash", "nothing", f"0 or 1, because {next(iter(measured))} is filled in")
        return None
    if given["crash"].lower() not in FLAGS:
        _refuse(
            where, "crash", repr(given["crash"]), "1 if the cars touched, 0 if not, nothing if not driven"
        )
    crash = FLAGS[given["crash"].lower()]
    rules = scenario.reported_rules(crash, dict(zip(scenario.names, run.encounter, strict=True)))
    for name, (fits, expected) in rules.items():
        if name in measured and not fits(measured[name]):
            _refuse(where, name, f"{measured[name]:g}", expected)
    # An event above a threshold, such as an impact speed, can only happen in a crash.
    is_needed = event.quantity in scenario.measured and (crash or not event.is_above)
    if is_needed and event.quantity not in measured:
        _refuse(where, event.quantity, "nothing", "a number, because it defines the event of this campaign")
    # A quantity may be infinite, such as the time to collision if the gap never closed. Infinite values are
    # left out, because JSON cannot represent them.
    finite = {name: value for name, value in measured.items() if math.isfinite(value)}
    return DrivenOutcome(crash, finite, note=given.get("note", ""))


def _number(given: Mapping[str, str], name: str, where: str) -> float | None:
    """Return a cell as a number, or None if it is empty."""
    if name not in given:
        return None
    try:
        value = float(given[name])
    except ValueError:
        value = math.nan
    if math.isnan(value):
        change = "Correct the cell, or leave it empty."
        raise InputError(where, seen=repr(given[name]), expected="a number", change=change)
    return value


def _refuse(where: str, column: str, seen: str, expected: str) -> None:
    raise InputError(f"{where}, column {column}", seen=seen, expected=expected, change="Correct the row.")


def write_table(path: str | os.PathLike, runs: Iterable[Run], scenario: Scenario) -> None:
    """Write the runs to drive as a table with empty columns for the outcomes, atomically."""
    rows = [
        {"run": run.number, **scenario.with_derived(dict(zip(scenario.names, run.encounter, strict=True)))}
        for run in runs
    ]
    write_csv(path, pd.DataFrame(rows).reindex(columns=[*rows[0], "crash", *scenario.measured, "note"]))
