"""Estimates against exact sums, closed forms and their own coverage."""

import math
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
import pytest
from accelerated_evaluation.distributions import BoundedExponential, Empirical
from accelerated_evaluation.methods.importance_sampling import (
    Running,
    Stratum,
    crude_simulations,
    draw_crash_weights,
    estimate,
    first_converged,
    run_to_convergence,
    running,
)
from accelerated_evaluation.methods.replicates import estimate_replicate
from accelerated_evaluation.problem import CutIn, Proposal
from accelerated_evaluation.vehicles import Outcomes
from scipy import stats

F = Proposal(BoundedExponential(50.0, 1 / 75), BoundedExponential(20.0))


@dataclass(frozen=True)
class Toy:
    """A vehicle that crashes if and only if TTC^-1 is above a threshold."""

    threshold: float

    def simulate(self, lead_speed, range_, closing_speed):
        assert range_.size, "nothing to simulate"
        crash = closing_speed / range_ > self.threshold
        return Outcomes(
            crash, np.where(crash, 0.0, range_), np.full(range_.size, np.inf), np.zeros(range_.size)
        )


def stratum(probability, share=1.0, rate=None):
    """Return a segment with a known crash probability, accelerated to a rate of TTC^-1, or not at all."""
    vehicle = Toy(float(F.inverse_ttc.isf(probability)))
    f_star = F if rate is None else replace(F, inverse_ttc=BoundedExponential(rate))
    return Stratum(CutIn(Empirical([20.0]), F, vehicle), share, f_star)


def crash_weights(size, seed=1, events=0.2):
    generator = np.random.default_rng(seed)
    return np.where(generator.random(size) < events, 1e-7 * generator.lognormal(0, 1, size), 0.0)


def test_running_is_the_estimate_at_every_number_of_simulations():
    weights = np.concatenate([np.zeros(10), crash_weights(300, events=0.05)])
    course = running(weights, 0.2)
    assert {0, 1, 2} < set(course.events.tolist())
    for n in range(1, weights.size + 1):
        at_n = estimate(weights[:n], 0.2)
        assert at_n.simulations == n
        assert at_n.events == course.events[n - 1]
        assert at_n.probability == pytest.approx(course.probability[n - 1], rel=1e-14)
        assert at_n.relative_half_width == pytest.approx(course.relative_half_width[n - 1], rel=1e-12)
        if at_n.events > 1:
            half_width = stats.norm.ppf(0.9) * math.sqrt(course.variance[n - 1])
            assert at_n.ci_high - at_n.probability == pytest.approx(half_width, rel=1e-12)
            assert at_n.ci_low == pytest.approx(max(at_n.probability - half_width, 0), rel=1e-9, abs=1e-20)


@pytest.mark.parametrize(("scale", "offset"), [(1e-25, 0.0), (1e-7, 0.0), (1e-9, 1.0)])
def test_variances_agree_with_exact_sums(scale, offset):
    weights = offset + scale * np.random.default_rng(2).lognormal(0, 1, 400)
    exact = [Fraction(weight) for weight in weights.tolist()]
    n, total, squares = len(exact), sum(exact), sum(weight**2 for weight in exact)
    variance = float((squares - total**2 / n) / (n - 1) / n)
    assert running(weights, 0.2).variance[-1] == pytest.approx(variance, rel=1e-6, abs=0)
    result = estimate(weights, 0.2)
    assert result.probability == pytest.approx(float(total / n), rel=1e-14, abs=0)
    half_width = stats.norm.ppf(0.9) * math.sqrt(variance)
    assert result.relative_half_width == pytest.approx(half_width / float(total / n), rel=1e-6, abs=0)
    assert result.effective_sample_size == pytest.approx(float(total**2 / squares), rel=1e-13)
    assert result.largest_weight_share == pytest.approx(float(max(exact) / total), rel=1e-14)
    if offset:  # the difference of two large sums
        naive = (np.square(weights).sum() - weights.sum() ** 2 / n) / (n - 1) / n
        assert naive != pytest.approx(variance, rel=1e-3, abs=0)


def test_without_two_events_the_interval_is_everything():
    none, one = estimate(np.zeros(50), 0.2), estimate(np.array([0.0, 0.0, 3e-7]), 0.2)
    assert (none.probability, none.ci_low, none.ci_high, none.effective_sample_size) == (0, 0, 1, 0)
    assert math.isnan(none.largest_weight_share)
    assert (one.probability, one.ci_low, one.ci_high, one.effective_sample_size) == (1e-7, 0, 1, 1)
    assert none.relative_half_width == one.relative_half_width == math.inf
    assert np.all(np.isinf(running(np.zeros(50), 0.2).relative_half_width))


def test_convergence_needs_both_the_width_and_the_events():
    nothing = np.zeros(6)
    course = Running(
        nothing, nothing, np.array([np.inf, 0.1, 0.3, 0.2, 0.25, 0.1]), np.array([0, 1, 2, 3, 4, 5])
    )
    assert first_converged(course, 0.2, 1) == 2
    assert first_converged(course, 0.2, 2) == 4  # at most beta, and the lucky start does not count
    assert first_converged(course, 0.2, 4) == 6
    assert first_converged(course, 0.2, 6) is None
    assert first_converged(course, 0.05, 1) is None


def test_crude_monte_carlo_needs_what_the_paper_says():
    assert f"{crude_simulations(7.4e-7, 0.2, 0.2):.1e}" == "5.5e+07"
    n = crude_simulations(0.3, 0.05, 0.1)
    assert stats.norm.ppf(0.975) * math.sqrt(0.3 * 0.7 / n) == pytest.approx(0.1 * 0.3)


@pytest.mark.parametrize(("bias", "holds"), [(1.0, True), (1.15, False)])
def test_intervals_cover_as_often_as_they_say(bias, holds):
    truth, replicates = 1e-4, 500
    strata = {"all": stratum(truth, rate=2.0)}
    generator = np.random.default_rng(8)
    covered = 0
    for _ in range(replicates):
        result = estimate(bias * draw_crash_weights(strata, generator, 3000), 0.2)
        covered += result.ci_low <= truth <= result.ci_high
    assert result.effective_sample_size < 0.5 * result.events  # the weights are not all alike
    assert (stats.binomtest(covered, replicates, 0.8).pvalue > 1e-3) == holds


def test_segments_weigh_by_their_shares():
    probabilities, shares = (1e-3, 1e-5, 1e-9), (0.2, 0.3, 0.5)
    strata = {str(p): stratum(p, share, rate=1.5) for p, share in zip(probabilities, shares, strict=True)}
    size = 60_000
    weights = draw_crash_weights(strata, np.random.default_rng(5), size)
    truth, error = np.dot(probabilities, shares), 4 * weights.std() / math.sqrt(size)
    assert weights.mean() == pytest.approx(truth, rel=0, abs=error)
    assert error < 0.2 * truth
    assert abs(weights.mean() - np.mean(probabilities)) > error  # shares forgotten
    np.testing.assert_array_equal(weights, draw_crash_weights(strata, np.random.default_rng(5), size))
    alone = draw_crash_weights({"1e-05": strata["1e-05"]}, np.random.default_rng(6), size)
    assert alone.mean() == pytest.approx(1e-5, rel=0, abs=4 * alone.std() / math.sqrt(size))


def test_segments_without_draws_are_not_simulated():
    strata = {"common": stratum(0.5), "rare": stratum(0.5, share=1e-12)}
    assert draw_crash_weights(strata, np.random.default_rng(1), 50).size == 50


SETTINGS = {"alpha": 0.2, "beta": 0.2, "minimum_events": 30, "simulations": 500, "maximum_simulations": 1800}


def test_simulations_go_on_until_convergence():
    strata = {"all": stratum(0.05)}  # crude: it needs some 780 simulations
    weights, converged_at = run_to_convergence(strata, np.random.default_rng(1), **SETTINGS)
    assert weights.size % 500 == 0
    assert weights.size - 500 < converged_at <= weights.size
    assert converged_at == first_converged(running(weights, 0.2), 0.2, 30)
    assert converged_at == pytest.approx(crude_simulations(0.05, 0.2, 0.2), rel=0.5)
    weights, converged_at = run_to_convergence({"all": stratum(1e-3)}, np.random.default_rng(1), **SETTINGS)
    assert (weights.size, converged_at) == (1800, None)


@pytest.mark.parametrize(("probability", "converged"), [(0.05, True), (1e-3, False)])
def test_a_replicate_reports_its_estimate_and_its_course(probability, converged):
    strata, settings = {"all": stratum(probability)}, SETTINGS | {"course_step": 100}
    result, course = estimate_replicate(strata, np.random.default_rng(1), settings)
    weights, converged_at = run_to_convergence(strata, np.random.default_rng(1), **SETTINGS)
    assert result["converged"] is converged
    assert result["simulations"] == (converged_at or 1800)
    assert result["probability"] == weights[:converged_at].mean()
    assert course["simulations"].tolist() == list(range(100, weights.size + 1, 100))
    assert course["probability"].tolist() == pytest.approx(
        [weights[:n].mean() for n in course["simulations"]]
    )
    assert course["events"].tolist() == [np.count_nonzero(weights[:n]) for n in course["simulations"]]
