"""Every number of the article, collected from published tables under the names that its text uses.

The text, ``article/article.typ``, contains no results itself. It reads this collection as JSON, formats each
number where it is used, and chooses its sentences accordingly: a study of another vehicle is not described as
a reproduction of the paper, and a vehicle that never crashes has no interval.
"""

from typing import Any

import pandas as pd

from accelerated_evaluation.publishing.article import beyond
from accelerated_evaluation.publishing.article.tables import Tables, plain, typeset
from accelerated_evaluation.publishing.study import Study
from accelerated_evaluation.publishing.tables.claims import UNTESTED, departure
from accelerated_evaluation.publishing.tables.exact import share_of_one_run
from accelerated_evaluation.publishing.tables.paper_claims import (
    CLAIMS,
    NUMBERS,
    PAPER_PROBABILITY,
    PAPER_SEARCHES,
    PAPER_SIMULATIONS,
    STATEMENTS,
)
from accelerated_evaluation.publishing.tables.spreads import LEVEL

KNOT, CAP = "knot of TTC^-1", "closing-speed cap [m/s]"  # choices in the table of sensitivities
RUNS = ("piecewise_run", "single_run")  # claims about single runs
METHODS = ("piecewise", "single", "heuristic", "shifted")


def collect(tables: Tables, benchmarks: Tables, study: Study) -> dict[str, Any]:
    """Return all numbers of the article, nested by subject, in types that JSON can represent.

    The tables of the benchmarks belong to the default study of the project.
    """
    return plain(
        {
            "study": _study(study),
            "records": _records(tables),
            "claims": _claims(tables),
            "methods": _methods(tables),
            "needed": _needed(tables),
            "exact": _exact(tables),
            "choices": _choices(tables),
            "uncertainty": _uncertainty(tables, study.alpha, study.beta),
            **beyond.collect(tables, benchmarks, study.config["surrogate"]["replicates"]),
        }
    )


def _study(study: Study) -> dict[str, Any]:
    vehicle, limits = study.scope
    return {
        "name": study.name,
        "source": study.source,
        "seed": study.seed,
        "vehicle": vehicle,
        "departure": departure(study.premises, study.source),
        "slowest": limits["lead_speed_min"],
        "fastest": limits["lead_speed_max"],
        "farthest": limits["range_max"],
        "cap": study.cap,
        "level": 100 * (1 - study.alpha),
        "spread": 100 * LEVEL,
        "half_width": study.beta,
        "replicates": study.sampling["replicates"],
        "draws": study.config["answer"]["draws"],
        "refits": study.config["uncertainty"]["replicates"],
    }


def _records(tables: Tables) -> dict[str, Any]:
    account = tables["encounters_account"]
    repeated = account[account["step"] == "repeated"].iloc[0]
    report = tables["records_report"]
    if report.empty:
        raise ValueError("no check of the records")
    return {
        "read": account["rows_in"].iloc[0],
        "kept": account["rows_kept"].iloc[-1],
        "repeated": repeated["rows_found"],
        "repeated_share": repeated["rows_found"] / repeated["rows_in"],
        "checks": len(report),
        "inspect": int((report["verdict"] == "warning").sum()),
        "stop": report.loc[report["verdict"] == "stop", "check"].tolist(),
    }


def _claims(tables: Tables) -> dict[str, Any]:
    claims = tables["claims"].set_axis(list(CLAIMS))
    claims = claims.assign(paper=claims["paper"].astype(float), claim=claims["claim"].map(typeset))
    keys = ("claim", "source", "paper", "ours", "ours_low", "ours_high", "verdict")
    unlike = claims[claims["verdict"].isin(["differs", "undecided", "not comparable", UNTESTED])]
    reasons = unlike.assign(why=unlike["why"].map(_reason)).groupby("why", sort=False)
    runs = claims.loc[list(RUNS)]
    return {
        "numbers": _verdicts(claims.loc[list(NUMBERS)]),
        "statements": _verdicts(claims.loc[list(STATEMENTS)]),
        "rows": claims.loc[list(NUMBERS), list(keys)].to_dict("records"),
        "stated": claims.loc[list(STATEMENTS), list(keys)].to_dict("records"),
        "reasons": [{"why": why, "claims": rows["claim"].tolist()} for why, rows in reasons],
        "spread_of_runs": (runs["ours_high"] / runs["ours_low"]).max(),
        "paper": {key: claim.paper for key, claim in CLAIMS.items()},
        "ours": claims["ours"].to_dict(),
        "verdict": claims["verdict"].to_dict(),
    }


def _verdicts(claims: pd.DataFrame) -> dict[str, int]:
    """Count the claims by verdict; ``judged`` is the number of those that have a verdict of their own."""
    counts = claims["verdict"].value_counts()
    words = ("agrees", "differs", "undecided", "not comparable", UNTESTED)
    found = {word.replace(" ", "_"): int(counts.get(word, 0)) for word in words}
    return found | {"judged": sum(found.values())}


def _reason(why: str) -> str:
    """Return a reason without its first part, the difference of the two numbers, which the table shows."""
    _, separator, reason = why.partition(": ")
    return typeset(reason if separator and why.startswith("ours is") else why)


def _methods(tables: Tables) -> dict[str, Any]:
    sizes = tables["table1_sample_size"].set_index("method")
    coverage = tables["coverage"].set_index(["method", "stopping"])
    together = tables["surrogate"].query("scope == 'all'").set_index("method")
    pooled = coverage.loc["piecewise"]
    return {
        **{name: sizes.loc[name].drop("spread").to_dict() for name in (*METHODS, "crude")},
        "searching": {name: together.loc[name, "learning"] for name in METHODS},
        "replicates": coverage["replicates"].max(),
        "coverage": {
            rule: {
                name: pooled.loc[rule, f"coverage{level}"] for name, level in (("middle", 80), ("wide", 95))
            }
            for rule in ("sequential", "sequential_gamma")
        },
        "more": pooled.loc["sequential_gamma", "simulations_mean"]
        / pooled.loc["sequential", "simulations_mean"],
    }


def _needed(tables: Tables) -> dict[str, Any]:
    """Return ratios of the simulations to convergence, from exact variances: of single, and to piecewise."""
    needed = tables["needed"].query("scope == 'all'").set_index("method")["simulations"]
    ratios = needed / needed["piecewise"]
    paper = {name: PAPER_SEARCHES[name] + PAPER_SIMULATIONS[name] for name in ("single", "piecewise")}
    return {
        "ratio": ratios["single"],
        "heuristic": ratios["heuristic"],
        "shifted": ratios["shifted"],
        "paper_with_search": paper["single"] / paper["piecewise"],
    }


def _exact(tables: Tables) -> dict[str, Any]:
    found = tables.row("exact", "segment", "all")
    crude = tables.row("crude", "segment", "all")
    lines = tables["convergence"]["lines"].max()
    probability, error = found["probability"], found["standard_error"]
    return {
        "probability": probability,
        "standard_error": error,
        "relative_error": error / probability if probability else None,
        "lines": lines,
        "paper": PAPER_PROBABILITY,
        "above_paper": probability / PAPER_PROBABILITY - 1,
        "crude": crude,
        "expected": probability * crude["simulations"],
        "inside": crude["ci95_low"] <= probability <= crude["ci95_high"],
    }


def _choices(tables: Tables) -> dict[str, Any]:
    """Return the lowest and highest probability over the values of choices that the paper does not state.

    The choices are the knot of TTC^-1 and the closing-speed cap. The probabilities with a single distribution
    and with three pieces are returned too.
    """
    sensitivity = tables["sensitivity"]
    ends = {}
    for name, choice in {"knot": KNOT, "cap": CAP}.items():
        rows = sensitivity[sensitivity["choice"] == choice].sort_values("probability")
        low, high = rows.iloc[0], rows.iloc[-1]
        ends[name] = {
            "at_low": low["value"],
            "low": low["probability"],
            "at_high": high["value"],
            "high": high["probability"],
            "factor": high["probability"] / low["probability"] if low["probability"] else None,
        }
    models = sensitivity[sensitivity["choice"] == "model"].set_index("value")["probability"]
    return ends | {"single": models["single"], "three_pieces": models["three_pieces"]}


def _uncertainty(tables: Tables, alpha: float, beta: float) -> dict[str, Any]:
    budget = tables["uncertainty"].set_index("source")
    share = budget["variance_share"]
    return {
        "sampling": share["sampling"],
        "sampling_of_one_run": share_of_one_run(tables["uncertainty"], alpha, beta),
        "data": share["data"],
        "choice": share["choice of model"],
        "low": budget.loc["together", "ci_low"],
        "high": budget.loc["together", "ci_high"],
    }
