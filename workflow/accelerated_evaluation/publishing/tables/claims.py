"""Comparison of the numbers that the paper states with ours; a fixed rule determines the verdict."""

import json
import math
from collections.abc import Mapping
from functools import reduce
from operator import getitem
from typing import Any

import numpy as np
import pandas as pd
from scipy.special import ndtri

from accelerated_evaluation.laws.paper.independent import IndependentLaw
from accelerated_evaluation.publishing.published import table
from accelerated_evaluation.publishing.tables.paper_claims import CLAIMS, Claim
from accelerated_evaluation.publishing.tables.searches import search_totals, searched_parameters
from accelerated_evaluation.publishing.tables.spreads import (
    Spread,
    count,
    crude_sample_size,
    of_method,
    pooled_probability,
    sample_size,
    spread_over,
)
from accelerated_evaluation.records.sources import describe

# Settings that a study must have in common with the paper; otherwise their numbers are not comparable.
PREMISES = {
    "data.source": "spmd",
    "data.sample": None,
    "vehicle.name": "acc_aeb",
    "vehicle.parameters": {},
    "importance_sampling.alpha": 0.2,
    "importance_sampling.beta": 0.2,
}


def verdict(claim: Claim, ours: Spread) -> str:
    """Return ``agrees`` if the paper's number lies within our spread, and ``differs`` otherwise.

    Parameters
    ----------
    claim
        The paper's number and its tolerance, by which the spread is widened on both sides.
    ours
        Our number and its spread.
    """
    inside = ours.low - claim.tolerance <= claim.paper <= ours.high + claim.tolerance
    return "agrees" if inside else "differs"


@table("claims", digits=3)
def claims_table(
    single: IndependentLaw,
    piecewise: IndependentLaw,
    trace: pd.DataFrame,
    estimates: pd.DataFrame,
    course: pd.DataFrame,
    exact: pd.DataFrame,
    config: Mapping[str, Any],
) -> pd.DataFrame:
    """Compare each number that the paper states with ours.

    Parameters
    ----------
    single, piecewise
        The fitted models of these two methods.
    trace, estimates, course
        ``cross_entropy_trace.csv``, ``estimates.csv`` and ``estimates_course.csv`` of a study.
    exact
        ``exact.csv``; the probability, and numbers that follow from it, are compared with the exact value.
    config
        The study's configuration.

    Returns
    -------
    pandas.DataFrame
        A row for each claim: the paper's number with its tolerance, ``paper_low`` to ``paper_high``; our
        number ``ours`` with its spread, ``ours_low`` to ``ours_high``; ``verdict``; and its reason ``why``.
        The verdict is ``agrees`` or ``differs`` by the rule of `verdict`, or ``not comparable`` if the study
        departs from the paper's assumptions or has no similar quantity.
    """
    ours, totals = _counts({"single": single, "piecewise": piecewise}, trace), search_totals(trace)
    ours |= {f"search_{name}": spread_over(totals[name], "seeds") for name in ("piecewise", "single")}
    ours |= _samples(estimates, course, exact, config["importance_sampling"])
    departed, obstacles = departure(config), _obstacles(estimates)
    rows = [
        _row(claim, ours[key], (departed if claim.rests_on_study else "") or obstacles.get(key, ""))
        for key, claim in CLAIMS.items()
    ]
    return pd.DataFrame(rows)


def _row(claim: Claim, ours: Spread, obstacle: str) -> dict[str, str | float]:
    if not obstacle and not math.isfinite(ours.value):
        obstacle = "the study has no such number, as nothing crashes"
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
    side = "above" if ours.value > claim.paper else "below"
    away = f"ours is {100 * abs(ours.value / claim.paper - 1):.0f} % {side}"
    if judged == "agrees":
        return "the same count" if ours.low == ours.high else f"within our spread; {away}"
    return f"{away}: {claim.reason}"


def departure(config: Mapping[str, Any]) -> str:
    """Return a description of the first setting in `PREMISES` that a study does not share with the paper.

    Parameters
    ----------
    config
        Resolved configuration of the study.

    Returns
    -------
    str
        The setting with both values, and the data; empty if the study shares all settings.
    """
    for key, expected in PREMISES.items():
        seen = reduce(getitem, key.split("."), config)
        if seen != expected:
            premise = f"{key} is {json.dumps(seen)}, the paper's is {json.dumps(expected)}"
            return f"{premise}; data: {describe(config['data'])}"
    return ""


def _obstacles(estimates: pd.DataFrame) -> dict[str, str]:
    """Return the claims for which we have no comparable number, with the reason."""
    obstacles = {"identified": "the published records are the closing ones only"}
    for method, keys in {
        "piecewise": ("piecewise", "piecewise_run", "ratio_single", "ratio_crude", "saving_run", "saving"),
        "single": ("single", "single_run", "ratio_single", "saving_run", "saving"),
    }.items():
        missing = ~of_method(estimates, method)["converged"]
        if missing.any():
            reason = f"{missing.sum()} of {missing.size} replicates of {method} did not converge"
            obstacles |= dict.fromkeys(keys, reason)
    return obstacles


def _counts(models: Mapping[str, IndependentLaw], trace: pd.DataFrame) -> dict[str, Spread]:
    events = count(sum(models["piecewise"].counts.values()))
    numbers = {"identified": events, "closing": events}
    for method in ("piecewise", "single"):
        numbers[f"fitted_{method}"] = count(models[method].n_parameters)
        numbers[f"moved_{method}"] = count(searched_parameters(trace, method))
    return numbers


def _samples(
    estimates: pd.DataFrame, course: pd.DataFrame, exact: pd.DataFrame, settings: Mapping[str, Any]
) -> dict[str, Spread]:
    """Return probability, simulations to convergence and their ratios, by the key of the claim.

    The first replicate is compared with the single runs that the paper reports.
    """
    alpha = settings["alpha"]
    pooled = pooled_probability(course, "piecewise", alpha)
    probability = _exact(exact, alpha)
    crude = crude_sample_size(probability, alpha, settings["beta"])
    means = {method: sample_size(estimates, method) for method in ("piecewise", "single")}
    n, m = (of_method(estimates, method)["simulations"].to_numpy(float) for method in means)
    ratio = means["single"].value / means["piecewise"].value
    ratios, savings = np.divide.outer(m, n), 1 - np.divide.outer(n, m)
    return {
        "probability": probability,
        "probability_low": _end(pooled, pooled.low),
        "probability_high": _end(pooled, pooled.high),
        **means,
        "crude": crude,
        "ratio_single": spread_over(ratios, "pairs of replicates")._replace(value=ratio),
        "ratio_crude": spread_over(crude.value / n, "replicates")._replace(
            value=crude.value / means["piecewise"].value
        ),
        "piecewise_run": _run(n[0], n, "replicates"),
        "single_run": _run(m[0], m, "replicates"),
        "saving_run": _run(1 - n[0] / m[0], savings, "pairs of replicates"),
        "saving": spread_over(savings, "pairs of replicates")._replace(value=1 - 1 / ratio),
    }


def _exact(exact: pd.DataFrame, alpha: float) -> Spread:
    """Return the exact probability over all segments with the interval of its numerical error."""
    row = exact.set_index("segment").loc["all"]
    margin = float(-ndtri(alpha / 2)) * row["standard_error"]
    value = row["probability"]
    level = f"{1 - alpha:.0%}".replace("%", " %")
    return Spread(value, value - margin, value + margin, f"{level} interval of the exact value's error")


def _run(first: float, runs: np.ndarray, things: str) -> Spread:
    """Return the number of our first run, with the smallest and largest number of all runs as spread."""
    return Spread(first, runs.min(), runs.max(), f"range of {runs.size} {things}, ours the first")


def _end(interval: Spread, value: float) -> Spread:
    return Spread(value, value, value, f"none, an end of the {interval.of}")
