"""Comparison of the numbers and statements of the paper with ours; a fixed rule determines the verdict."""

import json
import math
from collections.abc import Mapping
from typing import Any

import pandas as pd

from accelerated_evaluation.laws.paper.models import IndependentLaw
from accelerated_evaluation.publishing.published import table
from accelerated_evaluation.publishing.tables.paper import table2_computation
from accelerated_evaluation.publishing.tables.paper_claims import (
    ABOVE,
    CLAIMS,
    COUNT,
    DERIVED,
    PREMISES,
    STATED,
    Claim,
)
from accelerated_evaluation.publishing.tables.places import FOUND
from accelerated_evaluation.publishing.tables.readings import (
    faster,
    heuristic_acts,
    improves,
    of_records,
    same_estimate,
    same_tail,
    settled,
)
from accelerated_evaluation.publishing.tables.spreads import (
    Spread,
    exactly,
    of_method,
    pooled_probability,
    simulations_needed,
)

# Claims that need converged estimates of a method.
CONVERGED = {
    "piecewise": ("piecewise", "piecewise_run", "saving_run"),
    "single": ("single", "single_run", "saving_run"),
}
# Stage and quantity of the numbers in the paper's table II.
TABLE_2 = {
    "fitted": ("fitting", "parameters"),
    "moved": ("Cross-Entropy", "parameters"),
    "search": ("Cross-Entropy", "simulations"),
}
UNTESTED = "cannot be tested"  # verdict on a statement about something that does not happen in the study


def verdict(claim: Claim, ours: Spread) -> str:
    """Return the verdict on a claim of the paper, given our number with its spread.

    It is ``agrees`` if the paper's number, with its tolerance, overlaps our spread, and ``differs`` if not. A
    number without a spread is compared itself. A claim of the kind ``above`` agrees if our whole spread is
    above its number, differs if it is below, and is ``undecided`` otherwise. Derived numbers and counts have
    no verdict of their own; their kind is returned.
    """
    if claim.kind in (DERIVED, COUNT):
        return claim.kind
    low, high = (ours.value, ours.value) if math.isnan(ours.low) else (ours.low, ours.high)
    if claim.kind == ABOVE:
        return "agrees" if low > claim.paper else "differs" if high < claim.paper else "undecided"
    inside = low - claim.tolerance <= claim.paper <= high + claim.tolerance
    return "agrees" if inside else "differs"


def _without_places(claims: pd.DataFrame) -> pd.DataFrame:
    """Return the table without the columns that only the CSV file has, because they are long."""
    return claims.drop(columns=["key", "table", "rows", "formula"])


@table("claims", digits=3, digest=_without_places)
def claims_table(
    single: IndependentLaw,
    piecewise: IndependentLaw,
    two_pieces: IndependentLaw,
    three_pieces: IndependentLaw,
    dependence: pd.DataFrame,
    candidates: pd.DataFrame,
    similarity: pd.DataFrame,
    repeated_searches: pd.DataFrame,
    trace: pd.DataFrame,
    estimates: pd.DataFrame,
    course: pd.DataFrame,
    exact: pd.DataFrame,
    variation: pd.DataFrame,
    coverage: pd.DataFrame,
    premises: Mapping[str, Any],
    source: str,
    alpha: float,
    beta: float,
) -> pd.DataFrame:
    """Compare each number and each statement of the paper with ours.

    ``piecewise`` is the model that is simulated, and the other arguments are those of `Study`. The crash
    probability, and numbers that follow from it, are compared with the exact value. A row has the paper's
    number with its tolerance, ``paper_low`` to ``paper_high``; our number with its spread, NaN if it has
    none; the ``verdict`` by the rule of `verdict`, or ``not comparable`` if the study departs from the
    paper's assumptions or has no similar quantity, with its reason ``why``; and where our number stands in
    other published tables (`publishing.tables.places`). ``key`` is a short name by which others can cite it.
    """
    ours = _of_tables(table2_computation(estimates, coverage, exact, trace, single, piecewise, alpha, beta))
    ours |= dict.fromkeys(("identified", "closing"), exactly(sum(piecewise.counts.values()), "none, a count"))
    ours |= {
        f"{method}_run": simulations_needed(estimates, coverage, method, first=True) for method in CONVERGED
    }
    ours |= _probability(course, exact, alpha) | of_records(dependence, candidates, similarity)
    ours |= {"same_tail": same_tail(two_pieces, three_pieces), "same_estimate": same_estimate(course, alpha)}
    ours |= faster(variation, trace, repeated_searches, ours["crude"].value, alpha, beta)
    ours |= {name: improves(repeated_searches, name) for name in ("heuristic", "shifted")}
    ours |= settled(repeated_searches)
    ours["saving_run"] = exactly(1 - ours["piecewise_run"].value / ours["single_run"].value, "none, derived")
    departed, obstacles = departure(premises, source), _obstacles(estimates)
    rows = {
        key: {"key": key}
        | _row(claim, ours[key], (departed if claim.rests_on_study else "") or obstacles.get(key, ""))
        | FOUND[key].columns()
        for key, claim in CLAIMS.items()
    }
    if not departed and not heuristic_acts(trace):
        reason = "in the first segment no iteration has too few events, so that it is the same as piecewise"
        rows["heuristic"] |= {"verdict": UNTESTED, "why": reason}
    return pd.DataFrame(list(rows.values()))


def _row(claim: Claim, ours: Spread, obstacle: str) -> dict[str, str | float]:
    if not obstacle and not math.isfinite(ours.value):
        obstacle = "the study has no such number"
    judged = "not comparable" if obstacle else verdict(claim, ours)
    return {
        "claim": claim.claim,
        "source": claim.source,
        "paper": claim.paper,
        "paper_low": float(f"{claim.paper - claim.tolerance:.6g}"),
        "paper_high": float(f"{claim.paper + claim.tolerance:.6g}"),
        "ours": ours.value,
        "ours_low": ours.low,
        "ours_high": ours.high,
        "spread": ours.of,
        "verdict": judged,
        "why": obstacle or _why(judged, ours, claim),
    }


def _why(judged: str, ours: Spread, claim: Claim) -> str:
    if claim.kind in (STATED, ABOVE):
        return "as the paper states" if judged == "agrees" else claim.reason
    if ours.value == claim.paper:
        return "the same number"
    side = "above" if ours.value > claim.paper else "below"
    away = f"ours is {100 * abs(ours.value / claim.paper - 1):.0f} % {side}"
    return f"within our spread; {away}" if judged == "agrees" else f"{away}: {claim.reason}"


def departure(premises: Mapping[str, Any], source: str) -> str:
    """Return a description of the first setting in `PREMISES` that a study does not share with the paper.

    ``premises`` has the settings of the study by the same keys, and ``source`` describes its data. The
    description contains both values, and the data; it is empty if the study shares all settings.
    """
    for key, expected in PREMISES.items():
        if premises[key] != expected:
            premise = f"{key} is {json.dumps(premises[key])}, the paper's is {json.dumps(expected)}"
            return f"{premise}; data: {source}"
    return ""


def _obstacles(estimates: pd.DataFrame) -> dict[str, str]:
    """Return the claims for which we have no comparable number, with the reason."""
    obstacles = {"identified": "the published records are the closing ones only"}
    obstacles |= {key: CLAIMS[key].reason for key in ("search_piecewise", "search_single")}  # stopping rules
    for method, keys in CONVERGED.items():
        missing = ~of_method(estimates, method)["converged"]
        if missing.any():
            reason = f"{missing.sum()} of {missing.size} replicates of {method} did not converge"
            obstacles |= dict.fromkeys(keys, reason)
    return obstacles


def _of_tables(computed: pd.DataFrame) -> dict[str, Spread]:
    """Return our numbers for the paper's tables I and II, from the rows of `table2_computation`."""
    rows = computed.set_index(["stage", "quantity", "method"])[["ours", "ours_low", "ours_high", "spread"]]
    found = {
        f"{name}_{method}": Spread(*rows.loc[(*place, method)])
        for name, place in TABLE_2.items()
        for method in CONVERGED
    }
    return found | {
        method: Spread(*rows.loc["simulation", "simulations", method]) for method in ("crude", *CONVERGED)
    }


def _probability(course: pd.DataFrame, exact: pd.DataFrame, alpha: float) -> dict[str, Spread]:
    row, pooled = exact.set_index("segment").loc["all"], pooled_probability(course, "piecewise", alpha)
    value, end = float(row["probability"]), f"none, an end of the {pooled.of}"
    error = f"{100 * row['standard_error'] / value:.2g} %" if value else "0"
    return {
        "probability": exactly(value, f"none, exact for the model; standard error {error}"),
        "probability_low": exactly(pooled.low, end),
        "probability_high": exactly(pooled.high, end),
    }
