"""The comparison of samplers: its problems against exact answers, its count of calls, its table by hand."""

import json
import math
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from fewruns.certificate import BY_DEFAULT
from scipy.integrate import quad
from scipy.special import ndtr
from scipy.stats import chi2, norm

pytestmark = pytest.mark.studies
ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "benchmarks" / "samplers"))  # before folders that have a run.py, too

import house  # noqa: E402
import methods  # noqa: E402
import reference  # noqa: E402
import successors  # noqa: E402
import summarise  # noqa: E402
from methods import Counter, Target  # noqa: E402
from problems import problems  # noqa: E402

BENCHMARK = json.loads((ROOT / "tests/data/benchmark_problem.json").read_text())
COMPARED = [problem for problem in problems().values() if not problem.ours_only]
NAMES = [problem.name for problem in COMPARED]


@pytest.fixture
def small(monkeypatch):
    """References with 600,000 simulations instead of eight million, of events no rarer than exp(-30)."""
    for name, value in {"BATCH": 20_000, "PILOT": 15, "FINAL": 15, "REACH": 30.0}.items():
        monkeypatch.setattr(reference, name, value)


def test_main_problem_has_the_probability_of_the_benchmark(small):
    known = BENCHMARK["reference_probability"]
    found, error = reference.reference(problems()["segment_5_15"].event, np.random.default_rng(1))
    assert error < 0.01 * known
    # v_L comes from a table of quantiles of the speeds of the benchmark: 0.2 %.
    assert found == pytest.approx(known, abs=4 * error + 0.002 * known)


def test_limit_states_have_their_exact_probabilities(small):
    along = quad(lambda t: 2 * norm.pdf(t) * ndtr(-5 - 0.2 * t**2), -4.5, 4.5, epsabs=1e-14)[0]
    exact = {
        "two_regions": norm.sf(4.2) + norm.sf(4.5),
        "circle": chi2.sf(25, 2),
        "four_branches": 2 * ndtr(-4.5) + along,
    }
    for name, value in exact.items():
        problem = problems()[name]
        assert problem.exact is None or problem.exact == pytest.approx(value, rel=1e-12)
        found, error = reference.reference(problem.event, np.random.default_rng(2))
        assert error < 0.01 * value
        assert found == pytest.approx(value, abs=4 * error)
        if name == "two_regions":  # who finds the nearer region alone is reported apart
            assert found - norm.sf(4.2) > 4 * error


@pytest.mark.parametrize("name", NAMES)
def test_levels_are_at_most_zero_in_the_event_and_only_there(name):
    problem = problems()[name]
    z = reference.draw_wide(np.random.default_rng(3), 20_000, problem.event.dimension)
    happened, _ = problem.event.evaluate(z)
    assert 0 < happened.sum() < len(z)
    for kind in ({}, {"smooth": True}):
        level = Counter(math.inf).level(problem, **kind)(z)
        np.testing.assert_array_equal(level <= 0, happened)


def test_near_misses_are_the_event_that_the_papers_methods_estimate():
    problem = problems()["near_miss_1e-3"]
    z = reference.draw_wide(np.random.default_rng(5), 2000, 3)
    happened, _ = problem.event.evaluate(z)
    np.testing.assert_array_equal(problem.cut_in.evaluate(z)[0], happened)
    crashes = problem.cut_in.simulate(problem.cut_in.law.from_normal_scores(z)).crash
    assert happened[crashes].all()
    assert happened.sum() > crashes.sum()


def test_variants_of_the_car_are_sampled_without_repeats_and_without_a_cover():
    """The event states that it is an upper set and that the car repeats itself."""
    generator = np.random.default_rng(1)
    sampler = successors.driven(successors.event_of({}), generator, None)[0]
    assert sampler.has_converged(successors.TARGET)
    assert len(sampler.progress.repeats) == 0
    assert sampler.required == BY_DEFAULT


def test_counter_counts_every_call_and_refuses_those_beyond_the_limit():
    problem, counter = problems()["weak_aeb"], Counter(40)
    z = np.zeros((7, 3))
    counter.event(problem.event).evaluate(z)
    counter.level(problem, smooth=True)(z)
    counter.cut_in(problem.cut_in).vehicle.simulate(*np.full((3, 11), 10.0))
    assert counter.calls == 25
    with pytest.raises(RuntimeError, match="more than 40"):
        counter.event(problem.event).evaluate(np.zeros((16, 3)))
    assert counter.calls == 25


def test_a_method_that_breaks_down_has_an_outcome():
    @methods.adapter
    def broken(problem, counter, generator, target):
        counter.event(problem.event).evaluate(np.zeros((3, 2)))
        raise ZeroDivisionError

    outcome = broken(problems()["circle"], np.random.default_rng(6), Target())
    assert math.isnan(outcome.probability)
    assert (outcome.calls, outcome.converged) == (3, False)


def test_summary_by_hand():
    runs = pd.DataFrame(
        {
            "probability": [0.8e-6, 1.2e-6, 1.0e-6, 3.0e-6, 0.0, math.nan],
            "ci_low": [0.6e-6, 1.1e-6, 0.9e-6, 1.0e-6, 0.0, math.nan],
            "ci_high": [1.0e-6, 1.3e-6, 1.1e-6, 5.0e-6, 1.0e-7, math.nan],
            "calls": [100, 100, 200, 200, 300, 300],
            "converged": [True, True, True, True, False, False],
            "ci95_low": [0.5e-6, 0.9e-6, 0.8e-6, 0.5e-6, 0.0, math.nan],
            "ci95_high": [1.1e-6, 1.4e-6, 1.2e-6, 7.0e-6, 2.0e-7, math.nan],
        }
    )
    row = summarise.summary(runs, 1e-6)
    assert (row["seeds"], row["calls_mean"]) == (6, 200)
    assert row["bias"] == pytest.approx(0.2)  # of 0.8, 1.2, 1, 3, 0
    assert row["cov"] == pytest.approx(math.sqrt((0.4**2 + 0 + 0.2**2 + 1.8**2 + 1.2**2) / 4))
    assert row["error"] == pytest.approx(math.sqrt((0.2**2 + 0.2**2 + 0 + 2**2 + 1) / 5))
    assert row["failed"] == pytest.approx(3 / 6)  # three times too much, zero, and nothing
    assert row["coverage80"] == pytest.approx(3 / 6)
    assert row["coverage95"] == pytest.approx(4 / 6)
    assert row["claimed"] == pytest.approx(1 / 3)
    assert row["effective_calls"] == pytest.approx(200 * (row["error"] / (0.2 / 1.2815516)) ** 2)


def test_table_adds_crude_monte_carlo_by_theory():
    run = {"method": "nais", "probability": 1e-3, "ci_low": 0.0, "ci_high": 1.0, "calls": 900}
    run |= {"converged": True, "ci95_low": 0.0, "ci95_high": 1.0}
    runs = pd.DataFrame([{"problem": name} | run for name in ("circle", "weak_aeb") for _ in range(3)])
    known = {"probability": 1e-3, "standard_error": 0.0}
    table = summarise.table(runs, {"circle": known, "weak_aeb": known})
    assert table.columns[:11].to_list() == [
        *("problem", "method", "seeds", "calls_mean", "calls_p95", "cov", "bias", "failed", "coverage80"),
        *("coverage95", "claimed"),
    ]
    crude = table[table["method"] == "crude"]
    assert crude["seeds"].to_list() == [0, 0]
    np.testing.assert_allclose(crude["calls_mean"], (1.2815516 / 0.2) ** 2 * 999, rtol=1e-6)
    assert crude["failed"].isna().all()


def test_rows_that_were_not_made_anew_are_kept():
    kept = pd.DataFrame(
        [("circle", "crude", 0, 7.0), ("weak_aeb", "nais", 200, 1.0), ("weak_aeb", "crude", 200, 2.0)],
        columns=["problem", "method", "seeds", "calls_mean"],
    )
    new = pd.DataFrame(
        [("weak_aeb", "form", 20, 3.0), ("weak_aeb", "crude", 0, 4.0), ("weak_aeb", "nais", 40, 5.0)],
        columns=kept.columns,
    )
    both = summarise.with_kept(new, kept)
    # In the order of the problems and methods; theory does not replace crude Monte Carlo that was run.
    assert both.to_numpy().tolist() == [
        ["weak_aeb", "nais", 40, 5.0],
        ["weak_aeb", "form", 20, 3.0],
        ["weak_aeb", "crude", 200, 2.0],
        ["circle", "crude", 0, 7.0],
    ]


def test_crude_monte_carlo_meets_its_target():
    problem, target = problems()["near_miss_1e-3"], Target(beta=0.3, maximum_simulations=2_000_000)
    outcome = house.house("crude")(problem, np.random.default_rng(8), target)
    assert outcome.converged
    # 1.013e-3, by its own reference; about 20 events: four standard errors.
    assert outcome.probability == pytest.approx(1.013e-3, rel=4 * target.cov)
    assert outcome.ci_high - outcome.ci_low <= 2 * 0.3 * outcome.probability


def test_paper_counts_the_search_and_the_estimate():
    outcome = house.house("single")(problems()["near_miss_1e-3"], np.random.default_rng(9), Target())
    assert outcome.converged
    assert outcome.calls > 2 * house.SEARCH_SAMPLE
    assert outcome.probability == pytest.approx(1.013e-3, rel=4 * Target().cov)


def test_public_tools_repeat_themselves_and_count_every_level():
    pytest.importorskip("openturns", reason="needs the extra peers")
    import peers

    first, again, other = (
        peers.nais(problems()["circle"], np.random.default_rng(seed), Target()) for seed in (10, 10, 11)
    )
    assert first == again != other
    assert first.calls % 300 == 0
    assert first.ci_low < first.probability < first.ci_high


def test_directions_and_lines_are_exact_for_their_shapes_and_only_there():
    pytest.importorskip("openturns", reason="needs the extra peers")
    import peers

    def ratio(method, name):
        outcome = method(problems()[name], np.random.default_rng(3), Target())
        return outcome.probability / problems()[name].exact

    assert ratio(peers.directional, "circle") == pytest.approx(1, rel=1e-4)  # the accuracy of roots
    assert ratio(peers.line, "plane_6") == pytest.approx(1, rel=1e-4)
    assert ratio(peers.line, "two_regions") < 0.9  # the other region is missed
    assert peers.beyond_root(lambda x: 2.0 - x, 3.0) == pytest.approx(ndtr(-2), rel=1e-4)
    assert peers.beyond_root(lambda x: 1.0, 3.0) == 0
    assert peers.beyond_root(lambda x: -1.0, 3.0) == 1
