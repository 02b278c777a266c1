"""Systems whose outcomes are random: noise is estimated, and the probability of rare lapses is bounded."""

import math

import numpy as np
import pytest
from fewruns import SystemProblem
from fewruns.lapses import LapseBounds, upper_limit
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
    for seed in range(4):
        problem, truth = noisy_half_space(0.1, np.random.default_rng((7, seed)))
        found.append(estimate(problem, seed))
        truths.append(truth)
    assert all(each.converged for each in found)
    assert sum(each.covers(truth) for each, truth in zip(found, truths, strict=True)) >= 2
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
    assert found.simulations < 500  # it stops where more runs settle nothing
    assert found.high >= truth
    assert found.diagnostics["unseen_lapses_monotone"] <= found.diagnostics["unseen_lapses"] <= 1
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
        bounds = LapseBounds.after(z, hard | (generator.random(150) < rate), probability, 0.2)
        exceeded += rate * (1 - 10 * probability) > bounds.monotone
        assert bounds.monotone <= bounds.like_hardness
        assert bounds.runs == pytest.approx(-math.log(0.05) / (0.2 * probability))
    assert exceeded <= 5


def test_without_an_estimate_lapses_bound_the_whole_probability():
    generator, rate = np.random.default_rng(8), 0.3
    z = 2 * generator.standard_normal((200, 2))
    happened = generator.random(200) < rate
    bounds = LapseBounds.after(z, happened, math.nan, 0.2)
    assert rate < bounds.monotone <= bounds.like_hardness < 1
    assert bounds.runs == pytest.approx(-math.log(0.05) / (0.2 * bounds.like_hardness))
    assert LapseBounds.after(z[:0], happened[:0], math.nan, 0.2).like_hardness == 1


def test_the_runs_that_settle_lapses_bring_the_bound_down_to_the_share():
    z = np.random.default_rng(9).standard_normal((50, 2))
    bounds = LapseBounds.after(z, z[:, 0] > 2, 1e-4, 0.2)
    rate = upper_limit(np.array([0]), np.array([round(bounds.runs)]), 0.05)
    assert rate == pytest.approx(0.2 * 1e-4, rel=1e-3)


def test_upper_limits_are_those_of_clopper_and_pearson():
    limits = upper_limit(np.array([0, 2, 5]), np.array([50, 50, 5]), 0.05)
    np.testing.assert_allclose(binom.cdf([0, 2], 50, limits[:2]), 0.05)
    assert limits[2] == 1
