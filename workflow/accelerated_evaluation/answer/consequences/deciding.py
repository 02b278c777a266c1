"""What would decide a criterion: encounters without the event.

How many records would decide a criterion is not computed. More records also change the weights of the laws,
and nobody knows how fast. More simulations decide none: they would have to remove two thirds of the variance
of the logarithm of the rate, and an estimate ends when their part is about a tenth.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd
from scipy.optimize import brentq

from accelerated_evaluation.answer.consequences.criterion import (
    CONFIDENCE,
    ENCOUNTER,
    NO_ESTIMATE,
    Basis,
    Criterion,
    Judged,
    criteria_table,
    criterion_in_words,
    judge,
    under_choices,
)
from accelerated_evaluation.answer.consequences.rates import UNITS
from accelerated_evaluation.answer.ways.posterior import Posterior
from accelerated_evaluation.base.arrays import Array

LARGEST = 1e4  # multiple of the typical number of encounters per event up to which a number is searched
COLUMNS = ["criterion", "effort", "now", "needed", "chance"]


def encounters_needed(judged: Judged) -> float:
    """Return after how many encounters without the event the criterion is met; infinite if never."""

    def short(log_encounters: float) -> float:
        return judged.met_after(np.exp(log_encounters)) - CONFIDENCE

    middle = -np.log(np.median(judged.events[judged.events > 0]))
    ends = middle - 5, middle + np.log(LARGEST)
    if short(ends[1]) < 0:
        return np.inf
    return float(np.exp(brentq(short, *ends))) if short(ends[0]) < 0 else 0.0


def deciding_table(judged: Judged, size: int, exposure: Mapping[str, float | None]) -> pd.DataFrame:
    """Tabulate the efforts that would decide a criterion which is not decided; empty if it is.

    Parameters
    ----------
    judged
        Draws of the rate that the criterion limits.
    size
        Number of records.
    exposure
        The ``kilometres`` and ``hours`` of the records; None if unknown.

    Returns
    -------
    pandas.DataFrame
        One row for each ``effort``: its amount ``now``; the amount ``needed``, infinite if this effort alone
        decides nothing, and NaN for records, of which it is not computed; and ``chance``, the probability
        that so many encounters end without the event. The criterion is then met under the choices of the
        answer.
    """
    if not judged.is_open:
        return pd.DataFrame(columns=COLUMNS)
    rows = [("records", float(size), np.nan, np.nan)]
    free = encounters_needed(judged)
    chance = judged.chance_without_event(free) if np.isfinite(free) else np.nan
    per: dict[str, Callable[[float], float]] = {f"{ENCOUNTER}s without the event": float}
    per |= {
        f"{name} without the event": (lambda n, length=length: n * length / size)
        for name in UNITS
        if (length := exposure.get(name)) is not None
    }
    rows += [(effort, 0.0, amount(free), chance) for effort, amount in per.items()]
    return pd.DataFrame(rows, columns=COLUMNS[1:]).assign(criterion=judged.criterion.text)[COLUMNS]


def criteria_tables(
    criteria: Sequence[Criterion],
    own: Posterior | None,
    basis: Basis,
    size: int,
    exposure: Mapping[str, float | None],
    others: Mapping[str, Posterior | None],
    injured: Mapping[str, Array],
    every: tuple[Posterior, Basis] | None = None,
    choices: pd.DataFrame | None = None,
    update: Callable[[Judged], Judged] | None = None,
) -> dict[str, pd.DataFrame]:
    """Return the tables ``criteria`` (`criteria_table`) and ``deciding`` (`deciding_table`) of an answer.

    ``own`` is the posterior of the event, None if it is not known. ``every`` is the posterior for encounters
    of all kinds per recorded encounter, by which rates of the event are judged if it is known. ``update``
    returns a criterion judged after crashes in service. For the others see `judge`.

    With the table ``choices`` (`choices.choice_table`), each criterion but a ratio is also judged under every
    other choice. The number of injured persons in a crash, and the ratio of the crashes of all encounters to
    the recorded ones, are taken to be the same under all choices.
    """
    judged: list[Judged | str] = []
    tables = [pd.DataFrame(columns=COLUMNS)]
    for criterion in criteria:
        if own is None:
            judged.append(NO_ESTIMATE)
            continue
        found = judge(criterion, own, size, exposure, others, injured, basis)
        judged_by, whole = partial(_with_injured, criterion, own, size, exposure, injured), own
        if every is not None and not criterion.harm and not criterion.reference:
            found, whole = judge(criterion, every[0], size, exposure, basis=every[1]), every[0]
        if choices is not None and not criterion.reference and not isinstance(found, str):
            found = replace(found, choices=under_choices(judged_by, whole, choices))
        if update is not None and not isinstance(found, str):
            found = update(found)
        judged.append(found)
        if not isinstance(found, str) and np.all(found.draws > 0):
            tables.append(deciding_table(found, size, exposure))
    deciding = pd.concat([table for table in tables if len(table)] or tables, ignore_index=True)
    return {"criteria": criteria_table(criteria, judged), "deciding": deciding}


def _with_injured(
    criterion: Criterion,
    own: Posterior,
    size: int,
    exposure: Mapping[str, float | None],
    injured: Mapping[str, Array],
    other: Posterior,
) -> Judged | str:
    """Judge a criterion by another posterior, with as many injured persons in an event as before."""
    scaled = {}
    if criterion.harm:
        ratio = np.nan_to_num(other.probabilities / own.probabilities)[:, None]
        scaled = {level: numbers * ratio for level, numbers in injured.items()}
    return judge(criterion, other, size, exposure, injured=scaled)


def criteria_in_words(tables: Mapping[str, pd.DataFrame]) -> list[str]:
    """Return the tables ``criteria`` and ``deciding`` as lines of text."""
    lines, deciding = [], tables["deciding"]
    for row in tables["criteria"].to_dict("records"):
        lines.append(criterion_in_words(row))
        lines += _efforts_in_words(deciding[deciding["criterion"] == row["criterion"]])
    return lines


def _efforts_in_words(table: pd.DataFrame) -> list[str]:
    lines = []
    for row in table.to_dict("records"):
        if np.isnan(row["needed"]):
            lines.append(f"  {row['effort']}: the number that would decide it is not computed")
        elif not np.isfinite(row["needed"]):
            lines.append(f"  {row['effort']}: no number would decide this criterion by itself")
        else:
            lines.append(
                f"  after {row['needed']:,.0f} {row['effort']} it would be met under the choices of the "
                f"answer; they end so with probability {row['chance']:.2g}"
            )
    return lines
