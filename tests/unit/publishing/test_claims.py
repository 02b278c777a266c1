"""The paper's claims: the rule of the verdict, what is not comparable, and the paper quoted rightly."""

import math
import shutil
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest
from accelerated_evaluation.laws.distributions import BoundedExponential, PiecewiseMixture
from accelerated_evaluation.methods.cross_entropy.method import CONSTANTS
from accelerated_evaluation.publishing.tables.claims import PREMISES, claims_table, verdict
from accelerated_evaluation.publishing.tables.paper_claims import (
    ABOVE,
    CLAIMS,
    COUNT,
    DERIVED,
    NUMBERS,
    STATEMENTS,
    Claim,
)
from accelerated_evaluation.publishing.tables.readings import readings_table
from accelerated_evaluation.publishing.tables.spreads import Spread, exactly
from accelerated_evaluation.records.sources import describe
from accelerated_evaluation.study.configuration import load
from accelerated_evaluation.study.limits import value_of
from builders import two_laws
from claim_places import contradicted

ROOT = Path(__file__).resolve().parents[3]
PUBLISHED = ROOT / "figures" / "spmd" / "tables"
SEGMENTS = ("5-15", "15-25", "25-35")
N = {"piecewise": (7000, 8000), "single": (11000, 13000)}


@pytest.fixture
def study():
    """A study on the real events whose numbers are made up, so that some agree and some differ."""
    models = two_laws(dict(zip(SEGMENTS, (75783, 37580, 44394), strict=True)))
    rows = [(method, k, n) for method, values in N.items() for k, n in enumerate(values)]
    estimates = pd.DataFrame(rows, columns=["method", "replicate", "simulations"])
    estimates = estimates.assign(scope="all", converged=True)
    coverage = pd.DataFrame({"method": list(N), "stopping": "sequential", "replicates": 1000})
    coverage = coverage.assign(simulations_mean=[7500.0, 9500.0], simulations_sd=[300.0, 300.0])
    course = estimates.assign(probability=7.5e-7, variance=1e-15)
    searches = [
        (method, segment, seed, iteration, 4000 * iteration, 3.0 - iteration)
        for method in (*N, "heuristic")
        for segment in SEGMENTS
        for seed in (0, 1)
        for iteration in (1, 2)
    ]
    names = ["method", "segment", "seed", "iteration", "simulations_total", "inverse_ttc_rate"]
    trace = pd.DataFrame(searches, columns=names)
    moved = (trace["method"] == "heuristic") * 0.05 * trace["iteration"]
    trace["inverse_ttc_from_2"] = (0.17 + moved).where(trace["method"] != "single")
    return {
        **models,
        "two_pieces": models["piecewise"],
        "three_pieces": models["piecewise"],
        "trace": trace,
        "estimates": estimates,
        "coverage": coverage,
        "course": course,
        "exact": pd.DataFrame({"segment": ["all"], "probability": [7.5e-7], "standard_error": [1e-10]}),
        **of(load()),
        **evidence(),
    }


def of(config):
    """Return what the table of claims uses of a configuration."""
    sampling = config["importance_sampling"]
    return {
        "premises": {key: value_of(config, key) for key in PREMISES},
        "source": describe(config["data"]),
        "alpha": sampling["alpha"],
        "beta": sampling["beta"],
    }


def evidence():
    """Return made-up tables by which the statements are judged: the paper is right in half of them."""
    dependence = pd.DataFrame(
        {"segment": "5-15", "pair": ["a vs b", "a vs c"], "tau": [0.1, -0.3]}
        | {"ci_low": [-0.1, -0.4], "ci_high": [0.3, -0.2]}
    )
    candidates = pd.DataFrame(
        [
            ("inverse_range", "all", "Pareto", -9.0),
            ("inverse_range", "all", "gamma", -8.0),
            ("inverse_range", "all", "piecewise (2 pieces)", -99.0),
            ("inverse_ttc", "5-15", "exponential", -7.0),
            ("inverse_ttc", "5-15", "gamma", -8.0),
        ],
        columns=["variable", "segment", "family", "aic"],
    )
    similarity = pd.DataFrame(
        {"quantile": [0.5, 0.95], "largest_in": "5-15", "smallest_in": "25-35", "largest": 0.2}
        | {"smallest": 0.1, "ratio": [1.0, 2.0], "ci_low": [0.9, 1.9], "ci_high": [1.1, 2.1]}
    )
    repeated = [
        (method, updates, seed, search, needed + seed, change + 0.001 * seed, 0.2 + 0.01 * seed)
        for method, search, needed, change in (
            ("single", 6000, 300.0, 0.01),
            ("piecewise", 7000, 200.0, 0.01),
            ("heuristic", 7000, 100.0, 0.3),
            ("shifted", 9000, 50.0, 0.3),
        )
        for updates in (2, 12)
        for seed in (0, 1, 2)
    ]
    names = ["method", "crash_updates", "seed", "simulations", "needed"]
    names += ["change_inverse_ttc", "change_inverse_range"]
    variation = [
        (method, seed, "all", variation + 0.01 * seed)
        for method, variation in (("piecewise", 12.0), ("single", 16.0))
        for seed in (0, 1)
    ]
    return {
        "dependence": dependence,
        "candidates": candidates,
        "similarity": similarity,
        "repeated_searches": pd.DataFrame(repeated, columns=names),
        "variation": pd.DataFrame(variation, columns=["method", "seed", "segment", "variation_trimmed"]),
    }


def table(study):
    return claims_table(**study).set_index(pd.Index(list(CLAIMS)))


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [(9, 11, "agrees"), (10.5, 12, "agrees"), (10.6, 12, "differs"), (8, 9.5, "agrees"), (8, 9.4, "differs")],
)
def test_verdict_widens_our_spread_by_the_papers_rounding(low, high, expected):
    claim = Claim("a number", "table I", paper=10, tolerance=0.5, reason="")
    assert verdict(claim, Spread((low + high) / 2, low, high, "")) == expected


@pytest.mark.parametrize(
    ("low", "high", "expected"), [(9, 11, "undecided"), (10.1, 12, "agrees"), (8, 9.9, "differs")]
)
def test_a_claim_that_something_is_larger_can_be_undecided(low, high, expected):
    claim = Claim("larger", "section I", paper=10, tolerance=0, reason="", kind=ABOVE)
    assert verdict(claim, Spread(10.0, low, high, "")) == expected


@pytest.mark.parametrize(("ours", "expected"), [(10.4, "agrees"), (10.6, "differs")])
def test_a_number_without_a_spread_is_compared_itself(ours, expected):
    claim = Claim("a number", "table I", paper=10, tolerance=0.5, reason="")
    assert verdict(claim, exactly(ours, "none")) == expected


def test_numbers_and_verdicts_by_hand(study):
    """A mean of two replicates has a standard deviation of 300 / sqrt(2) around the mean of a thousand."""
    claims = table(study)
    assert claims.loc["piecewise", ["ours", "verdict"]].tolist() == [7500, "agrees"]
    low, high = claims.loc["piecewise", ["ours_low", "ours_high"]]
    assert (low, high) == pytest.approx((7500 - 416, 7500 + 416), abs=1.5)
    assert claims.loc["single", ["ours", "verdict"]].tolist() == [12000, "differs"]
    # By the exact variances, and not by the two replicates, whose ratio is 12000 / 7500.
    exact = claims.loc["ratio_single", "ours"]
    assert exact == pytest.approx(256.16 / 144.12, abs=1e-3)
    assert (
        claims.loc["saving", "ours"] == claims.loc["half", "ours"] == pytest.approx(1 - 1 / exact, abs=1e-3)
    )
    assert claims.loc["single_run", ["ours", "verdict"]].tolist() == [11000, "differs"]
    assert claims.loc["single_run", "ours_high"] == pytest.approx(9500 + 1.962 * 300, abs=1)
    assert claims.loc["saving_run", "ours"] == pytest.approx(1 - 7000 / 11000)
    # The paper's searches stop by another rule.
    assert claims.loc["search_piecewise", ["ours", "verdict"]].tolist() == [24000, "not comparable"]
    assert claims.loc["search_single", ["ours", "verdict"]].tolist() == [24000, "not comparable"]
    assert claims.loc["fitted_single", ["ours", "why"]].tolist() == [4, "the same number"]
    assert claims.loc["fitted_piecewise", ["ours", "verdict"]].tolist() == [12, "count"]
    assert claims.loc["moved_single", "ours"] == 3
    assert claims.loc["closing", ["ours", "verdict"]].tolist() == [157757, "count"]


def test_statements_and_verdicts_by_hand(study):
    claims = table(study)
    found = claims.loc[list(STATEMENTS), ["ours", "verdict"]].T.to_dict("list")
    crude = 1.2815515655446004**2 / 0.04 * (1 / 7.5e-7 - 1)
    needed = [1.2815515655446004**2 / 0.04 * (12.0**2 + 12.01**2) / 2, None]
    assert found == {
        "independent": [-0.3, "differs"],
        "pareto": [1, "agrees"],  # the piecewise mixtures are not among the common families
        "exponential": [2, "differs"],
        "similar": [2.0, "differs"],
        "same_tail": [1.0, "agrees"],
        "settled_ttc": [pytest.approx(0.011), "agrees"],
        "settled_range": [pytest.approx(0.21), "differs"],
        "same_estimate": [pytest.approx(1.0), "agrees"],
        "faster_search": [pytest.approx((6000 + 301) / (7000 + 201)), "differs"],
        "faster_all": [pytest.approx(1.15, abs=0.02), "agrees"],
        "half": [pytest.approx(1 - 144.12 / 256.16, abs=1e-3), "agrees"],
        "faster": [pytest.approx(crude / needed[0]), "differs"],
        "orders": [pytest.approx(math.log10(crude / needed[0])), "agrees"],
        "heuristic": [pytest.approx(201 / 101), "agrees"],
        "shifted": [pytest.approx(201 / 51), "agrees"],
    }
    assert claims.loc["independent", "spread"].endswith("1 of 2 intervals exclude 0")
    assert claims.loc["pareto", "spread"] == "none; ranks among 3 families: 1 (all)"


def test_tails_of_different_rates_are_not_the_same(study):
    """The knot of three pieces leaves the tail a tenth of the records, and another rate."""
    pieces = [BoundedExponential(1.0, 0.0, 1.0), BoundedExponential(1.0, 1.0, 2.0)]
    for rate, expected in ((1.01, "agrees"), (1.05, "differs")):
        tail = PiecewiseMixture((0.5, 0.4, 0.1), (*pieces, BoundedExponential(rate, 2.0, math.inf)))
        three = replace(study["two_pieces"], inverse_range=tail)
        row = table(study | {"three_pieces": three}).loc["same_tail"]
        assert row[["ours", "verdict"]].tolist() == [pytest.approx(rate), expected]
        error = math.sqrt(1 / 15775.7 - 1 / 78878.5)
        assert math.log(row["ours_high"] / row["ours"]) == pytest.approx(1.96 * error, rel=1e-4)


def test_a_probability_off_the_papers_interval_differs_and_says_how_far(study):
    row = table(study).loc["probability"]
    assert row["verdict"] == "agrees"
    assert math.isnan(row["ours_low"])  # an exact number has no spread
    study["exact"]["probability"] = 1.48e-6
    row = table(study).loc["probability"]
    assert row["verdict"] == "differs"
    assert row["why"].startswith("ours is 100 % above: the paper does not print its knots")


def test_a_sample_is_not_comparable_but_for_counts_of_parameters(study):
    study |= of(load([ROOT / "config" / "smoke.yaml"]))
    claims = table(study)
    counts = {key for key, claim in CLAIMS.items() if not claim.rests_on_study}
    assert set(claims.index[claims["verdict"] != "not comparable"]) == counts
    data = "Safety Pilot Model Deployment (real events), a sample of 6,000"
    why = f"data.sample is 6000, the paper's is null; data: {data}"
    assert set(claims.loc[claims["verdict"] == "not comparable", "why"]) == {why}


@pytest.mark.parametrize("key", PREMISES)
def test_every_premise_matters(study, key):
    others = {
        "data.source": "table",
        "data.sample": 500,
        "vehicle.name": "acc",
        "vehicle.parameters": {"a": 1},
    }
    study["premises"][key] = others.get(key, 0.1)
    row = table(study).loc["piecewise"]
    assert row["verdict"] == "not comparable"
    assert row["why"].startswith(f"{key} is ")


def test_replicates_that_did_not_converge_are_not_compared(study):
    study["estimates"].loc[0, "converged"] = False
    claims = table(study)
    assert claims.loc["piecewise", "why"] == "1 of 2 replicates of piecewise did not converge"
    assert set(claims.loc[["piecewise", "piecewise_run", "saving_run"], "verdict"]) == {"not comparable"}
    assert claims.loc["single", "verdict"] == "differs"
    assert claims.loc["ratio_single", "verdict"] != "not comparable"  # it comes from exact variances


def test_a_heuristic_that_never_acts_is_not_compared_with_itself(study):
    """If no knot moves in the first segment, the method is piecewise; moves in another one do not matter."""
    still = study["trace"]["method"] == "heuristic"
    study["trace"].loc[still, "inverse_ttc_from_2"] = 0.17
    study["trace"].loc[still & (study["trace"]["segment"] == "25-35"), "inverse_ttc_from_2"] = [0.1, 0.2] * 2
    row = table(study).loc["heuristic"]
    assert row["verdict"] == "cannot be tested"
    assert row["why"].startswith("in the first segment no iteration has too few events")
    assert table(study).loc["shifted", "verdict"] == "agrees"


def test_all_lane_changes_have_no_like_in_the_published_records(study):
    row = table(study).loc["identified"]
    assert row["verdict"] == "not comparable"
    assert row["why"] == "the published records are the closing ones only"


def test_every_row_is_complete(study):
    claims = claims_table(**study)
    assert claims["key"].tolist() == list(CLAIMS)
    assert claims.columns.tolist() == [
        *("key", "claim", "source", "paper", "paper_low", "paper_high", "ours", "ours_low", "ours_high"),
        *("spread", "verdict", "why", "table", "rows", "formula"),
    ]
    spread = claims[["ours_low", "ours_high"]]
    assert not claims.drop(columns=spread.columns).isna().to_numpy().any()
    assert claims["paper"].between(claims["paper_low"], claims["paper_high"]).all()
    assert (spread["ours_low"] < spread["ours_high"]).equals(spread["ours_low"].notna())  # none has no width
    kinds = pd.Series([claim.kind for claim in CLAIMS.values()])
    for kind in (DERIVED, COUNT):
        assert spread[kinds == kind].isna().to_numpy().all()
        assert set(claims.loc[kinds == kind, "verdict"]) <= {kind, "not comparable"}
    assert claims["claim"].is_unique
    assert (claims["why"].str.len() > 0).all()


def test_the_number_of_every_claim_stands_where_the_table_says(tmp_path):
    assert contradicted(PUBLISHED) == []
    copied = shutil.copytree(PUBLISHED, tmp_path / "tables")
    needed = pd.read_csv(copied / "needed.csv")
    needed.loc[needed["method"] == "single", "simulations"] *= 1.001
    needed.to_csv(copied / "needed.csv")
    assert contradicted(copied) == ["ratio_single", "saving", "faster_all", "half"]


def test_readings_give_the_effects_of_the_study(study):
    choices = [("model", "single", 6e-6), ("knot of TTC^-1", "0.9", 3e-7), ("knot of TTC^-1", "0.99", 3e-6)]
    sensitivity = pd.DataFrame(choices, columns=["choice", "value", "probability"])
    trace = pd.DataFrame({"threshold_ttc_s": [math.nan, 2.0, 0.0], "simulations": [0, 1000, 3000]})
    estimates = study["estimates"].assign(events=[130, 120, 110, 100])
    estimates.loc[3, "converged"] = False
    tables = {"trace": trace, "estimates": estimates, "sensitivity": sensitivity}
    names, config = ("exact", "repeated_searches"), load()
    settings = {
        "search": CONSTANTS | config["cross_entropy"],
        "sampling": config["importance_sampling"],
        "cap": config["models"]["closing_speed_max"],
    }
    effects = readings_table(**tables, **settings, **{name: study[name] for name in names})["effect"].tolist()
    for expected in (
        "knot of TTC^-1: probability x0.40 to x4",
        "under the single f: probability x8",
        "1 of 2 iterations simulated more than N",
        "after 12 instead of 2 updates, piecewise needs x1 simulations",
        "piecewise and single stopped with at least 110 crashes",
    ):
        assert expected in effects
    study["exact"]["probability"] = 0.0
    estimates["converged"] = False
    never = readings_table(**tables, **settings, **{name: study[name] for name in names})["effect"]
    assert not never.str.contains("nan|inf").any()


def test_the_paper_is_quoted_rightly(stored):
    paper = stored("paper_numbers.csv").set_index("key")
    assert set(paper.index) == set(NUMBERS)
    for key, claim in NUMBERS.items():
        number, percent, _ = paper.loc[key, "printed"].partition(" %")
        assert claim.paper == pytest.approx(float(number) / (100 if percent else 1), rel=1e-12), key
        assert claim.source == paper.loc[key, "place"]


def test_a_vehicle_that_always_crashes_needs_no_simulations(study):
    study["exact"] = study["exact"].assign(probability=1.0)
    table = claims_table(**study).set_index("claim")
    faster = table[table.index.str.contains("times faster than crude Monte Carlo")]
    assert (faster["ours"] == 0).any()
    study["variation"] = study["variation"].assign(variation_trimmed=0.0)
    assert claims_table(**study).set_index("claim").loc[faster.index, "ours"].isna().any()
