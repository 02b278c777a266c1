"""The two phases of the adaptive sampler by hand: inclusion, sampling, the difference estimator."""

from dataclasses import dataclass

import numpy as np
import pytest
from accelerated_evaluation.methods.surrogate import two_phase


@pytest.fixture
def pool():
    """A pool of twelve points with flags that the surrogate does not foresee well."""
    generator = np.random.default_rng(3)
    z, w = generator.normal(size=(12, 2)), generator.lognormal(0, 1, 12)
    p, flags = generator.random(12), generator.random(12) < 0.5
    g = np.where(p > 0.3, p, 0.0)
    return z, w, p, g, flags


@dataclass
class Start:
    """A generator that returns a given start of the systematic sample."""

    u: float

    def random(self):
        return self.u


@pytest.mark.parametrize(("points", "n", "spread"), [(12, 4, 1.0), (2000, 10, 3.0), (2000, 300, 2.0)])
def test_inclusion_probabilities(points, n, spread):
    generator = np.random.default_rng(points + n)
    size = generator.lognormal(0, spread, points) * (generator.random(points) < 0.7)
    pi = two_phase.inclusion(size, n)
    assert pi.sum() == pytest.approx(n, rel=1e-12)
    assert pi.max() <= 1
    assert pi.min() >= two_phase.DEFENCE * n / points * (1 - 1e-12)
    defended = (1 - two_phase.DEFENCE) * size / size.sum() + two_phase.DEFENCE / points
    ratio = (pi / defended)[pi < 1]
    assert ratio == pytest.approx(ratio[0], rel=1e-12)
    assert two_phase.inclusion(np.zeros(points), n) == pytest.approx(n / points, rel=1e-12)


def test_some_points_are_certain():
    pi = two_phase.inclusion(np.array([100.0, 50.0, 1.0, 1.0, 1.0, 1.0]), 3)
    # without the defence: 1, 1 and a quarter of the third run for each
    assert pi == pytest.approx([1, 1, 0.25, 0.25, 0.25, 0.25], rel=1e-12)


def test_systematic_sample_includes_by_pi(pool):
    z, w, p, _, _ = pool
    pi = two_phase.inclusion(w * np.sqrt(p), 4)
    generator, draws = np.random.default_rng(1), 4000
    taken = np.zeros(12)
    for _ in range(draws):
        chosen = two_phase.systematic(z, w * p, pi, generator)
        assert len(set(chosen.tolist())) == 4
        taken[chosen] += 1
    allowed = 4.5 * np.sqrt(pi * (1 - pi) / draws) + 1e-9
    assert (abs(taken / draws - pi) <= allowed).all()
    assert (abs(taken / draws - pi[::-1]) > allowed).sum() > 6


def test_systematic_sample_is_spread_along_the_principal_axis():
    z = np.random.default_rng(2).normal(size=(1000, 2)) * [5.0, 0.5]
    chosen = two_phase.systematic(z, np.ones(1000), np.full(1000, 0.01), np.random.default_rng(3))
    rank = np.sort(z[:, 0].argsort().argsort()[chosen])
    # one run in each tenth of the axis, up to the little that it is turned against the first variable
    assert abs(rank - 100 * np.arange(10) - 50).max() < 65


def test_difference_estimator_is_exactly_unbiased(pool):
    """Over the starts the estimate is a step function with a jump a point: midpoints err by jumps / (2 K)."""
    z, w, p, g, flags = pool
    pi = two_phase.inclusion(w * np.sqrt(p), 4)
    starts = 2000

    def mean_estimate(pi_used, g_used, controlled):
        estimates = []
        for k in range(starts):
            chosen = two_phase.systematic(z, w * p, pi, Start((k + 0.5) / starts))
            batch = {"w": w[chosen] / 12, "g": g_used[chosen], "pi": pi_used[chosen]}
            batch |= {"controlled": controlled, "controlled_square": 0.0}
            batch |= {"weight": 1.0, "foretold": 1.0, "usable": True}
            estimates.append(two_phase.account(batch, flags[chosen])["estimate"])
        return np.mean(estimates), 12 * np.ptp(estimates) / (2 * starts)

    truth = (w * flags).mean()
    mean, error = mean_estimate(pi, g, (w @ g) / 12)
    assert error < 0.02 * truth
    assert abs(mean - truth) <= error
    for wrong in (
        (np.full(12, 4 / 12), g, (w @ g) / 12),
        (pi, g, 0.0),
        (pi, np.zeros(12), (w @ g) / 12),
    ):
        mean, error = mean_estimate(*wrong)
        assert abs(mean - truth) > 3 * error


def test_observed_variance_by_hand():
    batch = {"w": [0.1, 0.2], "g": [0.5, 0.0], "pi": [0.5, 0.25], "controlled": 0.3}
    batch |= {"controlled_square": 0.02, "weight": 2.0, "foretold": 0.1, "usable": True}
    kept = two_phase.account(batch, np.array([True, False]))
    # w (event - g) / pi: 0.1 * 0.5 / 0.5 = 0.1 and 0
    assert kept["estimate"] == pytest.approx(0.3 + 0.1)
    assert kept["observed"] == pytest.approx((0.02 + 0.1 * 0.1) + 0.1**2 * 0.5 * 2)
    assert {name: kept[name] for name in ("weight", "foretold", "usable")} == {
        "weight": 2.0, "foretold": 0.1, "usable": True,
    }  # fmt: skip


def test_aim_by_hand():
    w = np.array([9.0, 9.0, 9.0, 1.0, 1.0, 1.0])
    p, g, error = two_phase.aim(w, np.array([0.9, 0.1, 0.04, 0.04, 0.002, 0.0005]), 2.0)
    assert p.tolist() == [0.9, 0.1, 0.0, 0.04, 0.002, 0.0]
    assert g.tolist() == [0.9, 0.0, 0.0, 0.0, 0.0, 0.0]
    # E (1 - g)^2 p + g^2 (1 - p); without a control variate that is p
    assert error == pytest.approx([0.9 * 0.1**2 + 0.1 * 0.9**2, 0.1, 0.0, 0.04, 0.002, 0.0])


def test_foretold_variance_by_hand(pool):
    _, w, p, _, _ = pool
    p, g, error = two_phase.aim(w, p, 0.0)
    pi = two_phase.inclusion(w * np.sqrt(error + two_phase.FLOOR * p), 3)
    mean = sum(w * p) / 12
    second = sum(w[i] ** 2 * error[i] / pi[i] for i in range(12)) / 12**2
    first = (sum(w**2 * p) / 12 - mean**2) / 12
    believed, foretold = two_phase.foretell(w, p, g, error, 3, 12)
    assert believed == pytest.approx(mean)
    assert foretold == pytest.approx(3 * (second + first) / mean**2)
    # twice the runs out of a pool twice as large are worth the same each
    assert two_phase.foretell(w, p, g, error, 6, 24) == pytest.approx((mean, foretold))
    assert two_phase.foretell(w, 0 * p, g, error, 3, 12) == (0.0, two_phase.WORTHLESS)
