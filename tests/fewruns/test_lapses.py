"""Systems whose outcomes are random: noise is estimated, and the probability of rare lapses is bounded."""

import math

import numpy as np
import pytest
from fewruns import SystemProblem
from fewruns.lapses import monotone_bound
from fewruns.law_draws import upper_limit
from sampler_checks import estimate
from scipy.special import ndtr
from scipy.stats import binom


def noisy_half_space(spread, generator, distance=3.5):
    def respond(z):
        score = distance - z @ [0.6, 0.8] + spread * generator.standard_normal(len(z))
        return score <= 0, score

    truth = float(ndtr(-distance / math.sqrt(1 + spread**2)))
    return SystemProblem(respond, 2, fingerprint="noisy", deterministic=False), truth


def test_noise_costs_runs_but_is_estimated():
    """Where p goes from 0 to 1 within a tenth of the range, intervals cover, and none is far off."""
    found, truths = [], []
    for seed in range(6):
        problem, truth = noisy_half_space(0.1, np.random.default_rng((7, seed)))
        found.append(estimate(problem, seed))
        truths.append(truth)
    assert all(each.converged for each in found)
    assert sum(each.covers(truth) for each, truth in zip(found, truths, strict=True)) >= 3
    ratios = [each.probability / truth for each, truth in zip(found, truths, strict=True)]
    assert 0.5 < min(ratios) < max(ratios) < 2


def test_rare_lapses_are_bounded_and_not_estimated():
    generator = np.random.default_rng(4)

    def respond(z):
        score = 3.5 - z @ [0.6, 0.8]
        score = np.where(generator.random(len(z)) < 0.01, score - 1.5, score)
        return score <= 0, score

    problem = SystemProblem(respond, 2, fingerprint="lapses", deterministic=False)
    truth = 0.99 * ndtr(-3.5) + 0.01 * ndtr(-2.0)
    found = estimate(problem, 5)
    assert not found.converged
    assert found.high >= truth
    draws = found.diagnostics["law_draws"]
    assert draws > 500  # what is not learnt any more is drawn from the law
    assert found.diagnostics["unseen_lapses"] == pytest.approx(1 - 0.05 ** (1 / draws))
    assert found.diagnostics["unseen_lapses_monotone"] <= found.diagnostics["unseen_lapses"]
    assert found.diagnostics["settling_runs"] == pytest.approx(-math.log(0.05) / (0.2 * found.probability))
    believed = SystemProblem(respond, 2, fingerprint="lapses", deterministic=True)
    wrong = estimate(believed, 5)
    assert wrong.converged
    assert wrong.high < truth


def test_the_bound_on_lapses_holds_for_lapses_that_are_alike():
    """Of lapses with the same probability everywhere, at most a twentieth exceed the bound."""
    generator, rate, probability = np.random.default_rng(6), 0.02, 1e-3
    exceeded = 0
    for _ in range(40):
        z = generator.standard_normal((150, 2)) * 2
        hard = z[:, 0] > 3.1
        bound = monotone_bound(z, hard | (generator.random(150) < rate), probability)
        exceeded += rate * (1 - 10 * probability) > bound
        assert bound < 0.5
    assert exceeded <= 5


def test_without_an_estimate_lapses_bound_the_whole_probability():
    generator, rate = np.random.default_rng(8), 0.3
    z = 2 * generator.standard_normal((200, 2))
    happened = generator.random(200) < rate
    assert rate < monotone_bound(z, happened, math.nan) < 1
    assert monotone_bound(z[:0], happened[:0], math.nan) == 1


def test_upper_limits_are_those_of_clopper_and_pearson():
    limits = upper_limit(np.array([0, 2, 5]), np.array([50, 50, 5]), 0.05)
    np.testing.assert_allclose(binom.cdf([0, 2], 50, limits[:2]), 0.05)
    assert limits[2] == 1
