"""Acceptance criteria: whether a rate stays below a limit, and how sure that is.

A criterion is a text such as ``1e-7 per hour``, ``1e-8 MAIS3+ per kilometre`` or ``0.5 x cc_human``. It is
judged by draws of the rate that contain every source of uncertainty that is known: parameters, choice of law,
sampling, and the rate of encounters. A verdict counts as shown only if the records support it without the
models: little of the bound is extrapolated, and the replayed records alone give the same verdict. Otherwise
it is a verdict under the models. The commands and the studies all use the verdicts of this module.
"""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from operator import itemgetter
from typing import Any, Self

import numpy as np
import pandas as pd
import scipy

from accelerated_evaluation.answer.consequences.counted_crashes import (
    HUNDRED_CAR_CRASHES,
    HUNDRED_CAR_MILES,
    KILOMETRES_PER_MILE,
    contradiction,
)
from accelerated_evaluation.answer.consequences.injuries.curves import LEVELS
from accelerated_evaluation.answer.consequences.injuries.tables import RISKS
from accelerated_evaluation.answer.consequences.rates import JEFFREYS, UNITS, Rate
from accelerated_evaluation.answer.ways.comparison import ratios
from accelerated_evaluation.answer.ways.extrapolation import ALL, RECORDED, exact_interval
from accelerated_evaluation.answer.ways.posterior import LEVELS as INTERVALS
from accelerated_evaluation.answer.ways.posterior import Posterior, summarise_bounds
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.percent import in_percent
from accelerated_evaluation.base.sections import TEXT, listed, text
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.scenarios.protocol import Scenario

CRITERIA = listed(
    [],
    TEXT,
    "Upper limits on which the answer is judged, such as 1e-7 per hour, 1e-9 per kilometre, 1e-6 per cut-in, "
    "1e-8 MAIS3+ per hour, 0.5 x counted for a share of the rate of counted crashes (or "
    "0.5 x 3 counted in 2e6 km), or 0.5 x cc_human for a share of the crash probability of another vehicle.",
    fewest=0,
    uniqueItems=True,
)
IN_SERVICE = text(
    None,
    "Crashes of the vehicle's fleet in service, in encounters of the scenario and in the vehicle's role, "
    "such as 0 counted in 3e6 km with 0.3 to 0.6 reported. `accelerated-evaluation estimate` updates the "
    "predicted rate by them. The limits are those of the share of the crashes that is counted; without them, "
    "all are.",
    type=["string", "null"],
)
CONFIDENCE = 0.95  # probability from which on a criterion counts as met, or as not met
SURE = 0.99  # probability above which the words do not state it exactly, since it depends on far tails
LITTLE = 0.1  # largest share of the upper bound beyond the records with which a verdict counts as shown
UNDECIDED, UNKNOWN = "not decided", "not known"
SHOWN = {True: "shown to be met", False: "shown not to be met"}
BY_MODELS = {True: "met under the models", False: "not met under the models"}
NO_ESTIMATE = "there is no estimate, or the replayed records contradict it"
ENCOUNTER = "encounter"
COUNTED = "counted"  # reference that stands for the cut-ins of the 100-Car study
SHARES = 5  # number of equally likely shares of reported crashes
RATES = 25  # number of equally likely values that represent the posterior of the rate of encounters
COLUMNS = ["criterion", "verdict", "encounters", "probability", "median", "lower95", "upper95", "beyond"]
COLUMNS += ["weakest_choice", "weakest_probability"]
COLUMNS += ["runs_without_event", "replayed_low95", "replayed_upper95", "reason"]
FORM = re.compile(
    r"(?P<limit>[-+.\deE]+)\s+(?:(?P<harm>(?!per\b|x\b)\S+)\s+)?(?:per\s+(?P<per>.+)|x\s+"
    r"(?:(?P<events>\d+)\s+counted\s+in\s+(?P<length>[.\deE+]+)\s+(?P<unit>km|kilometres|h|hours)"
    r"(?:\s+with\s+(?P<low>[.\d]+)\s+to\s+(?P<high>[.\d]+)\s+reported)?|(?P<reference>\S+)))",
    re.ASCII,
)


@dataclass(frozen=True)
class Counted:
    """Crashes that were counted on roads, in the same role and of the same type as those judged."""

    events: int
    exposure: float  # distance [km] or time [h] in which they were counted
    unit: str  # ``kilometres`` or ``hours``
    reported: tuple[float, float] = (1.0, 1.0)  # smallest and largest share of the crashes that is counted

    @property
    def is_possible(self) -> bool:
        """Whether there is a positive exposure, and the shares are above 0, ordered and at most 1."""
        low, high = self.reported
        return 0 < self.exposure < np.inf and 0 < low <= high <= 1

    def ratios(self, size: int, exposure: float) -> Array:
        """Return equally likely ratios of the rate of recorded encounters to the rate of crashes.

        ``size`` encounters were recorded in the distance or time ``exposure``. The rates have Jeffreys'
        prior, and the share of the reported crashes is uniform in its logarithm.
        """
        at = (np.arange(RATES) + 0.5) / RATES
        law = scipy.stats.betaprime(size + JEFFREYS, self.events + JEFFREYS, scale=self.exposure / exposure)
        low, high = self.reported
        return np.outer(law.ppf(at), low * (high / low) ** at[:: RATES // SHARES]).ravel()


@dataclass(frozen=True)
class Criterion:
    """An upper limit of a rate, or of a ratio to another vehicle or to counted crashes."""

    text: str
    limit: float
    per: str = ""  # ``encounter``, ``kilometre`` or ``hour``; empty for a ratio
    reference: str = ""  # name of the vehicle to which a ratio refers; empty for a rate
    harm: str = ""  # level of injury, such as MAIS3+; empty if the event itself is counted
    counted: Counted | None = None  # crashes to whose rate a ratio refers


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
    counted = _counted(parts, noun)
    known = 0 < limit < np.inf and (limit <= 1 or per != ENCOUNTER)  # no probability exceeds 1
    known &= counted is None or counted.is_possible
    if not known or per not in units or (parts["harm"] and parts["harm"] not in levels):
        injuries = (
            f", with a level of injury ({', '.join(levels)}) after the number if asked" if levels else ""
        )
        raise InputError(
            where,
            seen=repr(text),
            expected="a positive limit and what it refers to, for example '1e-7 per hour', "
            f"'1e-9 per kilometre', '1e-6 per {noun}' (at most 1), '0.5 x counted', "
            f"'0.5 x 3 counted in 2e6 km with 0.3 to 0.6 reported' or '0.5 x cc_human'{injuries}",
            change="Write the criterion in one of these forms.",
        )
    reference = "" if counted else parts["reference"].strip()
    return Criterion(str(text).strip(), limit, per, reference, parts["harm"], counted)


def counted_in_service(text: str | None, noun: str) -> Counted | None:
    """Return the counts of the key ``in_service``, which have the form of counts in a criterion."""
    if text is None:
        return None
    found = FORM.fullmatch(f"1 x {text.strip()}")
    counted = _counted(found.groupdict(default=""), noun) if found and found["events"] else None
    if counted is None or not counted.is_possible:
        raise InputError(
            "in_service",
            seen=repr(text),
            expected="counts such as '0 counted in 3e6 km with 0.3 to 0.6 reported'",
            change="Write them in this form, with a positive distance (km) or time (h) and shares up to 1.",
        )
    return counted


def _counted(parts: Mapping[str, str], noun: str) -> Counted | None:
    """Return the counted crashes that the parts of a text name; None if it names none, or none are known."""
    if parts.get("events"):
        unit = {"km": "kilometres", "h": "hours"}.get(parts["unit"], parts["unit"])
        try:
            length, low, high = (float(parts[name] or 1) for name in ("length", "low", "high"))
        except ValueError:
            length, low, high = np.nan, np.nan, np.nan
        return Counted(int(parts["events"]), length, unit, (low, high))
    if parts.get("reference") == COUNTED and noun == CUT_IN.noun:
        return Counted(HUNDRED_CAR_CRASHES, HUNDRED_CAR_MILES * 1e6 * KILOMETRES_PER_MILE, "kilometres")
    return None


def criteria_of(texts: Sequence[str], scenario: Scenario, where: str = "criteria") -> list[Criterion]:
    """Return the criteria that texts describe for a scenario; InputError names ``where`` they were given."""
    levels = LEVELS if scenario.name in RISKS else ()
    return [criterion_of(text, where, scenario.noun, levels) for text in texts]


@dataclass(frozen=True)
class Basis:
    """What a rate of events rests on."""

    encounters: str = ""  # the encounters whose rate it is, in words; empty if it is that of all encounters
    beyond: float = np.nan  # share of the upper bound that belongs to predicted events unlike any record
    # One-sided 95 % bounds of the rate that follow from replayed records alone, without a model of them.
    replayed: tuple[float, float] = (np.nan, np.nan)

    @classmethod
    def of(cls, extrapolation: pd.DataFrame, encounters: str = "") -> Self:
        """Return the basis of the probability of the event in an encounter, from the table `extrapolation`.

        If only a sample of the records was replayed, its rows have no number of ``recorded`` events, but the
        upper limit of the sample (`Evidence.added_to`).
        """
        if not len(extrapolation):
            return cls(encounters)
        parts = extrapolation.set_index("part")
        whole, bounds = parts.loc[ALL], parts["upper95"]
        replayed = 0.0, whole.get("replay_high95", np.nan)
        if not np.isnan(whole["recorded"]):
            count, size = int(whole["recorded"]), int(whole["records"])
            replayed = exact_interval(count, size, 2 * CONFIDENCE - 1)
        return cls(encounters, float(1 - bounds.get(RECORDED, np.nan) / bounds[ALL]), replayed)

    def of_every(self, noun: str) -> "Basis":
        """Return the basis for encounters of all kinds, of which replays of recorded ones say nothing."""
        return replace(self.times(np.nan), encounters=f"all {noun}s")

    def times(self, low: float, high: float | None = None) -> "Basis":
        """Return the basis of the rate in a unit with a number of encounters between two values."""
        return replace(self, replayed=(self.replayed[0] * low, self.replayed[1] * (high or low)))


@dataclass(frozen=True)
class Judged:
    """Draws of the rate, or of the ratio, that a criterion limits."""

    criterion: Criterion
    draws: Array  # equally likely values for each of K draws of the law, shape (K, m)
    events: Array  # probability of the event in an encounter that belongs to each value, shape (K, m)
    basis: Basis = Basis()
    # Probability that the criterion is met under other choices (`choices.choice_table`), by their names.
    choices: Mapping[str, float] = field(default_factory=dict)
    note: str = ""  # on the reference of a ratio
    # Lower bounds of the values, which are 0 where a probability is unknown; ``draws`` are then upper bounds.
    least: Array | None = None

    @property
    def probability_met(self) -> float:
        """Probability that the rate does not exceed the limit; unknown values are at their upper bounds."""
        return float(np.mean(self.draws <= self.criterion.limit))

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds of the values, shape (K, m) each."""
        return (self.draws if self.least is None else self.least), self.draws

    @property
    def probability_possible(self) -> float:
        """Probability that the rate does not exceed the limit, with unknown values at their lower bounds."""
        return float(np.mean(self.bounds[0] <= self.criterion.limit))

    @property
    def upper(self) -> float:
        """One-sided upper bound of the rate at the level `CONFIDENCE`."""
        return float(np.quantile(self.draws, CONFIDENCE))

    @property
    def lower(self) -> float:
        """One-sided lower bound of the rate at the level `CONFIDENCE`."""
        return float(np.quantile(self.bounds[0], 1 - CONFIDENCE))

    @property
    def verdict(self) -> str:
        """The verdict: one of `SHOWN` or `BY_MODELS`, with a probability of at least 95 %, or `UNDECIDED`.

        The criterion has to be decided in the same way under all choices.
        """
        is_met, (low, high) = self.probability_met >= CONFIDENCE, self.basis.replayed
        if self.is_open:
            return UNDECIDED
        if self.weakest[1] < CONFIDENCE if is_met else self.weakest[1] > 1 - CONFIDENCE:
            return UNDECIDED
        agrees = high <= self.criterion.limit if is_met else low > self.criterion.limit
        return (SHOWN if agrees and self.basis.beyond <= LITTLE else BY_MODELS)[is_met]

    @property
    def is_open(self) -> bool:
        """Whether the criterion is not decided under the choices of the answer."""
        return self.probability_met < CONFIDENCE and self.probability_possible > 1 - CONFIDENCE

    @property
    def weakest(self) -> tuple[str, float]:
        """Choice under which the verdict of the answer is least probable, and the probability that it is met.

        If the answer does not decide the criterion, or is itself the weakest, the name is empty.
        """
        if self.is_open:
            return "", self.probability_met
        least = min if self.probability_met >= CONFIDENCE else max
        return least({"": self.probability_met, **self.choices}.items(), key=lambda item: item[1])

    def row(self) -> dict[str, Any]:
        """Return the row of `criteria_table`."""
        row: dict[str, Any] = {"criterion": self.criterion.text, "verdict": self.verdict}
        row |= {"encounters": self.basis.encounters, "probability": self.probability_met}
        row |= {"median": summarise_bounds(*map(np.ravel, self.bounds))["median"]}
        row |= {
            "lower95": self.lower,
            "upper95": self.upper,
            "beyond": self.basis.beyond,
            "reason": self.note,
        }
        if self.criterion.per == ENCOUNTER and not self.criterion.harm and 0 < self.upper < 1:
            row["runs_without_event"] = crude_runs(self.upper)
        row |= dict(zip(("weakest_choice", "weakest_probability"), self.weakest, strict=True))
        return row | dict(zip(("replayed_low95", "replayed_upper95"), self.basis.replayed, strict=True))

    def met_after(self, encounters: float) -> float:
        """Return the probability that the criterion is met if that many encounters end without the event."""
        logs = -self.events * encounters
        weights = np.exp(logs - logs.max())
        return float((weights * (self.draws <= self.criterion.limit)).sum() / weights.sum())

    def chance_without_event(self, encounters: float) -> float:
        """Return the probability that so many further encounters end without the event."""
        return float(np.exp(-self.events * encounters).mean())


def exit_status(verdicts: Iterable[str]) -> int:
    """Return the exit status of a command that judges criteria: 0 if all of them are met, otherwise 1."""
    return int(any(verdict not in (SHOWN[True], BY_MODELS[True]) for verdict in verdicts))


def judge(
    criterion: Criterion,
    posterior: Posterior,
    size: int,
    exposure: Mapping[str, float | None],
    others: Mapping[str, Posterior | None] | None = None,
    injured: Mapping[str, Array] | None = None,
    basis: Basis = Basis(),
) -> Judged | str:
    """Return the draws of the rate that a criterion limits, or the reason why it cannot be computed.

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
    basis
        What the probability of the event rests on. Replays say nothing about ratios and injuries.
    """

    def judged(values: Array, events: Array, basis: Basis, note: str = "") -> Judged:
        most = _flat(values)
        least = np.where(np.reshape(posterior.unknown, (-1, 1)), 0.0, most)
        return Judged(criterion, most, _flat(events), basis, note=note, least=least)

    if criterion.reference:
        other = (others or {}).get(criterion.reference)
        if other is None:
            return f"the vehicle {criterion.reference} was not compared"
        if not np.all(other.least > 0):
            return f"the vehicle {criterion.reference} has no event, or hardly any, under a draw of the law"
        values = ratios(posterior, other)[-1]
        events = posterior.probabilities[:, None] / posterior.noise
        events = np.broadcast_to(events[:, :, None], values.shape)
        note, kilometres = "", exposure.get("kilometres")
        if kilometres is not None and basis.encounters == CUT_IN.scope:
            note = contradiction(other.interval(0.95)[0], size / kilometres)
        note = f"the reference is {note}" if note else ""
        return judged(values, events, basis.times(np.nan), note)
    values = own = posterior.most
    if criterion.harm:
        if criterion.harm not in (injured or {}):
            return f"injuries of the level {criterion.harm} are not predicted"
        basis = basis.times(np.nan)
        numbers = injured[criterion.harm] / posterior.probabilities[:, None]  # injured persons per event
        values = _flat(own[:, :, None] * np.nan_to_num(numbers)[:, None, :])
        own = _flat(np.broadcast_to(own[:, :, None], (*own.shape, numbers.shape[1])))
    if criterion.per == ENCOUNTER:
        return judged(values, own, basis)
    counted = criterion.counted
    name = counted.unit if counted else next(name for name, unit in UNITS.items() if unit == criterion.per)
    if (length := exposure.get(name)) is None:
        return f"it is not stated in how many {name} the records were made"
    if counted:
        rates = counted.ratios(size, length)
        events = np.broadcast_to(own[:, :, None], (*own.shape, rates.size))
        return judged(values[:, :, None] * rates, events, basis.times(np.nan))
    law = Rate(size, length).law
    rates = law.ppf((np.arange(RATES) + 0.5) / RATES)
    events = np.broadcast_to(own[:, :, None], (*own.shape, RATES))
    basis = basis.times(*law.ppf([1 - CONFIDENCE, CONFIDENCE]))
    return judged(values[:, :, None] * rates, events, basis)


def under(posterior: Posterior, answer: Mapping[str, float], other: Mapping[str, float]) -> Posterior:
    """Return a posterior as it would be under another choice, from two rows of `choices.choice_table`.

    ``answer`` is the row of the answer. Each draw is multiplied by the ratio of the quantiles of the two rows
    at its rank, which is interpolated between the stated quantiles in logarithms and constant beyond them.
    """
    ends = [(f"low{100 * each:.0f}", (1 - each) / 2) for each in INTERVALS]
    ends += [("median", 0.5)] + [(f"high{100 * each:.0f}", (1 + each) / 2) for each in INTERVALS]
    names, at = zip(*sorted(ends, key=itemgetter(1)), strict=True)
    logs = [np.log(other[name] / answer[name]) for name in names]
    values = posterior.probabilities
    rank = (scipy.stats.rankdata(values) - 0.5) / values.size
    return replace(posterior, probabilities=values * np.exp(np.interp(rank, at, logs)))


def under_choices(
    judged_by: Callable[[Posterior], "Judged | str"], posterior: Posterior, choices: pd.DataFrame
) -> dict[str, float]:
    """Return the probability that a criterion is met under each other choice of a table, by its name.

    ``judged_by`` judges the criterion by a posterior. The first row of the table is the answer. Rows without
    positive quantiles are left out.
    """
    answer, *others = choices.to_dict("records")
    met = {}
    for row in others:
        found = judged_by(under(posterior, answer, row)) if min(row["low95"], answer["low95"]) > 0 else ""
        if not isinstance(found, str):
            met[row["choice"]] = found.probability_met
    return met


def _flat(values: Array) -> Array:
    return values.reshape(len(values), -1)


def criteria_table(criteria: Sequence[Criterion], judged: Sequence[Judged | str]) -> pd.DataFrame:
    """Tabulate the verdicts on criteria, one row each.

    The columns are the ``criterion``; its ``verdict``; the ``encounters`` whose rate is judged, empty if
    those of all kinds; ``probability``, that the criterion is met; the median and the one-sided 95 % bounds
    ``lower95`` and ``upper95`` of the rate; ``beyond``, the share of the upper bound that rests on predicted
    events unlike any record (`extrapolation`); ``weakest_choice``, the other choice of the statistician under
    which the verdict is least probable, empty if it is the answer itself, and ``weakest_probability``, that
    the criterion is met under it; ``runs_without_event``, the number of encounters without the event that
    would show the same upper bound without a model, for rates per encounter only;
    ``replayed_low95`` and ``replayed_upper95``, the exact one-sided bounds that follow from the replayed
    records without a model; and the ``reason`` why a verdict is not known, or why its reference is doubtful.
    """
    rows = [
        {"criterion": criterion.text, "verdict": UNKNOWN, "reason": own}
        if isinstance(own, str)
        else own.row()
        for criterion, own in zip(criteria, judged, strict=True)
    ]
    return pd.DataFrame(rows, columns=COLUMNS)


def crude_runs(probability: float) -> float:
    """Return how many runs without an event show that a probability is smaller than this, at 95 %.

    With n independent runs without an event, the exact upper bound p solves (1 - p)^n = 0.05.
    """
    return float(np.log(1 - CONFIDENCE) / np.log1p(-probability))


def criterion_in_words(row: Mapping[str, Any]) -> str:
    """Return a row of `criteria_table` as a line of text."""
    if row["verdict"] == UNKNOWN:
        return f"criterion {row['criterion']}: not known, because {row['reason']}"
    verdict = "not shown, and not refuted" if row["verdict"] == UNDECIDED else row["verdict"]
    scope = f", for {row['encounters']}" if row["encounters"] else ""
    met = row["probability"]
    met = "above 0.99" if met > SURE else "below 0.01" if met < 1 - SURE else f"{met:.2g}"
    parts = [f"met with probability {met}"]
    if choice := row["weakest_choice"]:
        parts.append(f"with probability {row['weakest_probability']:.2g} under the choice '{choice}'")
    parts += [f"one-sided 95% upper bound {row['upper95']:.2g}"]
    if not np.isnan(row["beyond"]):
        parts.append(f"{in_percent(row['beyond'])} of it extrapolated beyond the records")
    if not np.isnan(row["replayed_upper95"]):
        parts.append(f"replays of records alone allow {row['replayed_upper95']:.2g}")
    parts += [row["reason"]] if row["reason"] else []
    return f"criterion {row['criterion']}: {verdict}{scope} ({'; '.join(parts)})"
