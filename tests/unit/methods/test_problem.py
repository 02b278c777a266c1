"""The problem: quantiles and marginals of normal scores, scores of events, strata, fingerprints."""

import os
import subprocess
import sys
from dataclasses import dataclass, replace

import mpmath
import numpy as np
import pytest
from accelerated_evaluation import CUT_IN, Problem, load_vehicle
from accelerated_evaluation.laws import Factors
from accelerated_evaluation.laws.distributions import BoundedExponential, Empirical, Pareto
from accelerated_evaluation.laws.paper.models import IndependentLaw
from accelerated_evaluation.methods.importance_sampling import Sample
from accelerated_evaluation.scenarios.left_turn import LEFT_TURN
from accelerated_evaluation.vehicles import AccAeb, Outcomes
from accelerated_evaluation.vehicles.protocol import CRASH
from fewruns.problems import SystemProblem, normal_score_quantile
from normal_law import left_turn_law
from scipy.stats import chisquare, kstest, norm

SIZE = 20_000
DOUBTFUL = 1e-3  # p-value; the seeds are fixed, and a wrong law is seen to give less than 1e-20
SHARES = {"slow": 0.5, "middle": 0.3, "fast": 0.2}
RATES = {"slow": 10.0, "middle": 15.0, "fast": 30.0}
SPEEDS = {"slow": [6.0, 8.0, 9.0], "middle": [16.0, 24.0], "fast": [26.0, 30.0, 33.0, 34.0]}


@dataclass(frozen=True)
class Echo:
    """A vehicle that crashes if TTC^-1 exceeds 0.1, and whose smallest time to collision is the first."""

    def simulate(self, lead_speed, range_, closing_speed):
        crash = closing_speed / range_ > 0.1
        return Outcomes(crash, np.where(crash, 0.0, range_), range_ / closing_speed, np.zeros(range_.size))


LAW = IndependentLaw(
    "made up",
    {"slow": 5, "middle": 3, "fast": 2},
    BoundedExponential(50.0, 1 / 75),
    {name: BoundedExponential(rate) for name, rate in RATES.items()},
    {name: Empirical(speeds) for name, speeds in SPEEDS.items()},
)
PROBLEM = Problem(CUT_IN, Echo(), law=LAW)


def normal_scores(dimension, seed=1):
    return np.random.default_rng(seed).normal(size=(SIZE, dimension))


@pytest.mark.parametrize("z", [-8.0, -3.0, 0.0, 3.0, 8.0])
def test_quantiles_are_exact_in_both_tails(z):
    with mpmath.workdps(50):
        below, above = mpmath.ncdf(z), mpmath.ncdf(-z)
        exact = {
            BoundedExponential(2.0): -mpmath.log(above) / 2,
            BoundedExponential(2.0, 1.0, 3.0): 1 - mpmath.log(1 - below * (1 - mpmath.exp(-4))) / 2,
            Pareto(3.0, 0.5): above ** (-mpmath.mpf(1) / 3) / 2,
        }
        for law, x in exact.items():
            assert float(normal_score_quantile(law, np.array([z]))[0]) == pytest.approx(float(x), rel=1e-12)


@pytest.mark.parametrize("law", [BoundedExponential(2.0), Pareto(3.0, 0.5)])
def test_the_cdf_alone_would_lose_the_upper_tail(law):
    exact, lost = normal_score_quantile(law, np.array([8.0])), law.ppf(norm.cdf(8.0))
    assert lost != pytest.approx(exact, rel=1e-4)


def test_quantiles_of_recorded_values():
    law = Empirical(np.arange(4.0))
    edges = norm.ppf([0.25, 0.5, 0.75])
    z = np.concatenate([[-8.0], edges - 1e-9, edges + 1e-9, [8.0]])
    assert normal_score_quantile(law, z).tolist() == [0, 0, 1, 2, 1, 2, 3, 3]


def test_independent_inputs_have_their_marginals():
    marginals = [BoundedExponential(2.0), Pareto(3.0, 0.5), BoundedExponential(-3.0, 1.0, 2.0)]
    event = SystemProblem(lambda x: (x[:, 0] > 1, None), 3, marginals)
    x = event.inputs(normal_scores(3))
    assert event.dimension == 3
    assert x.shape == (SIZE, 3)
    for k, law in enumerate(marginals):
        assert kstest(law.cdf(x[:, k]), "uniform").pvalue > DOUBTFUL
        assert kstest(law.cdf(x[:, k - 1]), "uniform").pvalue < 1e-20
    happened, score = event.evaluate(normal_scores(3))
    np.testing.assert_array_equal(happened, x[:, 0] > 1)
    assert score is None


def test_without_marginals_the_scores_are_the_inputs():
    z = normal_scores(2)[:50]
    event = SystemProblem(lambda x: (x[:, 0] > 1, x[:, 1]), 2)
    happened, score = event.evaluate(z)
    np.testing.assert_array_equal(happened, z[:, 0] > 1)
    np.testing.assert_array_equal(score, z[:, 1])


def test_lead_speeds_run_through_the_segments_in_their_shares():
    speed = LAW.from_normal_scores(np.sort(normal_scores(1), axis=0) * [1, 0, 0])[:, 0]
    assert (np.diff(speed) >= 0).all()
    expected = {v: SHARES[name] / len(values) for name, values in SPEEDS.items() for v in values}
    values, counts = np.unique(speed, return_counts=True)
    assert values.tolist() == [*expected]
    assert chisquare(counts, SIZE * np.array([*expected.values()])).pvalue > DOUBTFUL
    assert chisquare(counts, np.full(len(counts), SIZE / len(counts))).pvalue < 1e-20
    far = LAW.from_normal_scores(np.array([[-40.0, 0, 0], [40.0, 0, 0]]))
    assert far[:, 0].tolist() == [6.0, 34.0]


def test_the_score_of_a_cut_in_is_shown_only_where_it_is_graded():
    z = normal_scores(3)[:100]
    assert PROBLEM.dimension == 3
    happened, score = PROBLEM.evaluate(z)
    x = LAW.from_normal_scores(z)
    np.testing.assert_array_equal(np.column_stack([*PROBLEM.coordinates(z).values()]), x)
    assert [*PROBLEM.coordinates(z)] == ["lead_speed", "range", "closing_speed"]
    np.testing.assert_array_equal(happened, x[:, 2] / x[:, 1] > 0.1)
    np.testing.assert_array_equal(score, x[:, 1] / x[:, 2])
    flags, nothing = replace(PROBLEM, graded=False).evaluate(z)
    np.testing.assert_array_equal(flags, happened)
    assert nothing is None
    near, _ = replace(PROBLEM, event=CUT_IN.event("min_ttc", 20.0)).evaluate(z)
    np.testing.assert_array_equal(near, score <= 20.0)
    assert near.sum() > happened.sum()


def test_one_stratum_is_a_problem_of_its_own():
    alone = PROBLEM.only("middle")
    assert (alone.vehicle, alone.event, alone.graded) == (PROBLEM.vehicle, CRASH, True)
    assert dict(alone.law.shares) == {"middle": 1.0}
    assert set(alone.law.from_normal_scores(normal_scores(3))[:, 0]) == {16.0, 24.0}
    happened, _ = alone.evaluate(normal_scores(3))
    exact = np.exp(-15 * 0.1)
    error = np.sqrt(exact * (1 - exact) / SIZE)
    assert abs(happened.mean() - exact) < 4 * error
    everywhere, _ = PROBLEM.evaluate(normal_scores(3))
    assert abs(everywhere.mean() - exact) > 10 * error
    whole = sum(SHARES[name] * np.exp(-rate * 0.1) for name, rate in RATES.items())
    assert abs(everywhere.mean() - whole) < 4 * np.sqrt(whole * (1 - whole) / SIZE)


@pytest.mark.parametrize("name", SPEEDS)
def test_samples_of_a_stratum_have_its_lead_speeds_and_the_densities_of_f_and_f_star(name):
    f, f_star = LAW.strata[name].factors, Factors(BoundedExponential(20.0, 1 / 75), BoundedExponential(5.0))
    seen = []

    class Recorder(Echo):
        def simulate(self, lead_speed, range_, closing_speed):
            seen.append((lead_speed, range_, closing_speed))
            return super().simulate(lead_speed, range_, closing_speed)

    sample = Sample.of(Problem(CUT_IN, Recorder(), law=LAW), name, f_star, np.random.default_rng(9), SIZE)
    ((lead_speed, range_, closing_speed),) = seen
    assert set(lead_speed) == set(SPEEDS[name])
    np.testing.assert_allclose(1 / range_, sample.first, rtol=1e-12)
    np.testing.assert_allclose(closing_speed / range_, sample.second, rtol=1e-12)
    assert kstest(f_star.first.cdf(sample.first), "uniform").pvalue > DOUBTFUL
    assert kstest(f_star.second.cdf(sample.second), "uniform").pvalue > DOUBTFUL
    ratio = f.logpdf(sample.first, sample.second) - f_star.logpdf(sample.first, sample.second)
    np.testing.assert_allclose(sample.log_ratio, ratio, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(sample.happened, closing_speed / range_ > 0.1)


def test_an_event_other_than_the_crash_is_sampled():
    near = replace(PROBLEM, event=CUT_IN.event("min_ttc", 20.0))
    sample = Sample.of(near, "fast", LAW.strata["fast"].factors, np.random.default_rng(4), 2000)
    np.testing.assert_array_equal(sample.happened, sample.outcomes.min_ttc <= 20.0)
    assert sample.happened.sum() > sample.outcomes.crash.sum() > 0
    np.testing.assert_array_equal(sample.weight, sample.happened)


FINGERPRINTED = {
    "as it is": PROBLEM,
    "one stratum": PROBLEM.only("slow"),
    "another cap": replace(PROBLEM, law=replace(LAW, closing_speed_max=20.0)),
    "another distribution": replace(PROBLEM, law=replace(LAW, inverse_range=Pareto(2.0, 1 / 75))),
    "another rate": replace(PROBLEM, law=replace(LAW, inverse_range=BoundedExponential(50.0001, 1 / 75))),
    "other shares": replace(PROBLEM, law=replace(LAW, counts=LAW.counts | {"slow": 6})),
    "other speeds": replace(
        PROBLEM, law=replace(LAW, lead_speeds=LAW.lead_speeds | {"slow": Empirical([6.0, 9.0])})
    ),
    "another vehicle": replace(PROBLEM, vehicle=AccAeb()),
    "another parameter": replace(PROBLEM, vehicle=AccAeb(aeb=False)),
    "another event": replace(PROBLEM, event=CUT_IN.event("min_ttc", 2.0)),
    "not graded": replace(PROBLEM, graded=False),
    "another threshold": replace(PROBLEM, event=CUT_IN.event("min_ttc", 3.0)),
    "another scenario": Problem(LEFT_TURN, Echo(), law=left_turn_law()),
    "another limit": Problem(LEFT_TURN, Echo(), law=left_turn_law(upper=(30, 60, 150))),
    "another joint law": Problem(LEFT_TURN, Echo(), law=left_turn_law((14, 7, 61))),
}


def test_the_fingerprint_tells_problems_apart():
    found = {problem.fingerprint: name for name, problem in FINGERPRINTED.items()}
    assert sorted(found.values()) == sorted(FINGERPRINTED)
    assert Problem(CUT_IN, Echo(), law=replace(LAW)).fingerprint == PROBLEM.fingerprint
    described = replace(LAW, description="the same distribution in other words")
    assert replace(PROBLEM, law=described).fingerprint == PROBLEM.fingerprint


def test_the_fingerprint_is_that_of_another_process():
    """A state that is saved today must be known tomorrow: no address in memory may be part of it."""
    code = "import test_problem as t; print(*[p.fingerprint for p in t.FINGERPRINTED.values()], sep='\\n')"
    other = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        env=os.environ | {"PYTHONHASHSEED": "77", "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    assert other.stdout.splitlines() == [problem.fingerprint for problem in FINGERPRINTED.values()]


class Silent:
    """A vehicle that does not describe itself: Python would print its address."""

    def simulate(self, lead_speed, range_, closing_speed):
        return Echo().simulate(lead_speed, range_, closing_speed)


def test_what_does_not_describe_itself_is_named_by_its_class():
    one, other = (replace(PROBLEM, vehicle=vehicle).fingerprint for vehicle in (Silent(), Silent()))
    assert one == other
    assert ", Silent, " in one
    assert "0x" not in one


def test_the_fingerprint_of_a_users_vehicle_holds_no_address(tmp_path):
    path = tmp_path / "car.py"
    path.write_text("class Car:\n    def simulate(self, lead_speed, range_, closing_speed): ...\n")
    one, other = (replace(PROBLEM, vehicle=load_vehicle(f"{path}:Car")).fingerprint for _ in range(2))
    assert one == other
    assert "vehicle=Car," in one
    assert "0x" not in one
    assert "user_car" not in one  # the name of its module differs from process to process as well


@pytest.mark.parametrize(
    ("event", "happened", "score"),
    [
        (CRASH, [True, False, True, False], [0.5, 2.0, 0.8, np.inf]),
        (CUT_IN.event("min_range", 4.0), [True, True, True, False], [-0.1, 4.0, 0.0, 30.0]),
        (CUT_IN.event("min_ttc", 2.0), [True, True, True, False], [0.5, 2.0, 0.8, np.inf]),
        (CUT_IN.event("impact_speed", 3.0), [True, False, False, False], [-7.0, 2.0, -3.0, np.inf]),
    ],
)
def test_scores_of_events(event, happened, score):
    outcomes = Outcomes(
        np.array([True, False, True, False]),
        np.array([-0.1, 4.0, 0.0, 30.0]),
        np.array([0.5, 2.0, 0.8, np.inf]),
        np.array([7.0, 0.0, 3.0, 0.0]),
    )
    assert event.happens(outcomes).tolist() == happened
    assert event.score(outcomes).tolist() == score
