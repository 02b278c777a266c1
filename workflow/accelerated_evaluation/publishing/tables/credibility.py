"""What a safety case asks of a simulation, answered from the tables of a study, one row for each question."""

from collections.abc import Callable, Mapping
from inspect import Parameter, Signature
from typing import Any

import pandas as pd

from accelerated_evaluation.answer.consequences.all_cut_ins import ALL, CLOSING_CUT_IN, KEEPS
from accelerated_evaluation.answer.consequences.criterion import criterion_in_words
from accelerated_evaluation.answer.ways.extrapolation import RECORDED
from accelerated_evaluation.answer.ways.near_miss_answer import as_choice
from accelerated_evaluation.base.percent import in_percent
from accelerated_evaluation.publishing.published import table
from accelerated_evaluation.publishing.tables.display import readable
from accelerated_evaluation.records.verdict import Verdict

DIGITS = 2
# Results without which there is no table.
NEEDED = ("account", "scope", "seed", "records_report", "answer_budget", "extrapolation")
UNDER_TEST = "under test"
COLUMNS = ["question", "answer", "table"]
UNKNOWN = "not known for this study"


def records_used(account: pd.DataFrame) -> str:
    """Return how many rows of the records were read and used."""
    if "fitted" in account:  # that of a scenario, with one row for each variable
        read, fitted = account[["records", "fitted"]].iloc[0].astype(int)
        return f"{read:,} records were read, and laws are fitted to {fitted:,}"
    rows = account[["rows_in", "rows_kept"]].astype(int)
    return f"{rows['rows_in'].iloc[0]:,} rows were read, and {rows['rows_kept'].iloc[-1]:,} are used"


def scope_in_words(scope: tuple[str, Mapping[str, float]]) -> str:
    """Return the vehicle and the limits of the encounters, of which the scope consists, in words."""
    vehicle, filters = scope
    limits = ", ".join(f"{name} {value:g}" for name, value in filters.items())
    return f"vehicle {vehicle}; limits [m/s, m]: {limits}"


def checks_of(report: pd.DataFrame) -> str:
    """Return the number of checks of the records by verdict."""
    counts = report["verdict"].value_counts(sort=False)
    return Verdict.of(report).in_short or ", ".join(f"{count} {name}" for name, count in counts.items())


def range_of_medians(variants: pd.DataFrame) -> str:
    """Return the smallest and largest median of the answer under other choices, and what they are."""
    own, *others = variants.iloc[:, 0]
    medians = variants.set_index(variants.columns[0])["median"]
    if not others or medians.isna().all():
        return UNKNOWN
    ends = (f"{readable(medians[name], DIGITS)} ({name})" for name in (medians.idxmin(), medians.idxmax()))
    return f"median {readable(medians[own], DIGITS)}; with other choices from {' to '.join(ends)}"


def without_law(near_miss_answer: pd.DataFrame) -> str:
    """Return the second answer, from near misses, with its interval and the number of its margins."""
    if (rows := as_choice(near_miss_answer)).empty:
        return UNKNOWN
    low, middle, high = (readable(rows[name].iloc[0], DIGITS) for name in ("low80", "median", "high80"))
    return f"{rows['choice'].iloc[0]}: median {middle}, 80 % interval {low} to {high}"


def shares_of(budget: pd.DataFrame) -> str:
    """Return the shares of the sources of uncertainty, the largest first."""
    parts = budget[budget["source"] != "together"].dropna(subset="variance_share")
    parts = parts.sort_values("variance_share", ascending=False)
    shares = zip(parts["source"], parts["variance_share"], strict=True)
    return ", ".join(f"{source} {in_percent(share)}" for source, share in shares) or UNKNOWN


def beyond_records(extrapolation: pd.DataFrame) -> str:
    """Return the share of the answer that does not rest on replayed records or their neighbours."""
    if extrapolation.empty or (shares := extrapolation.set_index("part")["share"].dropna()).empty:
        return UNKNOWN  # the vehicle never crashes, or no crash is known
    share = 1 - shares.get(RECORDED, 0.0)
    return f"{in_percent(share)} of the probability belongs to events unlike any record"


def steps_of(numerical_error: pd.DataFrame) -> str:
    """Return the ratios of the crash probability with finer steps, for the vehicle under test."""
    own = numerical_error[numerical_error["vehicle"] == UNDER_TEST].dropna(subset="ratio")
    rows = own[["steps", "ratio", "standard_error"]].itertuples(index=False)
    return "; ".join(f"{steps}: times {ratio:.2f} ± {error:.2f}" for steps, ratio, error in rows) or UNKNOWN


def calibration_of(fold_calibration: pd.DataFrame) -> str:
    """Return how many counts of held-out blocks lie outside their limits, and how many would by chance."""
    own = fold_calibration[fold_calibration["law"] == fold_calibration["law"].iloc[0]]
    rows = own[["division", "outside", "cells", "by_chance"]].itertuples(index=False)
    return "; ".join(
        f"{name}: {outside} of {cells} counts outside their limits, {chance:.0f} by chance"
        for name, outside, cells, chance in rows
    )


def agreement_of(agreement: pd.DataFrame) -> str:
    """Return how many published verdicts the vehicle reproduces."""
    rows = agreement[["kind", "agree", "verdicts"]].itertuples(index=False)
    return (
        "; ".join(f"{agree:,} of {verdicts:,} {kind} verdicts" for kind, agree, verdicts in rows) or UNKNOWN
    )


def counted_of(counted: pd.DataFrame) -> str:
    """Return the crashes that are expected in the distance of the 100-Car study, and the verdict."""
    own = counted[(counted["who"] == UNDER_TEST) & (counted["kind"] == "predicted")]
    if own.empty:
        return f"{UNKNOWN}, because the distance of the records or the crash probability is missing"
    row = own.iloc[0]
    return f"{readable(row['in_hundred_car'], DIGITS)} crashes in two million miles: {row['verdict']}"


def motion_of(all_cut_ins: pd.DataFrame) -> str:
    """Return the median of the answer and that of all cut-ins with lead motion, and what is missing."""
    own = all_cut_ins[(all_cut_ins["vehicle"] == UNDER_TEST) & (all_cut_ins["per"] == CLOSING_CUT_IN)]
    rows = own.set_index("part")
    if ALL not in rows.index:
        return UNKNOWN
    before, after, limit = (
        readable(rows.loc[part, name], DIGITS)
        for part, name in ((KEEPS, "median"), (ALL, "median"), (ALL, "upper95"))
    )
    if pd.isna(rows.loc[ALL, "median"]):
        after = f"a number that is not known, below {limit} (95 %)"
    missing = rows.loc[ALL, "missing"]
    return f"median {before} becomes {after}" + (f"; missing: {missing}" if pd.notna(missing) else "")


def judged_of(criteria: pd.DataFrame) -> str:
    """Return the verdicts on the criteria of the configuration, in words."""
    rows = criteria.fillna({"encounters": "", "weakest_choice": "", "reason": ""}).to_dict("records")
    lines = [criterion_in_words(row) for row in rows]
    return "; ".join(line.removeprefix("criterion ") for line in lines) or "the configuration states none"


def chain_of(seed: int) -> str:
    """Return how a number is followed back to its run."""
    return f"root seed {seed}; checksums of code, records and results"


# Question, name of the result in `Study`, published table or file, and function that gives the answer.
QUESTIONS: tuple[tuple[str, str, str, Callable[[Any], str]], ...] = (
    ("scope: which records", "account", "encounters_account", records_used),
    ("scope: which encounters and vehicle", "scope", "config.json", scope_in_words),
    ("quality of the records", "records_report", "records_report", checks_of),
    ("assumptions: how much they change the answer", "choices", "choices", range_of_medians),
    ("a second answer, without a law", "near_miss_answer", "near_miss_answer", without_law),
    ("treatment of doubtful records", "data_quality", "data_quality", range_of_medians),
    ("sources of uncertainty", "answer_budget", "answer_budget", shares_of),
    ("extrapolation", "extrapolation", "extrapolation", beyond_records),
    ("numerical error", "numerical_error", "numerical_error", steps_of),
    ("validation: held-out records", "fold_calibration", "fold_calibration", calibration_of),
    ("validation: published outcomes", "scenario_agreement", "agreement", agreement_of),
    ("differences from the world: lead motion", "all_cut_ins", "all_cut_ins", motion_of),
    ("differences from the world: counted crashes", "counted_crashes", "counted_crashes", counted_of),
    ("acceptance criteria", "criteria", "criteria", judged_of),
    ("chain from the run to the claim", "seed", "provenance.json", chain_of),
)


def credibility(**results: Any) -> pd.DataFrame:  # noqa: ANN401
    """Return what a safety case asks of the simulation, a row for each question that the results can answer.

    ``results`` are results of a study by their name in `Study`. The columns are ``question``, ``answer``, and
    the ``table`` or file from which the answer was made.
    """
    asked = [each for each in QUESTIONS if each[1] in results]
    rows = [(question, answered(results[name]), shown) for question, name, shown, answered in asked]
    return pd.DataFrame(rows, columns=COLUMNS)


# Its parameters are the results that the questions need.
_asked: Any = credibility
_asked.__signature__ = Signature(
    [
        Parameter(name, Parameter.KEYWORD_ONLY, default=Parameter.empty if name in NEEDED else None)
        for name in dict.fromkeys(name for _, name, *_ in QUESTIONS)
    ]
)
credibility_table = table("credibility")(_asked)
