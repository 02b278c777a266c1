"""The laws of the pools of the surrogate method: densities, weights of mean one, kernels."""

import math
from dataclasses import replace

import numpy as np
import pytest
from fewruns.wide_laws import REACH, KernelMixture, draw_wide, log_normal, log_normal_to_wide, truncated
from scipy.stats import chi2, kstest, multivariate_t

SIZE = 20_000
DOUBTFUL = 1e-3  # p-value; the seeds are fixed, and a wrong law is seen to give less than 1e-20


def normal_scores(dimension, seed=1):
    return np.random.default_rng(seed).normal(size=(SIZE, dimension))


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


def test_no_single_weight_outweighs_all_others():
    even = np.random.default_rng(6).uniform(1, 2, 1000)
    assert (truncated(even) == even).all()
    one = np.append(even, 1e9)
    assert truncated(one)[-1] == pytest.approx(one.sum() / math.sqrt(1001))
    assert (truncated(one)[:-1] == even).all()
