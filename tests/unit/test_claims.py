"""The paper's claims: the rule of the verdict, what is not comparable, and the paper quoted rightly."""

import copy
import math
from pathlib import Path

import pandas as pd
import pytest
from accelerated_evaluation.distributions import BoundedExponential, Empirical, PiecewiseMixture
from accelerated_evaluation.laws.paper.independent import IndependentLaw
from accelerated_evaluation.publishing.tables.claims import PREMISES, claims_table, verdict
from accelerated_evaluation.publishing.tables.formats import save_table
from accelerated_evaluation.publishing.tables.paper_claims import CLAIMS, Claim
from accelerated_evaluation.publishing.tables.spreads import Spread
from accelerated_evaluation.study.configuration import load

ROOT = Path(__file__).resolve().parents[2]
SEGMENTS = ("5-15", "15-25", "25-35")
N = {"piecewise": (7000, 8000), "single": (11000, 13000)}


@pytest.fixture
def study():
    """A study on the real events whose numbers are made up, so that some agree and some differ."""
    exponential = BoundedExponential(5.0)
    pieces = PiecewiseMixture(
        (0.5, 0.5), (BoundedExponential(1.0, 0.0, 1.0), BoundedExponential(1.0, 1.0, math.inf))
    )
    events = dict(zip(SEGMENTS, (75783, 37580, 44394), strict=True))
    models = {
        name: IndependentLaw(
            "real", events, law, dict.fromkeys(events, law), dict.fromkeys(events, Empirical([10.0]))
        )
        for name, law in (("single", exponential), ("piecewise", pieces))
    }
    rows = [(method, k, n) for method, values in N.items() for k, n in enumerate(values)]
    estimates = pd.DataFrame(rows, columns=["method", "replicate", "simulations"])
    estimates = estimates.assign(scope="all", converged=True)
    course = estimates.assign(probability=7.5e-7, variance=1e-15)
    searches = [
        (method, segment, seed, iteration, 4000 * iteration, 3.0 - iteration)
        for method in N
        for segment in SEGMENTS
        for seed in (0, 1)
        for iteration in (1, 2)
    ]
    names = ["method", "segment", "seed", "iteration", "simulations_total", "inverse_ttc_rate"]
    return {
        **models,
        "trace": pd.DataFrame(searches, columns=names),
        "estimates": estimates,
        "course": course,
        "exact": pd.DataFrame({"segment": ["all"], "probability": [7.5e-7], "standard_error": [1e-10]}),
        "config": load(),
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


def test_numbers_and_verdicts_by_hand(study):
    claims = table(study)
    assert claims.loc["piecewise", ["ours", "ours_low", "ours_high"]].tolist() == [7500, 7100, 7900]
    assert claims.loc["piecewise", "verdict"] == "agrees"
    assert claims.loc["ratio_single", "ours"] == pytest.approx(12000 / 7500)
    assert claims.loc["saving", "ours"] == pytest.approx(1 - 7500 / 12000)
    assert claims.loc["single_run", ["ours", "ours_low", "ours_high"]].tolist() == [11000, 11000, 13000]
    assert claims.loc["single_run", "verdict"] == "differs"
    assert claims.loc["saving_run", "ours"] == pytest.approx(1 - 7000 / 11000)
    assert claims.loc["search_piecewise", ["ours", "verdict"]].tolist() == [24000, "agrees"]
    assert claims.loc["search_single", ["ours", "verdict"]].tolist() == [24000, "differs"]
    assert claims.loc["fitted_single", ["ours", "verdict"]].tolist() == [4, "agrees"]
    assert claims.loc["fitted_piecewise", ["ours", "verdict"]].tolist() == [12, "differs"]
    assert claims.loc["moved_single", "ours"] == 3
    assert claims.loc["closing", ["ours", "verdict"]].tolist() == [157757, "differs"]


def test_a_probability_off_the_papers_interval_differs_and_says_how_far(study):
    assert table(study).loc["probability", "verdict"] == "agrees"
    study["exact"]["probability"] = 1.48e-6
    row = table(study).loc["probability"]
    assert row["verdict"] == "differs"
    assert row["why"].startswith("ours is 100 % above: the paper does not print its knots")


def test_a_sample_is_not_comparable_but_for_counts_of_parameters(study):
    study["config"] = load([ROOT / "config" / "smoke.yaml"])
    claims = table(study)
    counts = {key for key, claim in CLAIMS.items() if not claim.rests_on_study}
    assert set(claims.index[claims["verdict"] != "not comparable"]) == counts
    data = "Safety Pilot Model Deployment (real events), a sample of 6,000"
    why = f"data.sample is 6000, the paper's is null; data: {data}"
    assert set(claims.loc[claims["verdict"] == "not comparable", "why"]) == {why}


@pytest.mark.parametrize("key", PREMISES)
def test_every_premise_matters(study, key):
    config = copy.deepcopy(study["config"])
    *path, name = key.split(".")
    section = config
    for part in path:
        section = section[part]
    others = {
        "data.source": "table",
        "data.sample": 500,
        "vehicle.name": "acc",
        "vehicle.parameters": {"a": 1},
    }
    section[name] = others.get(key, 0.1)
    row = table(study | {"config": config}).loc["piecewise"]
    assert row["verdict"] == "not comparable"
    assert row["why"].startswith(f"{key} is ")


def test_replicates_that_did_not_converge_are_not_compared(study):
    study["estimates"].loc[0, "converged"] = False
    claims = table(study)
    assert claims.loc["piecewise", "why"] == "1 of 2 replicates of piecewise did not converge"
    assert set(claims.loc[["piecewise", "ratio_single", "saving"], "verdict"]) == {"not comparable"}
    assert claims.loc["single", "verdict"] == "agrees"


def test_all_lane_changes_have_no_like_in_the_published_records(study):
    row = table(study).loc["identified"]
    assert row["verdict"] == "not comparable"
    assert row["why"] == "the published records are the closing ones only"


def test_every_row_is_complete(study):
    claims = claims_table(**study)
    assert claims.columns.tolist() == [
        *("claim", "source", "paper", "paper_low", "paper_high", "ours", "ours_low", "ours_high"),
        *("spread", "verdict", "why"),
    ]
    assert not claims.isna().to_numpy().any()
    assert claims["paper"].between(claims["paper_low"], claims["paper_high"]).all()
    assert claims["ours"].between(claims["ours_low"], claims["ours_high"]).all()
    assert claims["claim"].is_unique
    assert (claims["why"].str.len() > 0).all()


def test_the_papers_derived_numbers_follow_from_its_others():
    paper = {key: claim.paper for key, claim in CLAIMS.items()}
    saving = 1 - paper["piecewise_run"] / paper["single_run"]
    # Both runs are rounded to hundreds: d(n/m) <= 50/m + 50 n/m^2.
    rounding = 50 / paper["single_run"] * (1 + paper["piecewise_run"] / paper["single_run"])
    derived = {
        "ratio_single": (paper["single"] / paper["piecewise"], 0),
        "ratio_crude": (paper["crude"] / paper["piecewise"], 0),
        "saving_run": (saving, rounding),
    }
    for key, (value, off) in derived.items():
        assert value == pytest.approx(paper[key], abs=CLAIMS[key].tolerance + off)
    # The one that does not follow, as its reason says.
    assert round(1 - paper["piecewise"] / paper["single"], 2) == 0.36
    assert "36 %" in CLAIMS["saving"].reason
    assert paper["saving"] == 0.33


def test_the_paper_is_quoted_rightly(stored):
    paper = stored("paper_numbers.csv").set_index("key")
    assert set(paper.index) == set(CLAIMS)
    for key, claim in CLAIMS.items():
        number, percent, _ = paper.loc[key, "printed"].partition(" %")
        assert claim.paper == pytest.approx(float(number) / (100 if percent else 1), rel=1e-12), key
        assert claim.source == paper.loc[key, "place"]


def test_the_same_study_gives_the_same_bytes(study, tmp_path):
    for folder in ("one", "two"):
        save_table(claims_table(**study), tmp_path / folder, "claims", digits=3)
    for ending in ("csv", "md", "tex"):
        one, two = ((tmp_path / folder / f"claims.{ending}").read_bytes() for folder in ("one", "two"))
        assert one == two
