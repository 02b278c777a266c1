"""Answers in words, and tables of the replicates of an estimate, as users and studies keep them."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from accelerated_evaluation.answer.answer import Answer
from accelerated_evaluation.answer.by_few_runs import crashes_table
from accelerated_evaluation.answer.comparison import draws_table
from accelerated_evaluation.answer.extrapolation import extrapolation
from accelerated_evaluation.answer.fitted_records import FittedRecords
from accelerated_evaluation.answer.posterior import CHOICE, DATA, LEVELS, Posterior, exposure_table

RATE_DRAWS = 1000  # number of equally likely values of a probability from which rates are computed


def estimate_tables(answers: Sequence[Answer], records: FittedRecords) -> dict[str, pd.DataFrame]:
    """Return the tables of replicates of an answer from few runs, each with a column ``replicate``.

    They are ``answer``, ``budget``, ``draws``, ``exposure``, ``crashes``, ``extrapolation``, ``runs``, and
    ``estimate``, the estimate of the sampling alone, with its diagnostics.
    """
    parts = [_tables_of(answer, records) for answer in answers]
    return {
        name: pd.concat(
            [tables[name].assign(replicate=k) for k, tables in enumerate(parts)], ignore_index=True
        )
        for name in parts[0]
    }


def _tables_of(answer: Answer, records: FittedRecords) -> dict[str, pd.DataFrame]:
    estimate, event = answer.notes["estimate"], answer.problem.event
    row = {"law": answer.draws.proposal.description} | estimate.row() | {"converged": answer.converged}
    table = answer.table(records.per_km)
    return {
        "answer": table.assign(simulations=answer.simulations, converged=answer.converged),
        "budget": answer.budget(),
        "draws": draws_table(answer),
        "exposure": exposure_of({answer.problem.scenario.event_in_words(event): answer.posterior}, records),
        "crashes": crashes_table(answer),
        "extrapolation": extrapolation(answer, records),
        "runs": answer.tables["runs"],
        "estimate": pd.DataFrame([row]),
    }


def exposure_of(posteriors: Mapping[str, Posterior | None], records: FittedRecords) -> pd.DataFrame:
    """Return rates per kilometre and hour of events, by their names; see `exposure_table`."""
    levels = (np.arange(RATE_DRAWS) + 0.5) / RATE_DRAWS
    known = {name: own.whole for name, own in posteriors.items() if own is not None}
    thinned = {
        name: Posterior(np.quantile(own.probabilities, levels), np.zeros(RATE_DRAWS, int))
        for name, own in known.items()
    }
    return exposure_table(thinned, records.size, records.exposure)


def answer_in_words(row: Mapping[str, Any], sources: Sequence[str], noun: str = "encounter") -> list[str]:
    """Return a row of the table ``answer`` as lines of text.

    ``sources`` are the sources of uncertainty that the intervals contain (`Posterior.sources`), and ``noun``
    is the name of one encounter.
    """
    if np.isnan(row["median"]):
        return [f"{row['event']}: not known from these runs"]
    intervals = (f"{100 * level:.0f}%: {_ends(row, level)}" for level in LEVELS)
    per_km = "" if np.isnan(row["per_km"]) else f"; mean per kilometre {row['per_km']:.2g}"
    article = "an" if noun[0] in "aeiou" else "a"
    return [
        f"{row['event']}: probability in {article} {noun} {row['median']:.3g} (median, {_one_in(row)}), "
        f"{row['probability']:.3g} (mean){per_km}",
        f"  {intervals_in_words(sources)}: {'; '.join(intervals)}",
    ]


def intervals_in_words(sources: Sequence[str]) -> str:
    """Return which uncertainties the intervals of an answer contain, and which of the law they leave out."""
    missing = [source for source in (DATA, CHOICE) if source not in sources]
    without = f", without {_joined(missing)}" if missing else ""
    return f"intervals with {_joined(sources)}{without}"


def _joined(names: Sequence[str]) -> str:
    """Return names as a list in words, such as "data, choice of law and sampling"."""
    return " and ".join(part for part in (", ".join(names[:-1]), names[-1]) if part)


def _one_in(row: Mapping[str, Any]) -> str:
    """Return the median as one of so many encounters, with two significant digits."""
    number = 1 / row["median"] if row["median"] > 0 else np.inf
    return f"one in {float(f'{number:.2g}'):,.0f}" if np.isfinite(number) else "never"


def ratio_in_words(row: Mapping[str, Any]) -> str:
    """Return a row of the table ``compared`` as a line of text."""
    if np.isnan(row["ratio"]):
        return f"ratio to {row['other']}: not known from these runs"
    return (
        f"ratio to {row['other']}: {row['ratio']:.3g}, 80% interval {row['ratio_low80']:.3g} to "
        f"{row['ratio_high80']:.3g}; safer with probability {row['safer']:.3g}"
    )


def _ends(row: Mapping[str, Any], level: float) -> str:
    return f"{row[f'low{100 * level:.0f}']:.3g} to {row[f'high{100 * level:.0f}']:.3g}"


def budget_in_words(budget: pd.DataFrame) -> list[str]:
    """Return the shares of the variance in the table ``budget`` as text; nothing if they are unknown."""
    shares = budget.set_index("source")["variance_share"]
    if shares.empty or shares.isna().any():
        return []
    sources = shares.drop("together").items()
    parts = ", ".join(f"{source} {share:.0%}" for source, share in sources)
    return [f"variance of the logarithm: {parts}; only the last becomes smaller with more simulations"]
