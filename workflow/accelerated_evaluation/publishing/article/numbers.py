"""Every number of the article, collected from published tables under the names that its text uses.

The text, ``article/article.typ``, contains no results itself. It reads this collection as JSON, formats each
number where it is used, and chooses its sentences accordingly: a study of another vehicle is not described as
a reproduction of the paper, and a vehicle that never crashes has no interval.
"""

from collections.abc import Mapping
from typing import Any

from accelerated_evaluation.publishing.article import beyond
from accelerated_evaluation.publishing.article.tables import Tables, plain, typeset
from accelerated_evaluation.publishing.tables.claims import departure
from accelerated_evaluation.publishing.tables.paper_claims import CLAIMS
from accelerated_evaluation.publishing.tables.paper_numbers import PAPER_PROBABILITY
from accelerated_evaluation.records.sources import describe

KNOT, CAP = "knot of TTC^-1", "closing-speed cap [m/s]"  # choices in the table of sensitivities
VERDICTS = ("agrees", "differs", "not comparable")
RUNS = ("piecewise_run", "single_run")  # claims about single runs
METHODS = ("piecewise", "single", "heuristic")


def collect(tables: Tables, benchmarks: Tables, config: Mapping[str, Any]) -> dict[str, Any]:
    """Return all numbers of the article, nested by subject, in types that JSON can represent.

    Parameters
    ----------
    tables
        Published tables of the study, which are read by name.
    benchmarks
        Tables of the benchmarks, which belong to the default study of the project.
    config
        Resolved configuration of the study.
    """
    return plain(
        {
            "study": _study(config),
            "records": _records(tables),
            "claims": _claims(tables),
            "methods": _methods(tables),
            "exact": _exact(tables),
            "choices": _choices(tables),
            "uncertainty": _uncertainty(tables),
            **beyond.collect(tables, benchmarks, config),
        }
    )


def _study(config: Mapping[str, Any]) -> dict[str, Any]:
    limits, sampling = config["filters"], config["importance_sampling"]
    return {
        "name": config["study"],
        "source": describe(config["data"]),
        "seed": config["seed"],
        "vehicle": config["vehicle"]["name"],
        "departure": departure(config),
        "slowest": limits["lead_speed_min"],
        "fastest": limits["lead_speed_max"],
        "farthest": limits["range_max"],
        "cap": config["models"]["closing_speed_max"],
        "level": 100 * (1 - sampling["alpha"]),
        "half_width": sampling["beta"],
        "replicates": sampling["replicates"],
        "draws": config["answer"]["draws"],
        "refits": config["uncertainty"]["replicates"],
    }


def _records(tables: Tables) -> dict[str, Any]:
    account = tables["encounters_account"]
    repeated = account[account["step"] == "repeated"].iloc[0]
    report = tables["records_report"]
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
    claims = tables["claims"].assign(paper=lambda table: table["paper"].astype(float))
    spread = (claims["ours_high"] / claims["ours_low"]).set_axis(list(CLAIMS))
    keys = ("claim", "source", "paper", "ours", "ours_low", "ours_high", "verdict")
    reasons = claims[claims["verdict"] != "agrees"].assign(why=lambda table: table["why"].map(_reason))
    return {
        "all": len(claims),
        **{word.replace(" ", "_"): int((claims["verdict"] == word).sum()) for word in VERDICTS},
        "rows": claims[list(keys)].to_dict("records"),
        "reasons": [
            {"why": why, "claims": rows["claim"].tolist()} for why, rows in reasons.groupby("why", sort=False)
        ],
        "spread_of_runs": spread.loc[list(RUNS)].max(),
        "paper": {key: claim.paper for key, claim in CLAIMS.items()},
        "ours": dict(zip(CLAIMS, claims["ours"], strict=True)),
        "away": dict(zip(CLAIMS, claims["ours"] / claims["paper"] - 1, strict=True)),
    }


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


def _uncertainty(tables: Tables) -> dict[str, Any]:
    budget = tables["uncertainty"].set_index("source")
    share = budget["variance_share"]
    return {
        "sampling": share["sampling"],
        "data": share["data"],
        "choice": share["choice of model"],
        "low": budget.loc["together", "ci_low"],
        "high": budget.loc["together", "ci_high"],
    }
