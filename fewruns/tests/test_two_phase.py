"""The two phases of the adaptive sampler by hand: inclusion, sampling, the difference estimator."""

from dataclasses import dataclass

import numpy as np
import pytest
from fewruns import combining, pools, two_phase
from fewruns.constants import AGREEMENT, BEST, EVEN, FLOOR, KEPT, LARGEST, REACH, USABLE
from sampler_checks import drive, half_plane, new_sampler
from scipy import stats


@pytest.fixture
def pool():
    """A pool of twelve points with flags that the surrogate does not foresee well."""
    generator = np.random.default_rng(3)
    z, w = generator.normal(size=(12, 2)), generator.lognormal(0, 1, 12)
    p, flags = generator.random(12), generator.random(12) < 0.5
    g = np.where(p > 0.3, p, 0.0)
    return z, w, p, g, flags


PREDICTION = two_phase.Prediction(0.3, 4.0)
USUAL = pools.Defence()


def points(weight, probability):
    """Return a pool whose places do not matter, with a wide law that is h and rarities of 5."""
    n = len(weight)
    return pools.Pool(np.zeros((n, 2)), np.asarray(weight), probability, np.ones(n), np.full(n, 5.0))


def batch(weight, control, inclusion, controlled, controlled_square=0.0, *, aimed=True):
    """Return a batch whose places do not matter."""
    drawn = (np.asarray(values) for values in (weight, control, inclusion))
    return two_phase.TwoPhaseBatch(
        np.zeros((len(weight), 2)),
        *drawn,
        controlled,
        controlled_square,
        np.full(len(weight), aimed),
        np.array([[1.0, 0.0, REACH]]),
        PREDICTION,
        np.zeros((len(weight), 2)),
        kept=np.empty((0, 2)),
        kept_weight=np.empty(0),
        kept_control=np.empty(0),
    )


@dataclass
class Start:
    """A generator that returns a given start of the systematic sample."""

    u: float

    def random(self):
        return self.u


@pytest.mark.parametrize(("count", "n", "spread"), [(12, 4, 1.0), (2000, 10, 3.0), (2000, 300, 2.0)])
def test_inclusion_probabilities(count, n, spread):
    generator = np.random.default_rng(count + n)
    size = generator.lognormal(0, spread, count) * (generator.random(count) < 0.7)
    guard = generator.lognormal(0, 0.3, count)
    pi = two_phase.inclusion_probabilities(size, guard, n, 0.2)
    assert pi.sum() == pytest.approx(n, rel=1e-12)
    assert pi.max() <= 1
    certain = (pi == 1).sum()
    assert (pi >= np.minimum(0.2 * (n - certain) * guard / guard.sum(), 1) * (1 - 1e-12)).all()
    defended = 0.8 * size / size.sum() + 0.2 * guard / guard.sum()
    ratio = (pi / defended)[pi < 1]
    assert ratio == pytest.approx(ratio[0], rel=1e-12)
    nothing = two_phase.inclusion_probabilities(np.zeros(count), guard, 1, 0.2)
    assert nothing == pytest.approx(guard / guard.sum(), rel=1e-12)


def test_some_points_are_certain():
    pi = two_phase.inclusion_probabilities(np.array([100.0, 50.0, 1.0, 1.0, 1.0, 1.0]), np.ones(6), 3, 0.2)
    # without the defence: 1, 1 and a quarter of the third run for each
    assert pi == pytest.approx([1, 1, 0.25, 0.25, 0.25, 0.25], rel=1e-12)


def test_the_defence_is_worth_draws_of_the_wide_law():
    """No point is included less often than by as many draws, and more draws would break that."""
    generator = np.random.default_rng(5)
    wide = generator.lognormal(0, 1, 400) * (generator.random(400) < 0.5)
    wide /= wide.mean()
    guard = EVEN + (1 - EVEN) * wide
    pi = two_phase.inclusion_probabilities(generator.lognormal(0, 3, 400), guard, 10, 0.2)
    draws = two_phase.draws_of_the_wide_law(wide, pi)
    assert 1 < draws < 3
    assert (pi >= draws * wide / 400 * (1 - 1e-12)).all()
    assert (pi < 1.001 * draws * wide / 400).any()
    assert two_phase.draws_of_the_wide_law(0 * wide, pi) == 0
    underflown = np.where(wide > 0, wide, 5e-324)  # the draws of such a point are beyond all numbers
    with np.errstate(over="raise"):
        assert two_phase.draws_of_the_wide_law(underflown, pi) == draws


def test_the_cut_wide_law_keeps_its_mass():
    """The law of uniform rarity, cut at a third of its reach, is three times as dense there."""
    rarity = (np.arange(600) + 0.5) / 600 * REACH
    weight, nowhere = np.ones(600), np.zeros(600)
    weight[-1] = 0  # so far out that no cut-in belongs to it
    pool = pools.Pool(np.zeros((600, 2)), weight, nowhere, np.ones(600), rarity)
    within = pool.within(0.0, REACH / 3)
    assert within.mean() == pytest.approx(1)
    assert set(within.round(9)) == {0.0, 3.0}
    assert (pool.guard(REACH / 3, USUAL)[:-1] > 0).all()
    assert pool.guard(REACH / 3, USUAL)[-1] == 0
    prediction = two_phase.predict(pool, two_phase.expect(pool, 0.0), 3, 600, USUAL)
    assert prediction == two_phase.Prediction(0.0, LARGEST)


@pytest.mark.parametrize("share", [0.2, 0.9])
def test_the_defence_is_where_something_is_looked_for(share):
    """A quarter of the usual fifth of the runs is spread evenly, and all else beyond what is said."""
    rarity = (np.arange(600) + 0.5) / 600 * REACH
    pool = pools.Pool(np.zeros((600, 2)), np.ones(600), np.zeros(600), np.ones(600), rarity)
    there = (rarity > 15.0) & (rarity <= 20.0)
    guard = pool.guard(20.0, pools.Defence(share, beyond=15.0))
    np.testing.assert_allclose(guard, 0.05 + np.where(there, (share - 0.05) * 12, 0.0), atol=1e-12)
    # Where no part can be beyond, all of a larger share too is spread as usual.
    for beyond in (0.0, 20.0, 30.0):
        np.testing.assert_array_equal(pool.guard(20.0, pools.Defence(share, beyond)), pool.guard(20.0, USUAL))
        assert pools.Defence(share, beyond).zones(20.0) == [(0.0, 20.0)]


def test_systematic_sample_includes_by_pi(pool):
    z, w, p, _, _ = pool
    pi = two_phase.inclusion_probabilities(w * np.sqrt(p), np.ones(12), 4, 0.2)
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
    pi = two_phase.inclusion_probabilities(w * np.sqrt(p), np.ones(12), 4, 0.2)
    starts = 2000

    def mean_estimate(pi_used, g_used, controlled):
        estimates = []
        for k in range(starts):
            chosen = two_phase.draw_systematically(z, w * p, pi, Start((k + 0.5) / starts))
            drawn = batch(w[chosen] / 12, g_used[chosen], pi_used[chosen], controlled)
            estimates.append(combining.estimate_batch(drawn, flags[chosen]).probability)
        return np.mean(estimates), 12 * np.ptp(estimates) / (2 * starts)

    truth = (w * flags).mean()
    mean, error = mean_estimate(pi, g, (w @ g) / 12)
    assert error < 0.02 * truth
    assert abs(mean - truth) <= error
    for wrong in ((np.full(12, 4 / 12), g, (w @ g) / 12), (pi, g, 0.0), (pi, np.zeros(12), (w @ g) / 12)):
        mean, error = mean_estimate(*wrong)
        assert abs(mean - truth) > 3 * error


def test_observed_variance_by_hand():
    drawn = batch([0.1, 0.2], [0.5, 0.0], [0.5, 0.25], 0.3, controlled_square=0.02)
    kept = combining.estimate_batch(drawn, np.array([True, False]))
    # w (event - g) / pi: 0.1 * 0.5 / 0.5 = 0.1 and 0
    assert kept.probability == pytest.approx(0.3 + 0.1)
    assert kept.observed_variance == pytest.approx((0.02 + 0.1 * 0.1) + 0.1**2 * 0.5 * 2)
    assert (kept.importance, kept.runs, kept.prediction) == (2 / 4.0, 2, PREDICTION)
    assert not kept.surprising


def test_an_unforeseen_event_of_large_weight_is_a_surprise():
    """A weight over inclusion of 0.1 / 0.2 exceeds the predicted 0.3; 0.1 / 0.5 does not."""
    for inclusion, aimed, surprising in ((0.2, False, True), (0.5, False, False), (0.2, True, False)):
        drawn = batch([0.1, 0.1], [0.0, 0.0], [inclusion, 0.2], 0.0, aimed=aimed)
        assert combining.estimate_batch(drawn, np.array([True, False])).surprising == surprising


def test_expectation_by_hand():
    w = np.array([9.0, 9.0, 9.0, 1.0, 1.0, 1.0])
    expected = two_phase.expect(points(w, np.array([0.9, 0.1, 0.04, 0.04, 0.002, 0.0005])), 2.0)
    assert expected.probability.tolist() == [0.9, 0.1, 0.0, 0.04, 0.002, 0.0]
    assert expected.control.tolist() == [0.9, 0.0, 0.0, 0.0, 0.0, 0.0]
    # E (1 - g)^2 p + g^2 (1 - p); without a control variate that is p
    assert expected.error == pytest.approx([0.9 * 0.1**2 + 0.1 * 0.9**2, 0.1, 0.0, 0.04, 0.002, 0.0])


def test_predicted_variance_by_hand(pool):
    _, w, p, _, _ = pool
    drawn = points(w, p)
    expected = two_phase.expect(drawn, 0.0)
    p, error = expected.probability, expected.error
    pi = two_phase.inclusion_probabilities(w * np.sqrt(error + FLOOR * p), drawn.guard(5.0, USUAL), 3, 0.2)
    mean = sum(w * p) / 12
    second = sum(w[i] ** 2 * error[i] / pi[i] for i in range(12)) / 12**2
    first = (sum(w**2 * p) / 12 - mean**2) / 12
    prediction = two_phase.predict(drawn, expected, 3, 12, USUAL)
    assert prediction.probability == pytest.approx(mean)
    assert prediction.variation == pytest.approx(3 * (second + first) / mean**2)
    # Twice the runs out of a pool twice as large are worth the same each.
    twice = two_phase.predict(drawn, expected, 6, 24, USUAL)
    assert (twice.probability, twice.variation) == pytest.approx((mean, prediction.variation))
    nothing = points(w, 0 * p)
    prediction = two_phase.predict(nothing, two_phase.expect(nothing, 0.0), 3, 12, USUAL)
    assert prediction == two_phase.Prediction(0.0, LARGEST)


def of_batches(*known):
    """Return batches with the predictions (P, variation), and a surprise where there is a third entry."""
    return [
        combining.BatchEstimate(
            float(k), 1.0, 10, two_phase.Prediction(*entry[:2]), surprising=len(entry) > 2
        )
        for k, entry in enumerate(known)
    ]


GOOD, POOR = 0.9 * USABLE**2, 1.1 * USABLE**2


@pytest.mark.parametrize(
    ("known", "first"),
    [
        ([(1.0, POOR), (1.0, POOR), (1.0, GOOD), (1.0, POOR)], 2),  # since the surrogate first was usable
        ([(1.0, GOOD), (1.0, GOOD)], 1),  # the first has nothing to agree with
        ([(1.0, GOOD), (1.0, GOOD), (3.0, GOOD), (3.0, GOOD)], 3),  # anew when the view of the event changes
        ([(1.0, GOOD), (1.0, GOOD), (1.5, GOOD), (1.9, GOOD)], 1),  # within the agreement
        ([(1.0, GOOD), (1.0, GOOD), (1.5, GOOD), (2.2, GOOD), (2.2, GOOD)], 4),  # slowly, but out of it
        ([(1.0, GOOD), (1.0, GOOD), (1.0, GOOD, "!"), (1.0, GOOD), (1.0, GOOD)], 4),  # anew after a surprise
        ([(1.0, GOOD), (1.0, GOOD), (1.0, GOOD, "!")], 3),  # nothing yet
        ([(0.0, LARGEST), (0.0, LARGEST)], 2),
        ([], 0),
    ],
)
def test_batches_count_while_they_share_one_view_of_the_event(known, first):
    assert 1.9 < AGREEMENT < 2.2
    kept = combining.consistent_batches(of_batches(*known))
    assert [each.probability for each in kept] == list(range(first, len(known)))


@pytest.mark.parametrize(("observed", "predicted", "larger"), [(4.0, 0.01, 4.0), (1.0, 0.25, 0.25 * 2.5**2)])
def test_combined_estimate_by_hand(observed, predicted, larger):
    """Batches of 2 and 6 runs count 1 to 3 where their predictions are as good as can make a difference."""
    estimates = [
        combining.BatchEstimate(value, observed, runs, two_phase.Prediction(1.0, predicted * runs), False)
        for value, runs in ((1.0, 2), (3.0, 6))
    ]
    assert [each.importance for each in estimates] == pytest.approx([2 / BEST**2, 6 / BEST**2])
    combined = combining.combine(estimates)
    shares = 0.25**2 + 0.75**2
    assert combined.probability == pytest.approx(0.25 * 1 + 0.75 * 3)
    assert combined.observed_variance == pytest.approx(shares * observed)
    assert combined.predicted_variance == pytest.approx(shares * predicted * 2.5**2)
    # Student's t with one degree of freedom has its 90 % quantile at tan(0.4 pi).
    reach = np.tan(0.4 * np.pi) * np.sqrt(shares * larger) / 2.5
    low, high = combined.interval(0.2)
    assert (low, high) == pytest.approx((2.5 / (1 + reach), 2.5 / (1 - reach) if reach < 1 else np.inf))


@pytest.mark.parametrize(("error", "batches", "alpha"), [(0.156, 18, 0.2), (0.3, 4, 0.05), (2.0, 10, 0.2)])
def test_interval_ends_where_the_estimate_is_as_far_off_as_its_relative_error_allows(error, batches, alpha):
    low, high = combining.interval(3.0, error, batches, alpha)
    quantile = stats.t.ppf(1 - alpha / 2, batches - 1)
    assert (3.0 - low) / (error * low) == pytest.approx(quantile)
    if quantile * error < 1:
        assert (high - 3.0) / (error * high) == pytest.approx(quantile)
    else:
        assert high == np.inf


def test_interval_holds_as_often_as_it_says_where_the_error_is_a_share_of_the_truth():
    """The wrong interval, symmetric about the estimate, misses mostly on one side and must be told apart."""
    generator, n, batches = np.random.default_rng(5), 20_000, 12
    each = generator.normal(1.0, 0.5, (n, batches))
    estimate, error = each.mean(1), 0.5 / np.sqrt(batches)  # the error is known, and no share of the estimate
    ends = [combining.interval(y, error, 10**6, 0.2) for y in estimate]
    too_low = np.mean([high < 1 for _, high in ends])
    too_high = np.mean([low > 1 for low, _ in ends])
    se = np.sqrt(0.1 * 0.9 / n)
    assert [too_low, too_high] == pytest.approx([0.1, 0.1], abs=4 * se)
    symmetric_too_low = np.mean(estimate * (1 + stats.norm.ppf(0.9) * error) < 1)
    assert symmetric_too_low > 0.1 + 10 * se


def test_kept_points_integrate_the_control_variate_under_another_law():
    generator = np.random.default_rng(8)
    z, w = generator.normal(size=(4000, 2)), generator.lognormal(0, 1, 4000)
    mass = w * np.where(z[:, 0] > 0.5, 0.8, 0.0)
    kept = two_phase.spread_by_mass(z, mass, 400)
    ratio = np.exp(0.5 * z[:, 0] - 0.2 * z[:, 1])
    exact = (mass * ratio).sum() / mass.sum()
    error = ratio[kept].std() / np.sqrt(400)
    assert abs(ratio[kept].mean() - exact) < 4 * error
    assert (mass[kept] > 0).all()
    unweighted = generator.choice(np.flatnonzero(mass), 400)  # the points without their masses
    assert abs((w * ratio)[unweighted].mean() - exact) > 4 * error
    assert two_phase.spread_by_mass(z, np.zeros(4000), 400).size == 0


def test_the_sampler_keeps_what_its_estimates_are_made_of():
    sampler, event = new_sampler(), half_plane()
    drive(sampler, event)
    progress = sampler.progress
    assert len(progress.batches) == len(progress.estimates)
    runs = sum(len(batch.z) for batch in progress.batches)
    np.testing.assert_array_equal(np.vstack([batch.z for batch in progress.batches]), progress.z[-runs:])
    first = len(progress.z) - runs
    for batch, estimate in zip(progress.batches, progress.estimates, strict=True):
        happened = progress.happened[first : first + len(batch.z)]
        assert combining.estimate_batch(batch, happened) == estimate
        first += len(batch.z)
    assert {batch.kept.shape for batch in progress.batches} <= {(KEPT, 2), (0, 2)}
