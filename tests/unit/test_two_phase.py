"""The two phases of the adaptive sampler by hand: inclusion, sampling, the difference estimator."""

from dataclasses import dataclass

import numpy as np
import pytest
from accelerated_evaluation.methods.surrogate import two_phase
from accelerated_evaluation.methods.surrogate.constants import DEFENCE, FLOOR, WORTHLESS


@pytest.fixture
def pool():
    """A pool of twelve points with flags that the surrogate does not foresee well."""
    generator = np.random.default_rng(3)
    z, w = generator.normal(size=(12, 2)), generator.lognormal(0, 1, 12)
    p, flags = generator.random(12), generator.random(12) < 0.5
    g = np.where(p > 0.3, p, 0.0)
    return z, w, p, g, flags


def batch(weight, control, inclusion, controlled, controlled_square=0.0, importance=1.0):
    """Return a batch whose places do not matter."""
    drawn = (np.asarray(values) for values in (weight, control, inclusion))
    return two_phase.TwoPhaseBatch(
        np.zeros((len(weight), 2)), *drawn, controlled, controlled_square, importance, 0.1, is_usable=True
    )


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
    pi = two_phase.inclusion_probabilities(size, n)
    assert pi.sum() == pytest.approx(n, rel=1e-12)
    assert pi.max() <= 1
    assert pi.min() >= DEFENCE * n / points * (1 - 1e-12)
    defended = (1 - DEFENCE) * size / size.sum() + DEFENCE / points
    ratio = (pi / defended)[pi < 1]
    assert ratio == pytest.approx(ratio[0], rel=1e-12)
    assert two_phase.inclusion_probabilities(np.zeros(points), n) == pytest.approx(n / points, rel=1e-12)


def test_some_points_are_certain():
    pi = two_phase.inclusion_probabilities(np.array([100.0, 50.0, 1.0, 1.0, 1.0, 1.0]), 3)
    # without the defence: 1, 1 and a quarter of the third run for each
    assert pi == pytest.approx([1, 1, 0.25, 0.25, 0.25, 0.25], rel=1e-12)


def test_systematic_sample_includes_by_pi(pool):
    z, w, p, _, _ = pool
    pi = two_phase.inclusion_probabilities(w * np.sqrt(p), 4)
    generator, draws = np.random.default_rng(1), 4000
    taken = np.zeros(12)
    for _ in range(draws):
        chosen = two_phase.draw_systematically(z, w * p, pi, generator)
        assert len(set(chosen.tolist())) == 4
        taken[chosen] += 1
    allowed = 4.5 * np.sqrt(pi * (1 - pi) / draws) + 1e-9
    assert (abs(taken / draws - pi) <= allowed).all()
    assert (abs(taken / draws - pi[::-1]) > allowed).sum() > 6


def test_systematic_sample_is_spread_along_the_principal_axis():
    z = np.random.default_rng(2).normal(size=(1000, 2)) * [5.0, 0.5]
    chosen = two_phase.draw_systematically(z, np.ones(1000), np.full(1000, 0.01), np.random.default_rng(3))
    rank = np.sort(z[:, 0].argsort().argsort()[chosen])
    # one run in each tenth of the axis, up to the little that it is turned against the first variable
    assert abs(rank - 100 * np.arange(10) - 50).max() < 65


def test_difference_estimator_is_exactly_unbiased(pool):
    """Over the starts the estimate is a step function with a jump a point: midpoints err by jumps / (2 K)."""
    z, w, p, g, flags = pool
    pi = two_phase.inclusion_probabilities(w * np.sqrt(p), 4)
    starts = 2000

    def mean_estimate(pi_used, g_used, controlled):
        estimates = []
        for k in range(starts):
            chosen = two_phase.draw_systematically(z, w * p, pi, Start((k + 0.5) / starts))
            drawn = batch(w[chosen] / 12, g_used[chosen], pi_used[chosen], controlled)
            estimates.append(two_phase.estimate_batch(drawn, flags[chosen]).probability)
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
    drawn = batch([0.1, 0.2], [0.5, 0.0], [0.5, 0.25], 0.3, controlled_square=0.02, importance=2.0)
    kept = two_phase.estimate_batch(drawn, np.array([True, False]))
    # w (event - g) / pi: 0.1 * 0.5 / 0.5 = 0.1 and 0
    assert kept.probability == pytest.approx(0.3 + 0.1)
    assert kept.observed_variance == pytest.approx((0.02 + 0.1 * 0.1) + 0.1**2 * 0.5 * 2)
    assert (kept.importance, kept.predicted_variation, kept.is_usable) == (2.0, 0.1, True)


def test_expectation_by_hand():
    w = np.array([9.0, 9.0, 9.0, 1.0, 1.0, 1.0])
    expected = two_phase.expect(w, np.array([0.9, 0.1, 0.04, 0.04, 0.002, 0.0005]), 2.0)
    assert expected.probability.tolist() == [0.9, 0.1, 0.0, 0.04, 0.002, 0.0]
    assert expected.control.tolist() == [0.9, 0.0, 0.0, 0.0, 0.0, 0.0]
    # E (1 - g)^2 p + g^2 (1 - p); without a control variate that is p
    assert expected.error == pytest.approx([0.9 * 0.1**2 + 0.1 * 0.9**2, 0.1, 0.0, 0.04, 0.002, 0.0])


def test_predicted_variance_by_hand(pool):
    _, w, p, _, _ = pool
    expected = two_phase.expect(w, p, 0.0)
    p, error = expected.probability, expected.error
    pi = two_phase.inclusion_probabilities(w * np.sqrt(error + FLOOR * p), 3)
    mean = sum(w * p) / 12
    second = sum(w[i] ** 2 * error[i] / pi[i] for i in range(12)) / 12**2
    first = (sum(w**2 * p) / 12 - mean**2) / 12
    prediction = two_phase.predict(w, expected, 3, 12)
    assert prediction.probability == pytest.approx(mean)
    assert prediction.variation == pytest.approx(3 * (second + first) / mean**2)
    # Twice the runs out of a pool twice as large are worth the same each.
    twice = two_phase.predict(w, expected, 6, 24)
    assert (twice.probability, twice.variation) == pytest.approx((mean, prediction.variation))
    nothing = two_phase.expect(w, 0 * p, 0.0)
    assert two_phase.predict(w, nothing, 3, 12) == two_phase.Prediction(0.0, WORTHLESS)


def test_batches_count_since_the_surrogate_was_usable():
    estimates = [two_phase.BatchEstimate(float(k), 1.0, 1.0, 1.0, is_usable=k in (2, 4)) for k in range(6)]
    assert [kept.probability for kept in two_phase.since_usable(estimates)] == [2.0, 3.0, 4.0, 5.0]
    assert len(two_phase.since_usable(estimates[:2])) == 0


@pytest.mark.parametrize(("observed", "predicted", "larger"), [(4.0, 0.01, 4.0), (1.0, 0.25, 0.25 * 2.5**2)])
def test_combined_estimate_by_hand(observed, predicted, larger):
    estimates = [
        two_phase.BatchEstimate(value, observed, importance, predicted, is_usable=True)
        for value, importance in ((1.0, 1.0), (3.0, 3.0))
    ]
    combined = two_phase.combine(estimates)
    shares = 0.25**2 + 0.75**2
    assert combined.probability == pytest.approx(0.25 * 1 + 0.75 * 3)
    assert combined.observed_variance == pytest.approx(shares * observed)
    assert combined.predicted_variance == pytest.approx(shares * predicted * 2.5**2)
    # Student's t with one degree of freedom has its 90 % quantile at tan(0.4 pi).
    half_width = np.tan(0.4 * np.pi) * np.sqrt(shares * larger)
    assert combined.half_width(0.2) == pytest.approx(half_width)
