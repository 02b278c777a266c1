"""The numbers of the article that the paper does not have: laws, answer, coverage, vehicles, injuries."""

import math
from collections.abc import Iterable
from typing import Any

import pandas as pd
from scipy.stats import poisson

from accelerated_evaluation.answer.calibration import HOST
from accelerated_evaluation.answer.extrapolation import ALL, CAPPED, FAR, HOST_UNSEEN, NEAR, RECORDED
from accelerated_evaluation.publishing.article.tables import Tables, typeset
from accelerated_evaluation.publishing.tables.exact import best_known

LEVELS = (50, 80, 95)  # [%], levels of the intervals of the answer
INTERVAL = tuple(f"{end}{level}" for level in LEVELS for end in ("low", "high"))
MAIN_PROBLEM, SURROGATE = "segment_5_15", "surrogate"
PUBLIC = ("nais", "nais_25", "cross_entropy", "subset", "form", "enkf")  # methods of public tools
NOMINAL = 0.8  # coverage that the intervals of the worlds should have
OWN, THEIRS = "this project", "paper"  # procedures in the benchmark of worlds
TOGETHER, PAPER_LAW = "all laws, weighted", "paper: independent"
HUMAN, DRIVER, TESTED, SERIOUS = "cc_human", "human", "under test", "MAIS3+"
CRASH = "crash: cut-in in front of the subject"
NEAR_CRASH = "near-crash: cut-in in front of the subject, rear-end conflict"


def collect(tables: Tables, benchmarks: Tables, replicates: int) -> dict[str, Any]:
    """Return the numbers that the paper does not have, nested by subject.

    ``replicates`` is the number of estimates of the study by its own sampler.
    """
    return {
        "laws": _laws(tables),
        "answer": _answer(tables),
        "worlds": _worlds(benchmarks),
        "sampler": _sampler(benchmarks),
        "own_sampler": _own_sampler(tables, replicates),
        "vehicles": _vehicles(tables),
        "counted": _counted(tables),
        "injuries": _injuries(tables),
    }


def _laws(tables: Tables) -> dict[str, Any]:
    laws = tables["laws"].set_index("law")
    cells = tables["calibration"]
    cells = cells[cells["counted"] != HOST]
    cells = {law: cells[cells["law"] == law] for law in cells["law"].unique()}
    weighted = next(iter(cells.values()))
    paper = next(rows for law, rows in cells.items() if law.startswith(PAPER_LAW))
    members = laws.drop(TOGETHER)
    refused = members.index[members["refused"]].tolist()
    kept = members[~members["refused"]]
    return {
        "scored": len(members),
        "kept": len(kept),
        "refused": [typeset(name) for name in refused],
        "paper_refused": any(name.startswith(PAPER_LAW) for name in refused),
        "gain": laws.loc[TOGETHER, "gain_inverse_ttc_0.25"],
        "gain_far": laws.loc[TOGETHER, "gain_inverse_ttc_0.45"],
        "least": kept["probability"].min(),
        "most": kept["probability"].max(),
        "cells": len(weighted),
        "outside": int((~weighted["within"]).sum()),
        "paper_outside": int((~paper["within"]).sum()),
        "paper_cells": len(paper),
    }


def _answer(tables: Tables) -> dict[str, Any]:
    answer = tables["answer"]
    crash = answer[answer["event"] == "crash"].iloc[0]
    budget = tables["answer_budget"].set_index("source")["variance_share"]
    thresholds = tables["answer_thresholds"]["probability"]
    quality = tables["data_quality"].set_index("reading")["probability"]
    changes = quality.iloc[1:] / quality.iloc[0] - 1
    return {
        "crash": crash.to_dict(),
        "levels": dict(zip(("narrow", "middle", "wide"), LEVELS, strict=True)),
        "factor80": crash["high80"] / crash["low80"],
        "events": answer[["event", "median", *INTERVAL]].to_dict("records"),
        "data": budget["data"] + budget.get("far tail", 0.0),
        "choice": budget["choice of law"],
        "sampling": budget["sampling"],
        "thresholds": thresholds.max() / thresholds.min(),
        "quality_low": changes.min(),
        "quality_high": changes.max(),
        "beyond": _beyond_records(tables["extrapolation"].set_index("part")),
        "again": _second_set(answer, int(tables["data_quality"]["events"].iloc[0])),
        "rate": crash["per_km"],
        "million_km": 1 / (1e6 * crash["per_km"]) if crash["per_km"] else None,
    }


def _beyond_records(parts: pd.DataFrame) -> dict[str, Any]:
    """Return the shares of the predicted crashes beyond the records, and the numbers of replayed records."""
    shares, whole = parts["share"], parts.loc[ALL]
    return {
        "faster_than_near": shares[NEAR] + shares[FAR],
        "faster_than_all": shares[FAR],
        "above_cap": shares[CAPPED],
        "host": shares[HOST_UNSEEN],
        "inside": parts.loc[RECORDED, "probability"],
    } | whole[["records", "recorded", "expected", "replay_low95", "replay_high95"]].to_dict()


def _second_set(answer: pd.DataFrame, size: int) -> dict[str, Any]:
    """Return which numbers of replayed crashes in other records would refute the answer.

    The number among n cut-ins is a Poisson variable. ``most`` is its 97.5 % quantile for ``size`` cut-ins at
    the upper end of the 95 % interval. ``none`` is the number of cut-ins of which at least one crashes with a
    probability of 97.5 % at the lower end, None if this is 0.
    """
    crash = answer.set_index("event").loc["crash"]
    low, high = crash["low95"], crash["high95"]
    return {
        "size": size,
        "most": int(poisson.ppf(0.975, size * high)) if high > 0 else 0,
        "none": math.ceil(-math.log(0.025) / low) if low > 0 else None,
    }


def _worlds(benchmarks: Tables) -> dict[str, Any]:
    worlds = benchmarks["worlds"].set_index(["procedure", "kind"])
    own, theirs = worlds.loc[OWN], worlds.loc[THEIRS]
    return {
        "kinds": len(own),
        "worlds": own["worlds"].iloc[0],
        "least": own["coverage80"].min(),
        "most": own["coverage80"].max(),
        "paper_least": theirs["coverage80"].min(),
        "paper_most": theirs["coverage80"].max(),
        "beyond": _worlds_beyond(benchmarks, own.index),
    }


def _worlds_beyond(benchmarks: Tables, usual: Iterable[str]) -> dict[str, Any]:
    """Return the kinds of worlds beyond the family in which the intervals cover, and the others.

    The intervals fail in a kind if the whole 95 % interval of its coverage is below the nominal level.
    """
    worlds = benchmarks["worlds_beyond"].query("procedure == 'map'")
    worlds = worlds[~worlds["kind"].isin(usual)]
    fails = worlds["coverage80_high"] < NOMINAL
    return {
        "fewest": worlds["worlds"].min(),
        "kinds": len(worlds),
        "least": worlds["coverage80"].min(),
        "most": worlds["coverage80"].max(),
        "covered": worlds.loc[~fails, "kind"].tolist(),
        "failed": worlds.loc[fails, ["kind", "coverage80", "median_ratio"]].to_dict("records"),
    }


def _sampler(benchmarks: Tables) -> dict[str, Any]:
    samplers = benchmarks["samplers"]
    ours = samplers[samplers["method"] == SURROGATE]
    main = samplers[samplers["problem"] == MAIN_PROBLEM].set_index("method")
    own = main.loc[SURROGATE]
    public = main.loc[[name for name in PUBLIC if name in main.index]]
    reached = public[public["failed"] == 0].nsmallest(1, "effective_calls").iloc[0]
    successors, whole = benchmarks["successors"], benchmarks["answers"].set_index("vehicle").loc["acc_aeb"]
    return {
        "calls": own["calls_mean"],
        "p95": own["calls_p95"],
        "seeds": own["seeds"],
        "failed": round(own["failed"] * own["seeds"]),
        "error": own["error"],
        "coverage": own["coverage80"],
        "piecewise": main.loc["piecewise", "calls_mean"],
        "public": reached["calls_mean"],
        "crude": main.loc["crude", "calls_mean"],
        "problems": len(ours),
        "saved": 1 - successors["simulations"].mean() / successors["simulations_alone"].mean(),
        "answer_runs": whole["runs_mean"],
        "answer_seeds": whole["seeds"],
    }


def _own_sampler(tables: Tables, replicates: int) -> dict[str, Any]:
    """Return the numbers of simulations that the sampler needed in this study, for all segments together."""
    methods = tables["surrogate"].query("scope == 'all'").set_index("method")
    ours, piecewise = methods.loc[SURROGATE], methods.loc["piecewise"]
    return {
        "calls": ours["together"],
        "piecewise": piecewise["together"],
        "replicates": replicates,
        "to_exact": ours["to_exact"],
        "unseen": ours["unseen_mode"],
    }


def _vehicles(tables: Tables) -> dict[str, Any]:
    columns = [
        "vehicle",
        "median",
        "low80",
        "high80",
        "low95",
        "high95",
        "ratio",
        "ratio_low80",
        "ratio_high80",
    ]
    vehicles = tables["vehicles"]
    labelled = vehicles.set_index("vehicle")
    return {
        "rows": vehicles[[*columns, "safer", "resolved"]].to_dict("records"),
        "human": HUMAN in labelled.index,
        "tested": labelled.loc[TESTED].to_dict(),
    }


def _counted(tables: Tables) -> dict[str, Any]:
    rates = tables["counted_crashes"]
    predicted = rates[rates["kind"] == "predicted"]
    counted = rates[rates["who"] == "100-Car"].set_index("what")
    by = predicted.set_index("who")["in_hundred_car"]
    too_many = predicted.loc[predicted["verdict"] == "more than were counted", "who"]
    return {
        "million_miles": counted.loc[CRASH, "million_miles"],
        "crashes": counted.loc[CRASH, "count"],
        "near_crashes": counted.loc[NEAR_CRASH, "count"],
        "known": not predicted.empty,
        "tested": by.get(TESTED),
        "human": by.get(HUMAN),
        "too_many": too_many.tolist(),
        "compatible": [who for who in predicted["who"] if who not in set(too_many)],
        "driver": _driver(tables["human_predictions"]),
    }


def _driver(predictions: pd.DataFrame) -> dict[str, Any] | None:
    """Return the predicted and counted events of the driver from data; None if no number can be predicted."""
    rows = predictions[predictions["driver"] == DRIVER].set_index("event")
    if rows["expected"].isna().all():
        return None
    columns = ["expected", "low90", "high90", "counted", "verdict"]
    events = {"crash": "crash", "near": "near-crash, 0.5 g"}
    return {"level": 90} | {key: rows.loc[event, columns].to_dict() for key, event in events.items()}


def _injuries(tables: Tables) -> dict[str, Any]:
    """Return the injured drivers of the vehicle under test by level, and compared with the careful human."""
    rows = best_known(tables["injuries"])
    rows = rows[rows["vehicle"] == TESTED]
    budget = tables["injury_budget"].set_index(["level", "source"])["variance_share"]
    shares = [budget.get((level, "choice of curve")) for level in rows["level"]]
    balance = tables["risk_balance"]
    human = balance[(balance["reference"] == HUMAN) & (balance["level"] == SERIOUS)]
    columns = ["level", "median", "low80", "high80", "per_crash"]
    return {
        "per": rows["per"].iloc[0] if len(rows) else None,
        "rows": rows[columns].assign(curve=shares).to_dict("records"),
        "serious": SERIOUS,
        "human": None if human.empty else human.iloc[0].to_dict(),
        "curves": len(tables["injury_curves"]),
    }
