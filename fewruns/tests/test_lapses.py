"""Systems whose outcomes are random: noise is estimated, and the probability of rare lapses is bounded."""

import math

import numpy as np
import pytest
from fewruns import SystemProblem
from sampler_checks import estimate
from scipy.special import ndtr
from scipy.stats import beta


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
    assert found.high >= truth
    draws, events = found.diagnostics["law_draws"], found.diagnostics["law_events"]
    assert draws > 500  # what is not learnt any more is drawn from the law
    assert found.diagnostics["unseen_lapses"] == pytest.approx(beta.ppf(0.95, events + 1, draws - events))
    assert found.diagnostics["settling_runs"] == pytest.approx(-math.log(0.05) / (0.2 * found.probability))
    believed = SystemProblem(respond, 2, fingerprint="lapses", deterministic=True)
    wrong = estimate(believed, 5)
    assert wrong.converged
    assert wrong.high < truth
