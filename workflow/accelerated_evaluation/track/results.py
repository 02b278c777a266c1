"""Tables of outcomes from the track with their checks, and the status of a campaign."""

import math
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from fewruns.combining import boundary
from scipy.special import stdtrit

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.numerals import number_in
from accelerated_evaluation.base.tables import names_in_words, read_csv, require_file
from accelerated_evaluation.methods import Estimate, Stopping, normal_reach
from accelerated_evaluation.methods.surrogate import chance_in_words, unseen_in_words
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
MOST_BATCHES = 10_000  # largest number of further batches that a forecast considers


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
    for name in ("run", "crash"):
        if name not in table:
            seen = f"only the columns {names_in_words(list(table.columns), name)}"
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
    scenario = campaign.scenario
    for name, asked in scenario.with_derived(dict(zip(scenario.names, run.encounter, strict=True))).items():
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
    rules = scenario.rules.reported(crash, dict(zip(scenario.names, run.encounter, strict=True)))
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
        value = number_in(given[name])
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
    rows = []
    for run in runs:
        columns = scenario.with_derived(dict(zip(scenario.names, run.encounter, strict=True)))
        # A sum of rounded numbers can have further digits, such as 15.700000000000001.
        rows.append({"run": run.number, **{name: round(value, 9) for name, value in columns.items()}})
    write_csv(path, pd.DataFrame(rows).reindex(columns=[*rows[0], "crash", *scenario.measured, "note"]))


@dataclass(frozen=True)
class Status:
    """The status of a campaign."""

    asked: int  # number of requested runs
    reported: int  # number of those whose outcome has been reported
    used: int  # number of runs in complete batches, on which the estimate is based
    # Number of runs that the sampler chose beyond the limits, which need not be driven. They are not included
    # in the other numbers.
    spared: int
    estimate: Estimate
    # Predicted number of runs that are still needed; 0 if the campaign may stop, None if the number cannot be
    # predicted.
    needed: int | None

    @property
    def may_stop(self) -> bool:
        """Whether the estimate has converged, so that the campaign may stop."""
        return self.estimate.converged


def status_of(campaign: Campaign) -> Status:
    """Return the status of a campaign; its estimate does not include the runs of an incomplete batch."""
    to_drive = [run for run in campaign.runs if run.outcome != BEYOND]
    reported = sum(run.outcome is not None for run in to_drive)
    # The last batch is open if one of its runs is outstanding.
    used = sum(run.batch < campaign.batches or not campaign.outstanding for run in to_drive)
    spared, estimate = len(campaign.runs) - len(to_drive), campaign.estimate()
    needed: int | None = 0
    if not estimate.converged:
        needed = forecast(estimate, campaign.sampler.batch_size, campaign.goal)
        sampler = campaign.sampler
        if needed is not None and sampler.is_narrow(campaign.goal):
            needed = max(needed, sampler.repeats_wanted(certify=True))
        needed = None if needed is None or sampler.progress.may_lapse else max(needed - (reported - used), 0)
    return Status(len(to_drive), reported, used, spared, estimate, needed)


def forecast(found: Estimate, batch_size: int, goal: Stopping) -> int | None:
    """Predict how many more runs are needed, if further batches are similar to those so far.

    The squared relative error of the mean of b batches is proportional to 1 / b, and Student's quantile
    decreases with b. The result is the smallest number of further batches with which the half-width meets the
    goal, times the number of runs in a batch. The result is None if there is no estimate yet, or if more than
    `MOST_BATCHES` batches would be needed.
    """
    batches = found.diagnostics["batches"]
    if not (found.probability > 0 and batches >= 2):
        return None
    more = np.arange(1, MOST_BATCHES + 1)
    error = max(found.diagnostics["observed_error"], found.diagnostics["predicted_error"])
    reach = stdtrit(batches + more - 1, 1 - goal.alpha / 2) * error * np.sqrt(batches / (batches + more))
    if goal.anytime:
        reach *= boundary(goal.alpha) / normal_reach(goal.alpha)
    # The half-width of P / (1 + reach) to P / (1 - reach) is P reach / (1 - reach^2).
    enough = np.flatnonzero(reach <= goal.beta * (1 - reach**2))
    return int(more[enough[0]]) * batch_size if enough.size else None


def status_in_words(campaign: Campaign, status: Status) -> str:
    """Return the status of a campaign, from `status_of`, as text of several lines."""
    found, goal, deterministic = status.estimate, campaign.goal, campaign.sampler.deterministic
    event = campaign.scenario.event_in_words(campaign.event)
    lines = [
        f"event       {event}, under the law {campaign.description!r}",
        f"runs        {status.asked} requested, {status.reported} reported, "
        f"{status.asked - status.reported} outstanding; "
        f"{found.events} with the event in the {status.used} runs of complete batches",
        f"estimate    {_estimate(found, campaign.scenario.noun)}",
        f"unseen      {unseen_in_words(found.probability, found.diagnostics)}",
        *(f"{'chance':<12}{line}" for line in chance_in_words(found.diagnostics, deterministic).splitlines()),
        *_about_limits(campaign, status),
        f"goal        half-width at most {goal.beta:.0%} of the estimate, confidence {1 - goal.alpha:.0%}"
        + (", at all checks together" if goal.anytime else ""),
        f"may stop    {_advice(status)}",
    ]
    return "\n".join(lines)


def _about_limits(campaign: Campaign, status: Status) -> list[str]:
    """Return lines of text about the limits and the probability beyond them, which the estimate excludes."""
    if not campaign.limits:
        return []
    high = min(status.estimate.high + campaign.beyond, 1.0)
    end = "" if math.isnan(high) else f"; if each of them had the event, the interval would end at {high:.3g}"
    return [
        f"limits      {campaign.limits.in_words}; the estimate is of the event within; "
        f"runs beyond, not to be driven: {status.spared}",
        f"beyond      {campaign.beyond:.2g} of all cut-ins of the law{end}",
    ]


def _estimate(found: Estimate, noun: str) -> str:
    confidence = f"{1 - found.alpha:.0%}"
    if math.isnan(found.probability):
        return "none yet: events were observed, but their region is not known well enough"
    if found.events == 0:
        return f"0, no event was observed; at most {found.high:.2g} with {confidence} confidence"
    half = (found.high - found.low) / 2 / found.probability
    interval = f"{confidence} interval {found.low:.3g} to {found.high:.3g}"
    return f"{found.probability:.3g} per {noun}, {interval} (half-width {half:.0%} of the estimate)"


def _advice(status: Status) -> str:
    if status.may_stop:
        found = status.estimate.diagnostics
        rare = " and the car has no rare lapses" if found["repeats"] and not found["differed"] else ""
        return f"yes, if there is no unseen part{rare} (no recorded encounter was driven, as a check)"
    if "unseen_lapses" in status.estimate.diagnostics:
        return "no; these runs cannot exclude rare lapses, see the lines above"
    if status.estimate.diagnostics["drift"]:
        return "no; the vehicle changes from run to run, so that there is no single probability"
    if status.estimate.diagnostics["counted"]:
        return "no; more draws of the law make the interval narrower, by the square root of their number"
    if status.needed is None:
        return "no; the number of runs still needed cannot be predicted before there is an estimate"
    return f"no; about {status.needed} more runs are likely needed"
