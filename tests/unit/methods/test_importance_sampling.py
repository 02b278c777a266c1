"""Estimates against exact sums, closed forms and their own coverage."""

import math
from fractions import Fraction

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import CUT_IN, Problem, Stopping
from accelerated_evaluation.laws import Factors
from accelerated_evaluation.laws.distributions import BoundedExponential, Empirical
from accelerated_evaluation.laws.paper.models import IndependentLaw
from accelerated_evaluation.methods import METHODS
from accelerated_evaluation.methods.cross_entropy.search import Proposals
from accelerated_evaluation.methods.importance_sampling import (
    Running,
    course_table,
    crude_simulations,
    draw_weights,
    estimate_from_weights,
    first_converged,
    run_to_convergence,
    running,
)
from accelerated_evaluation.vehicles import Outcomes
from scipy import stats

INVERSE_RANGE = BoundedExponential(50.0, 1 / 75)
THRESHOLD = 1.0  # [1/s], of TTC^-1
STOPPING = Stopping(alpha=0.2, beta=0.2, minimum_events=30, maximum_simulations=1800)


class Toy:
    """A vehicle that crashes if and only if TTC^-1 is above the threshold."""

    def simulate(self, lead_speed, range_, closing_speed):
        assert range_.size, "nothing to simulate"
        crash = closing_speed / range_ > THRESHOLD
        return Outcomes(
            crash, np.where(crash, 0.0, range_), np.full(range_.size, np.inf), np.zeros(range_.size)
        )


def accelerated(probabilities, slower=1.0, events=None):
    """Return a problem of segments with known crash probabilities, and f* with TTC^-1 so much larger."""
    names = [f"{probability:g}" for probability in probabilities]
    rates = [-math.log(probability) / THRESHOLD for probability in probabilities]
    law = IndependentLaw(
        "toy",
        dict(zip(names, events or [1] * len(names), strict=True)),
        INVERSE_RANGE,
        {name: BoundedExponential(rate) for name, rate in zip(names, rates, strict=True)},
        dict.fromkeys(names, Empirical([20.0])),
    )
    proposals = {
        name: Factors(INVERSE_RANGE, BoundedExponential(rate / slower))
        for name, rate in zip(names, rates, strict=True)
    }
    return Problem(CUT_IN, Toy(), law=law), proposals


def crash_weights(size, seed=1, events=0.2):
    generator = np.random.default_rng(seed)
    return np.where(generator.random(size) < events, 1e-7 * generator.lognormal(0, 1, size), 0.0)


def test_running_is_the_estimate_at_every_number_of_simulations():
    weights = np.concatenate([np.zeros(10), crash_weights(300, events=0.05)])
    course = running(weights, 0.2)
    assert {0, 1, 2} < set(course.events.tolist())
    for n in range(1, weights.size + 1):
        at_n = estimate_from_weights(weights[:n], 0.2, converged=False)
        assert at_n.simulations == at_n.estimating == n
        assert at_n.events == course.events[n - 1]
        assert at_n.probability == pytest.approx(course.probability[n - 1], rel=1e-14)
        assert at_n.diagnostics["relative_half_width"] == pytest.approx(
            course.relative_half_width[n - 1], rel=1e-12
        )
        if at_n.events > 1:
            half_width = stats.norm.ppf(0.9) * math.sqrt(course.variance[n - 1])
            assert at_n.high - at_n.probability == pytest.approx(half_width, rel=1e-12)
            assert at_n.low == pytest.approx(max(at_n.probability - half_width, 0), rel=1e-9, abs=1e-20)


@pytest.mark.parametrize(("scale", "offset"), [(1e-25, 0.0), (1e-7, 0.0), (1e-9, 1.0)])
def test_variances_agree_with_exact_sums(scale, offset):
    weights = offset + scale * np.random.default_rng(2).lognormal(0, 1, 400)
    exact = [Fraction(weight) for weight in weights.tolist()]
    n, total, squares = len(exact), sum(exact), sum(weight**2 for weight in exact)
    variance = float((squares - total**2 / n) / (n - 1) / n)
    assert running(weights, 0.2).variance[-1] == pytest.approx(variance, rel=1e-6, abs=0)
    result = estimate_from_weights(weights, 0.2, converged=True, learning=70)
    assert (result.alpha, result.learning, result.estimating) == (0.2, 70, 400)
    assert (result.simulations, result.converged) == (470, True)
    assert result.probability == pytest.approx(float(total / n), rel=1e-14, abs=0)
    half_width = stats.norm.ppf(0.9) * math.sqrt(variance)
    assert result.diagnostics["relative_half_width"] == pytest.approx(
        half_width / float(total / n), rel=1e-6, abs=0
    )
    assert result.diagnostics["effective_sample_size"] == pytest.approx(float(total**2 / squares), rel=1e-13)
    assert result.diagnostics["largest_weight_share"] == pytest.approx(float(max(exact) / total), rel=1e-14)
    if offset:  # the difference of two large sums
        naive = (np.square(weights).sum() - weights.sum() ** 2 / n) / (n - 1) / n
        assert naive != pytest.approx(variance, rel=1e-3, abs=0)


def test_without_two_events_the_interval_is_everything():
    none, one = (
        estimate_from_weights(weights, 0.2, converged=False)
        for weights in (np.zeros(50), np.array([0.0, 0.0, 3e-7]))
    )
    assert (none.probability, none.low, none.high, none.events) == (0, 0, 1, 0)
    assert (one.probability, one.low, one.high, one.events) == (1e-7, 0, 1, 1)
    shares = none.diagnostics.pop("largest_weight_share"), one.diagnostics.pop("largest_weight_share")
    assert math.isnan(shares[0])
    assert shares[1] == 1
    assert none.diagnostics == {"relative_half_width": math.inf, "effective_sample_size": 0}
    assert one.diagnostics == {"relative_half_width": math.inf, "effective_sample_size": 1}
    assert np.all(np.isinf(running(np.zeros(50), 0.2).relative_half_width))


def test_convergence_needs_both_the_width_and_the_events():
    nothing = np.zeros(6)
    course = Running(
        nothing, nothing, np.array([np.inf, 0.1, 0.3, 0.2, 0.25, 0.1]), np.array([0, 1, 2, 3, 4, 5])
    )

    def first(beta, minimum_events):
        return first_converged(course, Stopping(beta=beta, minimum_events=minimum_events))

    assert first(0.2, 1) == 2
    assert first(0.2, 2) == 4  # at most beta, and the lucky start does not count
    assert first(0.2, 4) == 6
    assert first(0.2, 6) is None
    assert first(0.05, 1) is None


def test_crude_monte_carlo_needs_what_the_paper_says():
    assert f"{crude_simulations(7.4e-7, 0.2, 0.2):.1e}" == "5.5e+07"
    n = crude_simulations(0.3, 0.05, 0.1)
    assert stats.norm.ppf(0.975) * math.sqrt(0.3 * 0.7 / n) == pytest.approx(0.1 * 0.3)


@pytest.mark.parametrize(("bias", "holds"), [(1.0, True), (1.15, False)])
def test_intervals_cover_as_often_as_they_say(bias, holds):
    truth, replicates = 1e-4, 500
    asked = accelerated([truth], slower=10.0)
    generator = np.random.default_rng(8)
    covered = 0
    for _ in range(replicates):
        weights = bias * draw_weights(*asked, generator, 3000)
        result = estimate_from_weights(weights, 0.2, converged=True)
        covered += result.covers(truth)
    assert result.diagnostics["effective_sample_size"] < 0.5 * result.events  # the weights are not all alike
    assert (stats.binomtest(covered, replicates, 0.8).pvalue > 1e-3) == holds


def test_segments_weigh_by_their_shares():
    probabilities, shares = (1e-3, 1e-5, 1e-9), (0.2, 0.3, 0.5)
    asked = accelerated(probabilities, slower=20 / 1.5, events=[2, 3, 5])
    size = 60_000
    weights = draw_weights(*asked, np.random.default_rng(5), size)
    truth, error = np.dot(probabilities, shares), 4 * weights.std() / math.sqrt(size)
    assert weights.mean() == pytest.approx(truth, rel=0, abs=error)
    assert error < 0.2 * truth
    assert abs(weights.mean() - np.mean(probabilities)) > error  # shares forgotten
    np.testing.assert_array_equal(weights, draw_weights(*asked, np.random.default_rng(5), size))
    problem, proposals = asked
    alone = draw_weights(problem.only("1e-05"), proposals, np.random.default_rng(6), size)
    assert alone.mean() == pytest.approx(1e-5, rel=0, abs=4 * alone.std() / math.sqrt(size))


def test_segments_without_draws_are_not_simulated():
    asked = accelerated([0.5, 0.4], events=[10**12, 1])
    assert draw_weights(*asked, np.random.default_rng(1), 50).size == 50


def test_simulations_go_on_until_convergence():
    asked = accelerated([0.05])  # crude: it needs some 780 simulations
    weights, converged_at = run_to_convergence(*asked, STOPPING, np.random.default_rng(1), 500)
    assert weights.size % 500 == 0
    assert weights.size - 500 < converged_at <= weights.size
    assert converged_at == first_converged(running(weights, 0.2), STOPPING)
    assert converged_at == pytest.approx(crude_simulations(0.05, 0.2, 0.2), rel=0.5)
    weights, converged_at = run_to_convergence(*accelerated([1e-3]), STOPPING, np.random.default_rng(1), 500)
    assert (weights.size, converged_at) == (1800, None)


@pytest.mark.parametrize(("probability", "converged"), [(0.05, True), (1e-3, False)])
def test_an_estimate_comes_with_its_course(probability, converged):
    problem, factors = accelerated([probability])
    method = METHODS["single"](cross_entropy={}, batch=500, course_step=100)
    found = Proposals(factors, dict.fromkeys(factors, 700))
    result = method.estimate(problem, STOPPING, np.random.default_rng(1), found)
    weights, converged_at = run_to_convergence(problem, factors, STOPPING, np.random.default_rng(1), 500)
    assert result.converged is converged
    assert result.estimating == (converged_at or 1800)
    assert (result.learning, result.simulations) == (700, 700 + result.estimating)
    assert result.probability == weights[:converged_at].mean()
    assert result.events == np.count_nonzero(weights[:converged_at])
    (course,) = result.tables.values()
    pd.testing.assert_frame_equal(course, course_table(weights, 0.2, 100), check_exact=True)
    assert course["simulations"].tolist() == list(range(100, weights.size + 1, 100))
    assert course["probability"].tolist() == pytest.approx(
        [weights[:n].mean() for n in course["simulations"]]
    )
    assert course["events"].tolist() == [np.count_nonzero(weights[:n]) for n in course["simulations"]]
