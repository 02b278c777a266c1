"""Acceptance criteria: whether a rate stays below a limit, and how sure that is.

A criterion is a text such as ``1e-7 per hour``, ``1e-8 MAIS3+ per kilometre`` or ``0.5 x cc_human``. It is
judged by draws of the rate that contain every source of uncertainty that is known: parameters, choice of law,
sampling, and the rate of encounters.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from accelerated_evaluation.answer.comparison import ratios
from accelerated_evaluation.answer.extrapolation import ALL, RECORDED, exact_interval
from accelerated_evaluation.answer.injuries.curves import LEVELS
from accelerated_evaluation.answer.posterior import Posterior
from accelerated_evaluation.answer.rates import UNITS, Rate
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.percent import in_percent
from accelerated_evaluation.base.sections import TEXT, listed
from accelerated_evaluation.scenarios.protocol import Scenario

CRITERIA = listed(
    [],
    TEXT,
    "Upper limits on which the answer is judged, such as 1e-7 per hour, 1e-9 per kilometre, 1e-6 per cut-in, "
    "1e-8 MAIS3+ per hour, or 0.5 x cc_human for a share of the crash probability of another vehicle.",
    fewest=0,
    uniqueItems=True,
)
CONFIDENCE = 0.95  # probability from which on a criterion counts as met, or as not met
MET, NOT_MET, UNDECIDED = "met", "not met", "not decided"
ENCOUNTER = "encounter"
RATES = 25  # number of equally likely values that represent the posterior of the rate of encounters
FORM = re.compile(
    r"(?P<limit>[-+.\deE]+)\s+(?:(?P<harm>(?!per\b|x\b)\S+)\s+)?(?:per\s+(?P<per>.+)|x\s+(?P<reference>\S+))",
    re.ASCII,
)


@dataclass(frozen=True)
class Criterion:
    """An upper limit of a rate, or of a ratio to another vehicle."""

    text: str
    limit: float
    per: str = ""  # ``encounter``, ``kilometre`` or ``hour``; empty for a ratio
    reference: str = ""  # name of the vehicle to which a ratio refers; empty for a rate
    harm: str = ""  # level of injury, such as MAIS3+; empty if the event itself is counted


def criterion_of(text: str, where: str, noun: str, levels: Sequence[str] = ()) -> Criterion:
    """Return the criterion that a text describes; InputError if it has another form.

    ``noun`` is the name of one encounter of the scenario, and ``levels`` are the known levels of injury.
    """
    found = FORM.fullmatch(str(text).strip())
    parts = found.groupdict(default="") if found else {}
    per = {noun: ENCOUNTER, "km": "kilometre", "h": "hour"}.get(parts.get("per", ""), parts.get("per", ""))
    try:
        limit = float(parts.get("limit", ""))
    except ValueError:
        limit = np.nan
    units = {ENCOUNTER, *UNITS.values(), ""}
    known = 0 < limit < np.inf and (limit <= 1 or per != ENCOUNTER)  # no probability exceeds 1
    if not known or per not in units or (parts["harm"] and parts["harm"] not in levels):
        injuries = (
            f", with a level of injury ({', '.join(levels)}) after the number if asked" if levels else ""
        )
        raise InputError(
            where,
            seen=repr(text),
            expected="a positive limit and what it refers to, for example '1e-7 per hour', "
            f"'1e-9 per kilometre', '1e-6 per {noun}' (at most 1) or '0.5 x cc_human'{injuries}",
            change="Write the criterion in one of these forms.",
        )
    return Criterion(str(text).strip(), limit, per, parts["reference"].strip(), parts["harm"])


def criteria_of(texts: Sequence[str], scenario: Scenario, where: str = "criteria") -> list[Criterion]:
    """Return the criteria that texts describe for a scenario; InputError names ``where`` they were given."""
    levels = LEVELS if scenario.has_injuries else ()
    return [criterion_of(text, where, scenario.noun, levels) for text in texts]


@dataclass(frozen=True)
class Judged:
    """Draws of the rate, or of the ratio, that a criterion limits."""

    criterion: Criterion
    draws: Array  # equally likely values for each of K draws of the law, shape (K, m)
    events: Array  # probability of the event in an encounter that belongs to each value, shape (K, m)

    @property
    def probability_met(self) -> float:
        """Probability that the rate does not exceed the limit."""
        return float(np.mean(self.draws <= self.criterion.limit))

    @property
    def upper(self) -> float:
        """One-sided upper bound of the rate at the level `CONFIDENCE`."""
        return float(np.quantile(self.draws, CONFIDENCE))

    @property
    def lower(self) -> float:
        """One-sided lower bound of the rate at the level `CONFIDENCE`."""
        return float(np.quantile(self.draws, 1 - CONFIDENCE))

    @property
    def verdict(self) -> str:
        """The verdict: `MET`, `NOT_MET` or `UNDECIDED`; the first two have a probability of at least 95 %."""
        return verdict_of(self.probability_met)

    def met_after(self, encounters: float) -> float:
        """Return the probability that the criterion is met if that many encounters end without the event."""
        logs = -self.events * encounters
        weights = np.exp(logs - logs.max())
        return float((weights * (self.draws <= self.criterion.limit)).sum() / weights.sum())

    def chance_without_event(self, encounters: float) -> float:
        """Return the probability that so many further encounters end without the event."""
        return float(np.exp(-self.events * encounters).mean())


def verdict_of(probability: float) -> str:
    """Return the verdict on a criterion that is met with a given probability."""
    if probability >= CONFIDENCE:
        return MET
    return NOT_MET if probability <= 1 - CONFIDENCE else UNDECIDED


def judge(
    criterion: Criterion,
    posterior: Posterior,
    size: int,
    exposure: Mapping[str, float | None],
    others: Mapping[str, Posterior | None] | None = None,
    injured: Mapping[str, Array] | None = None,
) -> Judged | None:
    """Return the draws of the rate that a criterion limits; None if the rate cannot be computed.

    Parameters
    ----------
    criterion
        The limit.
    posterior
        Probability of the event in an encounter, for K draws of the law.
    size
        Number of recorded encounters, for rates per kilometre and hour.
    exposure
        The ``kilometres`` and ``hours`` in which they were recorded; None if unknown.
    others
        Posteriors of reference vehicles under the same draws of the law.
    injured
        Expected number of injured persons in an encounter by level, arrays of shape (K, curves).
    """
    if criterion.reference:
        other = (others or {}).get(criterion.reference)
        if other is None or not np.all(other.probabilities > 0):
            return None
        values = ratios(posterior, other)[-1]
        events = posterior.probabilities[:, None] / posterior.noise
        return Judged(criterion, _flat(values), _flat(np.broadcast_to(events[:, :, None], values.shape)))
    values = own = posterior.with_sampling + posterior.unseen_lapses
    if criterion.harm:
        if criterion.harm not in (injured or {}):
            return None
        numbers = injured[criterion.harm] / posterior.probabilities[:, None]  # injured persons per event
        values = _flat(own[:, :, None] * np.nan_to_num(numbers)[:, None, :])
        own = _flat(np.broadcast_to(own[:, :, None], (*own.shape, numbers.shape[1])))
    if criterion.per == ENCOUNTER:
        return Judged(criterion, values, own)
    length = {unit: exposure.get(name) for name, unit in UNITS.items()}[criterion.per]
    if length is None:
        return None
    rates = Rate(size, length).law.ppf((np.arange(RATES) + 0.5) / RATES)
    events = np.broadcast_to(own[:, :, None], (*own.shape, RATES))
    return Judged(criterion, _flat(values[:, :, None] * rates), _flat(events))


def _flat(values: Array) -> Array:
    return values.reshape(len(values), -1)


def criteria_table(
    criteria: Sequence[Criterion], judged: Sequence[Judged | None], extrapolation: pd.DataFrame
) -> pd.DataFrame:
    """Tabulate the verdicts on criteria, one row each.

    The columns are the ``criterion``; its ``verdict``; ``probability``, that the criterion is met; the median
    and the one-sided 95 % bounds ``lower95`` and ``upper95`` of the rate; ``beyond``, the share of the upper
    bound that rests on predicted events unlike any record (`extrapolation`); and ``runs_without_event``, the
    number of encounters without the event that would show the same upper bound without a model. The last is
    known for rates per encounter only, and so is ``replayed_upper95``, the exact bound that follows from the
    replayed records without a model (`exact_interval`).
    """
    bounds = extrapolation.set_index("part")["upper95"] if len(extrapolation) else pd.Series(dtype=float)
    every = extrapolation.set_index("part").loc[ALL] if len(extrapolation) else {"recorded": np.nan}
    beyond = 1 - bounds.get(RECORDED, np.nan) / bounds.get(ALL, np.nan)
    rows = []
    for criterion, own in zip(criteria, judged, strict=True):
        row = {"criterion": criterion.text, "verdict": "not known"}
        if own is not None:
            plain = criterion.per == ENCOUNTER and not criterion.harm
            row |= {
                "verdict": own.verdict,
                "probability": own.probability_met,
                "median": float(np.median(own.draws)),
                "lower95": own.lower,
                "upper95": own.upper,
                "beyond": beyond,
            }
            if plain and 0 < own.upper < 1:
                row["runs_without_event"] = crude_runs(own.upper)
            if plain and not np.isnan(every["recorded"]):
                row["replayed_upper95"] = exact_interval(
                    int(every["recorded"]), int(every["records"]), 2 * CONFIDENCE - 1
                )[1]
        rows.append(row)
    columns = ["criterion", "verdict", "probability", "median", "lower95", "upper95", "beyond"]
    return pd.DataFrame(rows, columns=[*columns, "runs_without_event", "replayed_upper95"])


def crude_runs(probability: float) -> float:
    """Return how many runs without an event show that a probability is smaller than this, at 95 %.

    With n independent runs without an event, the exact upper bound p solves (1 - p)^n = 0.05.
    """
    return float(np.log(1 - CONFIDENCE) / np.log1p(-probability))


def _lacking(text: str) -> str:
    """Return what is missing to judge a criterion."""
    parts = FORM.fullmatch(text).groupdict(default="")
    if parts["reference"]:
        return f"the vehicle {parts['reference']} was not compared, or has no event under a draw of the law"
    exposure = "it is not stated in how many kilometres or hours the records were made"
    return f"{exposure}, or injuries are not predicted" if parts["harm"] else exposure


def criterion_in_words(row: Mapping[str, object]) -> str:
    """Return a row of `criteria_table` as a line of text."""
    if row["verdict"] == "not known":
        return f"criterion {row['criterion']}: not known, because {_lacking(str(row['criterion']))}"
    words = {
        MET: "shown to be met",
        NOT_MET: "shown not to be met",
        UNDECIDED: "not shown, and not refuted",
    }
    beyond = row["beyond"]
    rests = (
        "" if np.isnan(beyond) else f"; {in_percent(beyond)} of this bound is extrapolated beyond the records"
    )
    return (
        f"criterion {row['criterion']}: {words[row['verdict']]} (met with probability "
        f"{row['probability']:.2g}; one-sided 95% upper bound {row['upper95']:.2g}{rests})"
    )
