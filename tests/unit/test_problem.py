"""Rare events in normal scores: exact quantiles and marginals, scores of events, laws of the pools."""

import math
from dataclasses import dataclass, replace

import mpmath
import numpy as np
import pytest
from accelerated_evaluation.distributions import BoundedExponential, Empirical, Pareto
from accelerated_evaluation.methods.surrogate.wide_laws import (
    REACH,
    KernelMixture,
    draw_wide,
    log_normal,
    log_normal_to_wide,
)
from accelerated_evaluation.problem import CutIn, Proposal
from accelerated_evaluation.rare_event import cut_in_event, independent, normal_score_quantile
from accelerated_evaluation.vehicles import Outcomes
from accelerated_evaluation.vehicles.events import CRASH, Event
from scipy.stats import chi2, chisquare, kstest, multivariate_t, norm

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


def cut_ins():
    inverse_range = BoundedExponential(50.0, 1 / 75)
    return {
        name: CutIn(Empirical(SPEEDS[name]), Proposal(inverse_range, BoundedExponential(rate)), Echo())
        for name, rate in RATES.items()
    }


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
    event = independent(marginals, lambda x: (x[:, 0] > 1, None))
    x = event.inputs(normal_scores(3))
    assert event.dimension == 3
    assert x.shape == (SIZE, 3)
    for k, law in enumerate(marginals):
        assert kstest(law.cdf(x[:, k]), "uniform").pvalue > DOUBTFUL
        assert kstest(law.cdf(x[:, k - 1]), "uniform").pvalue < 1e-20
    happened, score = event.evaluate(normal_scores(3))
    np.testing.assert_array_equal(happened, x[:, 0] > 1)
    assert score is None


def test_lead_speeds_run_through_the_segments_in_their_shares():
    z = np.sort(normal_scores(1), axis=0) * [1, 0, 0]
    speed = cut_in_event(cut_ins(), SHARES).inputs(z)[:, 0]
    assert (np.diff(speed) >= 0).all()
    expected = {v: SHARES[name] / len(values) for name, values in SPEEDS.items() for v in values}
    values, counts = np.unique(speed, return_counts=True)
    assert values.tolist() == [*expected]
    assert chisquare(counts, SIZE * np.array([*expected.values()])).pvalue > DOUBTFUL
    assert chisquare(counts, np.full(len(counts), SIZE / len(counts))).pvalue < 1e-20
    far = cut_in_event(cut_ins(), SHARES).inputs(np.array([[-40.0, 0, 0], [40.0, 0, 0]]))
    assert far[:, 0].tolist() == [6.0, 34.0]


def test_cut_ins_have_the_laws_of_their_segment():
    problems = cut_ins()
    speed, inverse_range, inverse_ttc = cut_in_event(problems, SHARES).inputs(normal_scores(3, seed=8)).T
    law = problems["slow"].model.inverse_range
    assert kstest(law.cdf(inverse_range), "uniform").pvalue > DOUBTFUL
    for name, problem in problems.items():
        here = inverse_ttc[np.isin(speed, SPEEDS[name])]
        assert kstest(problem.model.inverse_ttc.cdf(here), "uniform").pvalue > DOUBTFUL
    pooled = problems["middle"].model.inverse_ttc.cdf(inverse_ttc)
    assert kstest(pooled, "uniform").pvalue < 1e-20


def test_the_score_of_a_cut_in_is_shown_only_where_it_is_graded():
    z = normal_scores(3)[:100]
    event = cut_in_event(cut_ins(), SHARES)
    happened, score = event.evaluate(z)
    inverse_ttc = event.inputs(z)[:, 2]
    np.testing.assert_array_equal(happened, inverse_ttc > 0.1)
    np.testing.assert_allclose(score, 1 / inverse_ttc, rtol=1e-12)
    flags, nothing = cut_in_event(cut_ins(), SHARES, graded=False).evaluate(z)
    np.testing.assert_array_equal(flags, happened)
    assert nothing is None
    near, _ = cut_in_event(cut_ins(), SHARES, Event("min_ttc", 20.0)).evaluate(z)
    np.testing.assert_array_equal(near, score <= 20.0)
    assert near.sum() > happened.sum()


@pytest.mark.parametrize(
    ("event", "happened", "score"),
    [
        (CRASH, [True, False, True, False], [0.5, 2.0, 0.8, np.inf]),
        (Event("min_range", 4.0), [True, True, True, False], [-0.1, 4.0, 0.0, 30.0]),
        (Event("min_ttc", 2.0), [True, True, True, False], [0.5, 2.0, 0.8, np.inf]),
        (Event("impact_speed", 3.0), [True, False, False, False], [-7.0, 2.0, -3.0, np.inf]),
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


@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_wide_law_is_uniform_in_the_log_of_the_tail(dimension):
    z = draw_wide(SIZE, dimension, np.random.default_rng(2))
    square = (z * z).sum(1)
    assert kstest(-chi2.logsf(square, dimension) / REACH, "uniform").pvalue > DOUBTFUL
    assert kstest(np.sqrt(square) / np.sqrt(square).max(), "uniform").pvalue < 1e-20
    assert abs(np.sign(z).mean(0)).max() < 4 / math.sqrt(SIZE)
    normal = normal_scores(dimension)
    assert kstest(-chi2.logsf((normal**2).sum(1), dimension) / REACH, "uniform").pvalue < 1e-20


def test_wide_law_of_two_dimensions_is_uniform_on_a_disc():
    """In two dimensions P(|Z| > r) = exp(-r^2 / 2), so that r^2 is uniform on [0, 2 REACH]."""
    z = draw_wide(SIZE, 2, np.random.default_rng(3))
    angle = np.arctan2(*z.T) / (2 * math.pi) + 0.5
    assert kstest(angle, "uniform").pvalue > DOUBTFUL
    exact = log_normal(z) + math.log(2 * math.pi * REACH)
    np.testing.assert_allclose(log_normal_to_wide(z), exact, rtol=0, atol=1e-10)
    edge = math.sqrt(2 * REACH)
    outside, inside = log_normal_to_wide(np.array([[0, 1.001 * edge], [0, 0.999 * edge]]))
    assert outside == np.inf
    assert inside < 0


def mixture(dimension):
    """Return kernels where most of phi is, so that a wrong density shows in the mean weight."""
    centres = np.random.default_rng(4).normal(size=(30, dimension))
    return KernelMixture.about(centres, 0.2)


def error_in_standard_errors(log_weight):
    """Distance of the mean weight from 1, its expectation under the law that was drawn from."""
    w = np.exp(log_weight)
    return abs(w.mean() - 1) / (w.std() / math.sqrt(len(w)))


@pytest.mark.parametrize("dimension", [2, 3])
def test_weights_have_the_mean_one(dimension):
    generator, law = np.random.default_rng(5), mixture(dimension)
    assert error_in_standard_errors(log_normal_to_wide(draw_wide(SIZE, dimension, generator))) < 4
    z = law.draw(SIZE, generator)
    assert error_in_standard_errors(law.log_normal_ratio(z)) < 4
    for wrong in (replace(law, width=1.5 * law.width), replace(law, wide_share=0.4)):
        assert error_in_standard_errors(wrong.log_normal_ratio(z)) > 8


@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_density_of_the_mixture_is_that_of_its_kernels(dimension):
    law = mixture(dimension)
    z = law.draw(200, np.random.default_rng(6))
    shape = np.diag(law.width**2)
    kernels = np.mean([multivariate_t.pdf(z, c, shape, df=dimension) for c in law.centres], axis=0)
    wide = np.exp(log_normal(z) - log_normal_to_wide(z))
    density = np.exp(log_normal(z) - law.log_normal_ratio(z))
    np.testing.assert_allclose(density, 0.2 * wide + 0.8 * kernels, rtol=1e-9)


def test_density_of_the_mixture_integrates_to_one():
    """On z = sinh(t) to 1,000; the wide law, which ends at a jump, is taken off and known to be 1."""
    law = mixture(2)
    t = np.arange(-7.6, 7.6, 0.05)
    z = np.stack(np.meshgrid(np.sinh(t), np.sinh(t)), axis=-1).reshape(-1, 2)
    cells = np.prod(np.cosh(np.arcsinh(z)), axis=1) * 0.05**2

    def integral(law):
        inside = np.isfinite(log_normal_to_wide(z))
        density = np.exp(log_normal(z) - law.log_normal_ratio(z)) - inside * 0.2 / (2 * math.pi * REACH)
        return 0.2 + cells @ density

    # what lies beyond 1,000 is about 2 width^2 / 1000^2
    assert integral(law) == pytest.approx(1, abs=1e-5)
    narrow = replace(law, width=law.width / 20)  # too narrow for the quadrature, which so can tell
    assert integral(narrow) != pytest.approx(1, abs=1e-2)


def test_kernels_by_silvermans_rule():
    points = np.column_stack([np.arange(16.0), np.full(16, 3.0)])
    law = KernelMixture.about(points, 0.25)
    assert law.width == pytest.approx([math.sqrt((16**2 - 1) / 12) * 16 ** (-1 / 6), 0.1 * 16 ** (-1 / 6)])
    z = law.draw(1000, np.random.default_rng(7))
    assert z.shape == (1000, 2)
    # wide first, and exactly its share: few of its points come near the line of the centres
    assert (abs(z[:250, 1] - 3) > 1).mean() > 0.7 > 0.3 > (abs(z[250:, 1] - 3) > 1).mean()
