"""What would decide a criterion: encounters without the event, or more simulations.

How many records would decide a criterion is not computed. More records also change the weights of the laws,
and nobody knows how fast. For more simulations, the logarithm of the limited rate is treated as normal, and
they reduce the part of its variance that is from sampling.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import ndtr, ndtri, polygamma

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
from accelerated_evaluation.answer.consequences.rates import JEFFREYS, UNITS
from accelerated_evaluation.answer.ways.posterior import Posterior, log_variances
from accelerated_evaluation.base.arrays import Array

ASSURANCE = 0.8  # probability that the criterion is decided, one way or the other, by what the table promises
LARGEST = 1e4  # factor of the present number up to which an effort is searched
COLUMNS = ["criterion", "effort", "now", "needed", "chance"]


def assurance(distance: float, before: float, after: float) -> float:
    """Return the probability that a criterion will be decided.

    ``distance`` is log(limit / median), and the variance of the logarithm falls from ``before`` to ``after``.
    The mean of the later posterior is normal around the present one, with the variance that has gone
    (Spiegelhalter, Abrams and Myles 2004, chapter 6). The criterion is decided if that mean is farther from
    the limit than the one-sided 95 % quantile of the later posterior.
    """
    margin, spread = ndtri(CONFIDENCE) * np.sqrt(after), np.sqrt(max(before - after, 0.0))
    if spread == 0:
        return float(abs(distance) >= margin)
    return float(ndtr((distance - margin) / spread) + ndtr((-distance - margin) / spread))


def factor_needed(distance: float, reduced: float, kept: float) -> float:
    """Return by which factor an effort has to grow until a criterion is decided with probability `ASSURANCE`.

    The effort divides the part ``reduced`` of the variance, and leaves the part ``kept``. The result is
    infinite if no effort up to `LARGEST` times the present one suffices.
    """

    def short(log_factor: float) -> float:
        return assurance(distance, reduced + kept, reduced / np.exp(log_factor) + kept) - ASSURANCE

    steps = np.linspace(0, np.log(LARGEST), 200)
    enough = next((k for k, step in enumerate(steps) if short(step) >= 0), None)
    if enough is None:
        return np.inf
    return 1.0 if enough == 0 else float(np.exp(brentq(short, steps[enough - 1], steps[enough])))


def encounters_needed(judged: Judged) -> float:
    """Return after how many encounters without the event the criterion is met; infinite if never."""

    def short(log_encounters: float) -> float:
        return judged.met_after(np.exp(log_encounters)) - CONFIDENCE

    middle = -np.log(np.median(judged.events[judged.events > 0]))
    ends = middle - 5, middle + np.log(LARGEST)
    if short(ends[1]) < 0:
        return np.inf
    return float(np.exp(brentq(short, *ends))) if short(ends[0]) < 0 else 0.0


def variances_of(judged: Judged, member: NDArray[np.intp], sampling: float, size: int) -> dict[str, float]:
    """Return the variance of the logarithm of the limited rate by source.

    ``member`` is the candidate of each draw of the law, shape (K,), ``sampling`` the relative standard
    deviation of the sampling error, and ``size`` the number of records. What is left of the variance within
    the draws is that of the curves of the risk of injury.
    """
    logs = np.log(judged.draws)
    parts = log_variances(Posterior(np.exp(logs.mean(axis=1)), member))
    parts |= {"sampling": float(np.log1p(sampling**2))}
    parts |= {
        "rate of encounters": float(polygamma(1, size + JEFFREYS))
        if judged.criterion.per in UNITS.values()
        else 0.0
    }
    rest = logs.var(axis=1).mean() - parts["sampling"] - parts["rate of encounters"]
    is_more = judged.criterion.harm or judged.criterion.counted
    return parts | {"choice of curve, or counted crashes": max(float(rest), 0.0) if is_more else 0.0}


def deciding_table(
    judged: Judged,
    variances: Mapping[str, float],
    size: int,
    simulations: int | None,
    exposure: Mapping[str, float | None],
) -> pd.DataFrame:
    """Tabulate the efforts that would decide a criterion which is not decided; empty if it is.

    Parameters
    ----------
    judged
        Draws of the rate that the criterion limits.
    variances
        Variance of the logarithm of the rate by source, see `variances_of`.
    size, simulations
        Present number of records, and of simulations; None if the event was not sampled.
    exposure
        The ``kilometres`` and ``hours`` of the records; None if unknown.

    Returns
    -------
    pandas.DataFrame
        One row for each ``effort``: its amount ``now``; the amount ``needed``, infinite if this effort alone
        decides nothing, and NaN for records, of which it is not computed; and ``chance``. For simulations
        this is the probability that the criterion is then decided, met or not. For encounters without the
        event it is the probability that so many encounters end without it; the criterion is then met.
    """
    if not judged.is_open:
        return pd.DataFrame(columns=COLUMNS)
    # The distance at which, in the normal approximation, the criterion is met with the draws' probability.
    rows, total = [], sum(variances.values())
    distance = float(ndtri(judged.probability_met) * np.sqrt(total))
    rows.append(("records", size, np.nan, np.nan))
    if simulations is not None:
        reduced = variances["sampling"]
        factor = factor_needed(distance, reduced, total - reduced) if reduced > 0 else np.inf
        chance = ASSURANCE if np.isfinite(factor) else np.nan
        rows.append(("simulations", simulations, simulations * factor, chance))
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
    simulations: int | None,
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

    ``own`` is the posterior of the event, None if it is not known, and ``simulations`` the number of
    simulations, None if the event was not sampled. ``every`` is the posterior for encounters of all kinds per
    recorded encounter, by which rates of the event are judged if it is known. ``update`` returns a criterion
    judged after crashes in service. For the others see `judge`.

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
        found = recorded = judge(criterion, own, size, exposure, others, injured, basis)
        judged_by, whole = partial(_with_injured, criterion, own, size, exposure, injured), own
        if every is not None and not criterion.harm and not criterion.reference:
            found, whole = judge(criterion, every[0], size, exposure, basis=every[1]), every[0]
        if choices is not None and not criterion.reference and not isinstance(found, str):
            found = replace(found, choices=under_choices(judged_by, whole, choices))
        if update is not None and not isinstance(found, str):
            found = update(found)
        judged.append(found)
        if isinstance(found, str) or isinstance(recorded, str) or not np.all(recorded.draws > 0):
            continue
        other = others.get(criterion.reference)
        deviation = float(np.hypot(own.deviation, 0.0 if other is None else other.deviation))
        variances = variances_of(recorded, own.member, deviation, size)
        rest = np.log(found.draws).var() - np.log(recorded.draws).var()  # of what the records do not contain
        variances |= {"encounters that were not recorded": max(float(rest), 0.0)}
        tables.append(deciding_table(found, variances, size, simulations, exposure))
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
        elif row["effort"].endswith("the event"):
            lines.append(
                f"  after {row['needed']:,.0f} {row['effort']} it would be met; they end so with probability "
                f"{row['chance']:.2g}"
            )
        else:
            lines.append(
                f"  {row['needed']:,.0f} {row['effort']} (now {row['now']:,.0f}) would decide it with "
                f"probability {row['chance']:.2g}"
            )
    return lines
