"""What is believed of the event, against half-spaces whose every flag and score is known."""

import numpy as np
import pytest
from fewruns import Predecessor
from fewruns.belief import Belief
from fewruns.constants import MOST_TRUST
from fewruns.gaussian_process import EventSurrogate
from fewruns.graded import GradedSurrogate
from fewruns.pools import Subspace, WholeSpace
from fewruns.progress import Progress
from fewruns.wide_laws import draw_wide
from scipy.stats import norm

DIMENSION = 6


def near_the_boundary(n, seed):
    """Return points about the design point of the half-space z_1 > 4.5."""
    z = np.random.default_rng(seed).normal(size=(n, DIMENSION))
    z[:, 0] += 4.5
    return z


def first_runs():
    """Return some points of the wide law, and more near the boundary."""
    return np.vstack([draw_wide(20, DIMENSION, np.random.default_rng(1)), near_the_boundary(60, 1)])


def seen(z, *, misleading=False):
    """Return what a sampler has seen of these points."""
    progress = Progress.start(DIMENSION)
    progress.z, progress.happened = z, z[:, 0] > 4.5
    progress.score = np.sin(40 * z[:, 1]) if misleading else 4.5 - z[:, 0]
    return progress


def surprise(probability, z):
    """Return the mean of -log of what was foretold for the flags that came true."""
    p = np.clip(probability, 1e-6, 1 - 1e-6)
    return -np.log(np.where(z[:, 0] > 4.5, p, 1 - p)).mean()


def put_to_the_test(runs, *, misleading):
    """Return a belief that foretold some runs of the second phase, and then saw them."""
    belief, z, later = Belief(WholeSpace(DIMENSION), None), first_runs(), near_the_boundary(runs, 3)
    belief.fit(seen(z, misleading=misleading), learn=True)
    after = seen(np.vstack([z, later]), misleading=misleading)
    after.foreseen = belief.foresee(later)
    belief.fit(after, learn=True)
    return belief


@pytest.mark.parametrize("misleading", [False, True])
def test_smooth_scores_foretell_more_than_flags_and_misleading_ones_less(misleading):
    belief, new = Belief(WholeSpace(DIMENSION), None), near_the_boundary(400, 2)
    belief.fit(seen(first_runs(), misleading=misleading), learn=True)
    by_flags, by_scores = (surprise(said, new) for said in belief.foresee(new).T)
    assert (by_scores > by_flags) if misleading else (by_scores < 0.7 * by_flags)


@pytest.mark.parametrize("misleading", [False, True])
def test_trust_is_learnt_from_what_was_foretold(misleading):
    """What is believed ends near the better of the two, and far from the other."""
    belief, new = put_to_the_test(60, misleading=misleading), near_the_boundary(400, 2)
    believed = surprise(belief.probability(new), new)
    better, worse = sorted(surprise(said, new) for said in belief.foresee(new).T)
    assert believed < better + 0.1 * (worse - better) + 0.02


def test_scores_that_foretold_too_badly_are_not_asked(monkeypatch):
    """Their share would be below what can bring a point into the fringe, and the time is saved."""
    belief, new = put_to_the_test(120, misleading=True), near_the_boundary(50, 2)
    assert (belief.foresee(new)[:, 0] != belief.foresee(new)[:, 1]).any()  # they are still tested

    def ask(*_):
        raise AssertionError("the scores were asked")

    expected = belief.probability(new)
    monkeypatch.setattr(belief, "_second", ask)
    np.testing.assert_array_equal(belief.probability(new), expected)
    with pytest.raises(AssertionError, match="asked"):
        belief.foresee(new)


def test_flags_speak_for_both_before_scores_say_anything():
    belief, z = Belief(WholeSpace(DIMENSION), None), draw_wide(30, DIMENSION, np.random.default_rng(4))
    progress = seen(z)
    progress.happened = np.zeros(30, bool)
    belief.fit(progress, learn=True)
    by_flags, by_scores = belief.foresee(z).T
    assert (by_flags == by_scores).all()
    np.testing.assert_allclose(belief.probability(z), by_flags, rtol=1e-3, atol=2e-6)


def beside_a_predecessor():
    """Return a belief that knows a vehicle which is safe where the new one is not, and that vehicle."""
    old = np.vstack([near_the_boundary(150, 5), 9.0 * np.eye(DIMENSION)[:1]])
    old = Predecessor(old, old[:, 0] > 8.0)
    return Belief(WholeSpace(DIMENSION), old), old


def test_beside_a_predecessor_the_own_flags_are_the_second_opinion():
    """The scores of the predecessor are not known, so that the regression would know less than the flags."""
    belief, old = beside_a_predecessor()
    progress, new = seen(first_runs()[:20]), near_the_boundary(50, 2)
    belief.fit(progress, learn=True)
    own = EventSurrogate(DIMENSION)
    own.fit(progress.z, progress.happened, learn=False)
    by_all, by_own = belief.foresee(new).T
    np.testing.assert_allclose(by_own, own.probability(new))
    assert np.median(by_own) > 3 * np.median(by_all)  # the predecessor was safe there
    nothing = Belief(WholeSpace(DIMENSION), old)
    nothing.fit(Progress.start(DIMENSION), learn=True)
    by_all, by_own = nothing.foresee(new).T
    assert (by_all == by_own).all()


def test_a_predecessor_cannot_rule_out_what_the_own_flags_hold_possible():
    """It lowers a chance by a factor of 20 at most, even where it was right in all runs so far."""
    belief, _ = beside_a_predecessor()
    z, runs = first_runs(), draw_wide(80, DIMENSION, np.random.default_rng(6))
    runs = runs[runs[:, 0] < 0]  # where both are safe
    progress = seen(np.vstack([z, runs]))
    progress.foreseen = np.column_stack([np.full(len(runs), 1e-6), np.full(len(runs), 0.3)])
    belief.fit(progress, learn=True)
    new = near_the_boundary(50, 2)
    _, by_own = belief.foresee(new).T
    trust = belief._calibration.trust
    assert trust == pytest.approx(1 - MOST_TRUST)
    assert (belief.probability(new) >= trust * belief._calibration.second(by_own) * (1 - 1e-9)).all()


def test_what_lies_across_the_directions_counts_as_noise():
    """The event is z_1 + z_2 / 2 > 4.5, and only z_1 is a direction; its probability given z_1 is known."""
    z = np.vstack([draw_wide(60, DIMENSION, np.random.default_rng(4)), near_the_boundary(240, 5)])
    progress = Progress.start(DIMENSION)
    progress.z, progress.score = z, 4.5 - z[:, 0] - z[:, 1] / 2
    progress.happened = progress.score < 0
    belief = Belief(Subspace(np.eye(DIMENSION)[:, :1]), None)
    belief.fit(progress, learn=True)
    new = near_the_boundary(500, 6)
    exact = norm.cdf(2 * (new[:, 0] - 4.5))

    def error():
        return np.abs(belief.foresee(new)[:, 1] - exact).mean()

    assert error() < 0.08
    belief._scores_are_noisy = False
    assert error() > 0.12  # too sure


def half_plane_runs(n=25):
    """Return points in two inputs, near and far from the boundary of z_1 > 1, and their scores."""
    z = np.random.default_rng(4).normal(size=(n, 2))
    z[:, 0] += 1.0
    return z, 1.0 - z[:, 0]


def test_left_out_runs_are_predicted_from_the_others():
    """Each run is left out in turn, and the surrogate fitted again to the others with the same parameters."""
    z, outcome = half_plane_runs()
    scores, flags = GradedSurrogate(2), EventSurrogate(2, amplitude=2.0)
    scores.fit(z, outcome, learn=False)
    flags.fit(z, outcome < 0, learn=False)
    again = np.empty((2, len(z)))
    for run in range(len(z)):
        others = np.arange(len(z)) != run
        by_scores, by_flags = GradedSurrogate(2), EventSurrogate(2, amplitude=2.0)
        by_scores.fit(z[others], outcome[others], learn=False)
        by_flags.fit(z[others], outcome[others] < 0, learn=False)
        again[:, run] = by_scores.probability(z[[run]], 0.0)[0], by_flags.probability(z[[run]])[0]
    assert scores.left_out(0.0) == pytest.approx(again[0], rel=1e-2, abs=1e-9)
    # By expectation propagation this is an approximation; a wrong one, with the run itself, is further off.
    off = np.abs(flags.left_out - again[1])
    assert off.max() < 0.05
    assert np.abs(flags.probability(z) - again[1]).max() > 3 * off.max()


@pytest.mark.parametrize(("dimension", "compared"), [(2, True), (3, False)])
def test_runs_of_the_search_compare_the_surrogates_with_two_inputs(dimension, compared):
    z = np.vstack([draw_wide(20, dimension, np.random.default_rng(1)), np.zeros((20, dimension))])
    z[20:] += np.random.default_rng(2).normal(size=(20, dimension))
    z[20:, 0] += 4.5
    for misleading in (False, True):
        progress = Progress.start(dimension)
        progress.z, progress.happened = z, z[:, 0] > 4.5
        progress.score = np.sin(40 * z[:, 1]) if misleading else 4.5 - z[:, 0]
        belief = Belief(WholeSpace(dimension), None)
        belief.fit(progress, learn=True)
        trust = belief._calibration.trust
        if compared:
            assert (trust < 0.3) if misleading else (trust > 0.7)
        else:
            assert trust == MOST_TRUST / 2  # nothing is known of the two
