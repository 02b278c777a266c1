"""Compare the predicted crash rates of vehicles with crashes that were counted on roads.

The predictions are crashes of cut-ins whose gap closes, per distance: the crash probability of a cut-in times
the number of such cut-ins in a kilometre of the records. The counts come from the 100-Car Naturalistic
Driving Study, in which ordinary drivers were recorded for about two million miles, and from published rates.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import scipy

from accelerated_evaluation.answer.candidates.fitted_records import FittedRecords
from accelerated_evaluation.answer.ways.posterior import Posterior
from accelerated_evaluation.base.errors import InputError, readable

KILOMETRES_PER_MILE = 1.609344
HUNDRED_CAR = "100-Car"
HUNDRED_CAR_MILES = 2.0  # [million miles], Neale and others 2005, paper 05-0400, abstract
HUNDRED_CAR_CRASHES = 0  # in which the subject struck a car that had cut in in front of it (`STRUCK`)
HUNDRED_CAR_MOST = 1  # crashes by the definition of a cut-in that includes the most (`LANE_CHANGE`)
LEVEL = 0.95  # confidence level of all limits
SIGNIFICANT = 0.05  # probability below which a count contradicts a prediction
SCENARIO = "cut_in"  # whose crashes were counted
# Near-crashes of cut-ins in SHRP 2 that a driver model of UN R157 replayed, and its crashes: Olleja, Markkula
# and Bärgman 2024, arXiv 2406.09493, abstract.
REPLAYED, CRASHED = 38, 3
COLUMNS = {0: "event", 4: "severity", 9: "incident", 12: "precipitating_event", 13: "evasive_manoeuvre"}
SEVERITIES = {"Crash": "crash", "Near-Crash": "near-crash"}

CUT_IN = "cut-in in front of the subject"
STRUCK = "cut-in in front of the subject, rear-end conflict"
LANE_CHANGE = "any lane change of another vehicle"
SLOWED = "lead vehicle that slowed or stopped, struck from behind"

OUTPUT = [*("who", "kind", "what", "million_miles", "count", "per_million_miles", "low95", "high95")]
OUTPUT += ["in_hundred_car", "probability_of_so_few", "verdict", "comparable", "reference"]


def read_events(path: str | Path) -> pd.DataFrame:
    """Read the event table of the 100-Car study (``data/crash_counts/README.md``), a row for each event.

    InputError is raised if the file cannot be read, or is not this table.
    """
    expected = "the event table of the 100-Car study, as data/crash_counts/README.md describes it"
    with readable(str(path), expected, "Restore the file from the repository.", (OSError, ValueError)):
        table = pd.read_csv(path, sep="\t", header=None, encoding="latin-1", usecols=list(COLUMNS), dtype=str)
    events = table.rename(columns=COLUMNS)
    if other := set(events["severity"].unique()) - set(SEVERITIES):
        raise InputError(
            f"{path}, column 5",
            seen=f"the severity {min(map(str, other))!r}",
            expected=f"one of {', '.join(SEVERITIES)}",
            change="Restore the file from the repository.",
        )
    return events


def count_events(events: pd.DataFrame) -> pd.DataFrame:
    """Count the crashes and near-crashes of the 100-Car study after a lane change or behind a slower vehicle.

    The columns are ``what`` (the kind of encounter), ``severity`` (crash or near-crash) and ``count``.
    """
    cause, striking = events["precipitating_event"].fillna(""), events["incident"] == "Rear-end, striking"
    in_front = cause.str.fullmatch(r"Other vehicle lane change - (?:left|right) in front of subject")
    rules = {
        CUT_IN: in_front,
        STRUCK: in_front & striking,
        LANE_CHANGE: cause.str.startswith("Other vehicle lane change"),
        SLOWED: cause.str.startswith("Other vehicle ahead") & striking,
    }
    return pd.DataFrame(
        [
            {"what": what, "severity": named, "count": int((chosen & (events["severity"] == severity)).sum())}
            for what, chosen in rules.items()
            for severity, named in SEVERITIES.items()
        ]
    )


def poisson_limits(count: int, level: float = LEVEL) -> tuple[float, float]:
    """Return exact confidence limits of the mean of a Poisson distribution (Garwood 1936).

    They cover the mean with at least the probability ``level``.
    """
    tail = (1 - level) / 2
    low = float(scipy.stats.gamma.ppf(tail, count)) if count else 0.0
    return low, float(scipy.stats.gamma.isf(tail, count + 1))


def counted_rows(counts: pd.DataFrame, published: pd.DataFrame) -> pd.DataFrame:
    """Return the counted rates per million miles, with exact Poisson limits.

    The limits are NaN for sources that estimate their counts from samples. The texts ``comparable`` and
    ``reference`` say whether a row is comparable, and where it is from.
    """
    own = counts.assign(
        source=HUNDRED_CAR,
        what=counts["severity"] + ": " + counts["what"],
        million_miles=HUNDRED_CAR_MILES,
        comparable=np.where(
            counts["what"] == SLOWED,
            "no: not a cut-in",
            "yes: ordinary drivers, United States 2003-2004; another region than the records",
        ),
        reference="doi 10.15787/VTT1/CEU6RB",
    )
    rows = []
    for row in [*own.to_dict("records"), *published.to_dict("records")]:
        miles, is_count = row["million_miles"], row["source"] == HUNDRED_CAR
        # Other sources estimate their counts from samples of police reports, so these are not Poisson.
        limits = poisson_limits(int(row["count"])) if is_count else (np.nan, np.nan)
        rate = row["count"] / miles if pd.notna(row["count"]) else row["per_million_miles"]
        low, high = (limit / miles for limit in limits)
        rows.append(
            {name: row[name] for name in ("what", "million_miles", "count", "comparable", "reference")}
            | {"who": row["source"], "kind": "counted", "per_million_miles": rate}
            | {"low95": low, "high95": high}
        )
    return pd.DataFrame(rows)


def replayed_row(near_crashes: int) -> pd.DataFrame:
    """Return the crash rate of the careful driver of UN R157 in near-crashes that were recorded on roads.

    The rate is the share of crashes among the near-crashes of SHRP 2 that this driver replayed, times the
    near-crashes of the 100-Car study. The 95 % limits are those of the share (Clopper and Pearson 1934).
    """
    tail = (1 - LEVEL) / 2
    low, high = (
        scipy.stats.beta.ppf(tail, CRASHED, REPLAYED - CRASHED + 1),
        scipy.stats.beta.isf(tail, CRASHED + 1, REPLAYED - CRASHED),
    )
    share, rate = CRASHED / REPLAYED, near_crashes / HUNDRED_CAR_MILES
    row: dict[str, Any] = {"who": "cc_human in near-crashes of SHRP 2", "kind": "replayed"}
    row |= {"what": "crash: near-crashes of cut-ins, replayed", "count": CRASHED}
    row |= {"per_million_miles": share * rate, "low95": low * rate, "high95": high * rate}
    row |= {"in_hundred_car": share * near_crashes}
    row["comparable"] = "with the prediction for cc_human, if near-crashes are as severe in both studies"
    row["reference"] = "Olleja, Markkula and Bärgman 2024, arXiv 2406.09493, abstract"
    return pd.DataFrame([row])


def predicted_rows(vehicles: pd.DataFrame, cut_ins_per_km: float | None, counted: int) -> pd.DataFrame:
    """Return the predicted crash rates of vehicles, and whether the counted crashes contradict them.

    A prediction is contradicted if the probability of at most ``counted`` crashes is below 5 %, even at the
    lower end of the 95 % interval of the prediction. A prediction of fewer crashes than were counted is not
    contradicted, because a vehicle may be safer than the drivers of the 100-Car study. The number ``counted``
    is by the definition of a cut-in that includes the most crashes. ``in_hundred_car`` is the expected number
    of crashes in the distance of the 100-Car study, and ``probability_of_so_few`` the probability of at most
    ``counted`` crashes at the lower limit. There are no rows if ``cut_ins_per_km`` [1/km] is unknown.
    """
    if cut_ins_per_km is None:
        return pd.DataFrame()
    per_million_miles = 1e6 * KILOMETRES_PER_MILE * cut_ins_per_km
    known = vehicles[vehicles["resolved"]]
    low, high = (per_million_miles * known[end] for end in ("low95", "high95"))
    rate = per_million_miles * known["probability"]
    so_few = probability_of_so_few(known["low95"], cut_ins_per_km, counted)
    return pd.DataFrame(
        {
            "who": known["vehicle"],
            "kind": "predicted",
            "what": "crash: closing cut-in, predicted",
            "per_million_miles": rate,
            "low95": low,
            "high95": high,
            "in_hundred_car": HUNDRED_CAR_MILES * rate,
            "probability_of_so_few": so_few,
            "verdict": np.where(so_few < SIGNIFICANT, "more than were counted", "compatible with the count"),
            "comparable": "with the 100-Car rows, if cut-ins are as frequent and as severe there",
            "reference": "this study",
        }
    )


def probability_of_so_few(
    probability: float | pd.Series, cut_ins_per_km: float, counted: int = HUNDRED_CAR_MOST
) -> Any:  # noqa: ANN401
    """Return the probability of at most ``counted`` crashes in the distance of the 100-Car study.

    ``probability`` is that of a crash in a closing cut-in. Below `SIGNIFICANT`, counts contradict it.
    """
    expected = HUNDRED_CAR_MILES * 1e6 * KILOMETRES_PER_MILE * cut_ins_per_km * probability
    return scipy.stats.poisson.cdf(counted, expected)


def contradiction(probability: float, cut_ins_per_km: float) -> str:
    """Return in words that the counts contradict a vehicle, or an empty text if they do not.

    ``probability`` is the lower end of the 95 % interval of its crash probability in a closing cut-in.
    """
    if probability_of_so_few(probability, cut_ins_per_km) >= SIGNIFICANT:
        return ""
    expected = HUNDRED_CAR_MILES * 1e6 * KILOMETRES_PER_MILE * cut_ins_per_km * probability
    return (
        f"contradicted by counts: {expected:.2g} crashes or more are predicted for it in two million miles, "
        f"in which drivers had {HUNDRED_CAR_MOST} at most"
    )


def contradictions(posteriors: Mapping[str, Posterior | None], records: FittedRecords) -> dict[str, str]:
    """Return in words for each vehicle whose predicted crashes the counts contradict that they do so.

    Only cut-ins have been counted, and only in a known distance they have a rate.
    """
    per_km = records.per_km if records.scenario.name == SCENARIO else None
    found = {
        name: contradiction(posterior.interval(LEVEL)[0], per_km)
        for name, posterior in posteriors.items()
        if posterior is not None and per_km is not None
    }
    return {name: words for name, words in found.items() if words}


def compare_with_counts(
    vehicles: pd.DataFrame,
    exposure: pd.DataFrame,
    events: pd.DataFrame,
    published: pd.DataFrame,
) -> pd.DataFrame:
    """Tabulate predicted, replayed and counted crash rates per million miles with 95 % limits.

    ``vehicles`` and ``exposure`` are the tables of a study, ``events`` the events of the 100-Car study, and
    ``published`` crash rates from other sources. `counted_rows`, `replayed_row` and `predicted_rows` make
    the rows.
    """
    counts = count_events(events)
    most = count_of(counts, LANE_CHANGE, "crash")
    predicted = predicted_rows(vehicles, cut_in_rate(exposure), most)
    replayed = replayed_row(count_of(counts, STRUCK, "near-crash"))
    rows = [predicted, replayed, counted_rows(counts, published)]
    table = pd.concat([part for part in rows if not part.empty], ignore_index=True)
    return table.reindex(columns=OUTPUT)


def cut_in_rate(exposure: pd.DataFrame) -> float | None:
    """Return the recorded closing cut-ins per kilometre [1/km]; None if the distance is not known."""
    rows = exposure[(exposure["event"] == "cut-in") & (exposure["per"] == "kilometre")]
    return None if rows.empty else float(rows["mean"].iloc[0])


def count_of(counts: pd.DataFrame, what: str, severity: str) -> int:
    """Return the number of crashes or of near-crashes after one kind of encounter in the 100-Car study."""
    row: Mapping[tuple[str, str], int] = counts.set_index(["what", "severity"])["count"]
    return int(row[what, severity])
