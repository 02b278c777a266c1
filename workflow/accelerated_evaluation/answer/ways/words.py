"""Rows of the tables of an answer in words."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from accelerated_evaluation.answer.ways.posterior import CHOICE, CONTRADICTED, DATA, LEVELS
from accelerated_evaluation.base.percent import in_percent

Row = tuple[str, str, str]  # name of a result, its value, and a remark on it

NOTHING = "no uncertainty"  # of an exact probability under one law


def aligned(rows: Sequence[Row]) -> list[str]:
    """Return rows as lines of text in three columns; a value without a remark may be longer than others."""
    first = max(len(name) for name, _, _ in rows)
    second = max((len(value) for _, value, remark in rows if remark), default=0)
    return [f"{name:<{first}}  {value:<{second}}  {remark}".rstrip() for name, value, remark in rows]


def probability_row(row: Mapping[str, Any], sources: Sequence[str], noun: str) -> Row:
    """Return the median and the 80 % interval in a row of the table ``answer``, as one of so many encounters.

    If the interval contains the uncertainty of the sampling alone, the remark says so.
    """
    if np.isnan(row["median"]):
        return row["event"], unknown_in_words(row), ""
    alone = "" if {DATA, CHOICE} & set(sources) else ", sampling alone"
    highest, lowest = (_one_in(row[end]) for end in ("high80", "low80"))
    ends = f"{highest} to {lowest}" if row["low80"] > 0 or row["median"] == 0 else f"{highest} or rarer"
    middle = f"{_one_in(row['median'])} {noun}s" if row["median"] > 0 else _one_in(0.0)
    return row["event"], middle, f"(80 %{alone}: {ends})"


def unknown_in_words(row: Mapping[str, Any]) -> str:
    """Return in words that a probability is not known, with its upper limit if there is one."""
    high = row.get("high95", np.nan)
    return "not known from these runs" + ("" if np.isnan(high) else f", below {high:.2g} (95 %)")


def ratio_row(row: Mapping[str, Any]) -> Row:
    """Return the median and the 80 % interval in a row of the table ``compared``."""
    name = f"vs {row['other']}"
    if np.isnan(row["ratio"]):
        return name, "not known from these runs", ""
    mark = ", contradicted by counts" if row.get(CONTRADICTED) is True else ""
    return name, f"{row['ratio']:.2g} x", f"({row['ratio_low80']:.2g} to {row['ratio_high80']:.2g}){mark}"


def study_in_short(laws: Path, noun: str) -> list[str]:
    """Return the answer of a finished study as lines of text, from the tables in its folder ``laws``.

    These are the crash probability, its ratio to that of the careful human or of the first reference, and the
    share of the predicted crashes that resemble records. ``noun`` is the name of one encounter. Without the
    tables, a line says where they are.
    """
    if not (laws / "answer.csv").is_file():
        return ["The results are in the storage of Snakemake."]
    crash = pd.read_csv(laws / "answer.csv").iloc[0].to_dict()
    rows = [probability_row(crash, crash["contains"].split(", "), noun)]
    if (laws / "compared.csv").is_file():
        compared = pd.read_csv(laws / "compared.csv").set_index("other", drop=False)
        names = [*compared.index[:1], *compared.index[compared.index == "cc_human"]]
        rows += [ratio_row(compared.loc[name]) for name in names[-1:]]
    parts = pd.read_csv(laws / "extrapolation.csv").set_index("part")["share"].dropna()
    if "recorded" in parts:
        share = in_percent(parts["recorded"])
        rows.append(("like records", share, "(of the crashes; the rest is extrapolated)"))
    return aligned(rows)


def updated_row(table: pd.DataFrame) -> Row:
    """Return the rate after the crashes in service, from the table ``in_service``, and the rate before."""
    before, after = table.to_dict("records")
    ends = [f"{row['low80']:.2g} to {row['high80']:.2g}" for row in (after, before)]
    remark = f"(80 %: {ends[0]}; before {ends[1]}; {after['effective']:,.0f} effective values)"
    median = "not known" if np.isnan(after["median"]) else f"{after['median']:.2g}"
    return "in service", f"{median} per {after['per']}", remark


def answer_in_words(row: Mapping[str, Any], sources: Sequence[str], noun: str = "encounter") -> list[str]:
    """Return a row of the table ``answer`` as lines of text.

    ``sources`` are the sources of uncertainty that the intervals contain (`Posterior.sources`), and ``noun``
    is the name of one encounter.
    """
    if np.isnan(row["median"]):
        return [f"{row['event']}: {unknown_in_words(row)}"]
    intervals = (f"{100 * level:.0f}%: {_ends(row, level)}" for level in LEVELS)
    per_km = "" if np.isnan(row["per_km"]) else f"; mean per kilometre {row['per_km']:.2g}"
    article, median = "an" if noun[0] in "aeiou" else "a", row["median"]
    return [
        f"{row['event']}: probability in {article} {noun} {median:.3g} (median, {_one_in(median)}), "
        f"{row['probability']:.3g} (mean){per_km}",
        f"  {intervals_in_words(sources)}: {'; '.join(intervals)}",
    ]


def intervals_in_words(sources: Sequence[str]) -> str:
    """Return which uncertainties the intervals of an answer contain, and which of the law they leave out."""
    missing = [source for source in (DATA, CHOICE) if source not in sources]
    without = f", without {_joined(missing)}" if missing else ""
    return f"intervals with {_joined(sources or [NOTHING])}{without}"


def _joined(names: Sequence[str]) -> str:
    """Return names as a list in words, such as "data, choice of law and sampling"."""
    return " and ".join(part for part in (", ".join(names[:-1]), names[-1]) if part)


def _one_in(probability: float) -> str:
    """Return a probability as one of so many encounters, with two significant digits, and 0 as "never"."""
    number = 1 / probability if probability > 0 else np.inf
    if number < 10:
        return f"1 in {number:.2g}"
    return f"1 in {float(f'{number:.2g}'):,.0f}" if np.isfinite(number) else "never"


def ratio_in_words(row: Mapping[str, Any]) -> str:
    """Return a row of the table ``compared`` as a line of text."""
    if np.isnan(row["ratio"]):
        return f"ratio to {row['other']}: not known from these runs"
    return (
        f"ratio to {row['other']}: {row['ratio']:.3g}, 80% interval {row['ratio_low80']:.3g} to "
        f"{row['ratio_high80']:.3g}; safer with probability {row['safer']:.3g}"
    )


def _ends(row: Mapping[str, Any], level: float) -> str:
    """Return an interval in words; one that begins at 0 says only how large the probability can be."""
    low, high = (row[f"{end}{100 * level:.0f}"] for end in ("low", "high"))
    return f"{low:.3g} to {high:.3g}" if low > 0 or high == 0 else f"below {high:.3g}"


def budget_in_words(budget: pd.DataFrame) -> list[str]:
    """Return the shares of the variance in the table ``budget`` as text; nothing if they are unknown."""
    shares = budget.set_index("source")["variance_share"]
    if shares.empty or shares.isna().any():
        return []
    sources = shares.drop("together").items()
    parts = ", ".join(f"{source} {in_percent(share)}" for source, share in sources)
    return [f"variance of the log probability: {parts}; more simulations reduce only the last part"]
