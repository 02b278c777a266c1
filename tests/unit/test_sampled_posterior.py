"""The posterior of a probability from estimates under draws of the law: what the sampling adds to it."""

import numpy as np
import pytest
from accelerated_evaluation.answer.posterior import SampledPosterior, shrunk_estimates
from scipy.stats import norm


def test_the_sampling_error_widens_the_interval():
    generator = np.random.default_rng(1)
    exact = np.exp(generator.normal(0, 0.6, 4000))
    posterior = SampledPosterior(exact, np.zeros(4000, int), np.full(4000, 0.2), 1000)
    low, high = posterior.whole.interval(0.8)
    expected = 2 * norm.isf(0.1) * np.hypot(0.6, 0.2)
    assert np.log(high / low) == pytest.approx(expected, rel=0.04)
    assert posterior.share_of_sampling == pytest.approx(np.hypot(0.6, 0.2) / 0.6 - 1, abs=0.015)
    exactly = SampledPosterior(exact, np.zeros(4000, int), np.zeros(4000), 1000)
    assert exactly.share_of_sampling == pytest.approx(0, abs=1e-12)
    assert exactly.whole.interval(0.8) == pytest.approx(exactly.alone.interval(0.8), rel=1e-3)


def test_estimates_drawn_together_scatter_as_the_probabilities_do():
    generator = np.random.default_rng(8)
    logs, own = generator.normal(-13, 0.6, 4000), np.full(4000, 0.3)
    estimates = np.exp(logs + generator.normal(0, own))
    drawn = np.log(shrunk_estimates(estimates, own))
    error = 0.6 / np.sqrt(2 * 4000)
    assert drawn.std() == pytest.approx(0.6, abs=4 * error)
    assert np.log(estimates).std() > 0.6 + 4 * error  # without it: too wide
    assert np.median(drawn) == pytest.approx(np.median(np.log(estimates)))
    assert shrunk_estimates(estimates, 0 * own) == pytest.approx(estimates)


def test_a_draw_that_is_not_known_takes_the_median():
    generator = np.random.default_rng(9)
    estimates, own = np.exp(generator.normal(-13, 0.6, 400)), np.full(400, 0.05)
    estimates[0] *= 1e-3  # no event was met under this draw
    own[0] = 50.0
    drawn = shrunk_estimates(estimates, own)
    assert drawn[0] == pytest.approx(np.median(estimates), rel=0.1)
    assert np.log(drawn[1:]) == pytest.approx(np.log(estimates[1:]), abs=0.02)


def test_runs_that_know_too_little_do_not_end():
    """Draws that scatter by their errors alone span a wide interval, which these errors hardly widen."""
    scattered = np.exp(np.random.default_rng(10).normal(-13, 4.0, 4000))
    unknown = SampledPosterior(scattered, np.zeros(4000, int), np.full(4000, 0.7), 5)
    widths = [np.log(np.divide(*part.interval(0.8)[::-1])) for part in (unknown.alone, unknown.whole)]
    assert widths[1] < 1.05 * widths[0]  # which would be enough to stop
    assert unknown.share_of_sampling == np.inf
    known = SampledPosterior(scattered, np.zeros(4000, int), np.full(4000, 0.2), 20)
    assert known.share_of_sampling < 0.05
