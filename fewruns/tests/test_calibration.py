"""The calibration of what the two surrogates say, against laws of flags that are known."""

import numpy as np
import pytest
from fewruns.belief import Calibration, Slopes
from fewruns.constants import MOST_TRUST, SLOPE_SPREAD
from scipy.special import log_ndtr, ndtr, ndtri

SLOPES = (0.7, 1.0, 1.8)


def flags(unlikely, likely, size, seed):
    """Return what was foretold and what happened where the slopes are known."""
    generator = np.random.default_rng(seed)
    foreseen = generator.uniform(0.02, 0.98, size)
    probit = ndtri(foreseen)
    return foreseen, generator.random(size) < ndtr(np.where(foreseen < 0.5, unlikely, likely) * probit)


@pytest.mark.parametrize("unlikely", SLOPES)
@pytest.mark.parametrize("likely", SLOPES)
def test_many_runs_tell_both_slopes(unlikely, likely):
    found = Slopes.learn(*flags(unlikely, likely, 40_000, 1))
    # The Fisher information of a slope is at least 0.05 a run here: four standard errors of 20,000 runs.
    error = 4 / np.sqrt(0.05 * 20_000)
    assert found.unlikely == pytest.approx(unlikely, abs=error)
    assert found.likely == pytest.approx(likely, abs=error)
    assert abs(Slopes.learn(*flags(1.0, 1.0, 40_000, 1)).unlikely - 1.8) > error


def test_calibrated_probabilities_come_true():
    foreseen, _ = flags(0.6, 1.7, 40_000, 2)
    slopes = Slopes.learn(*flags(0.6, 1.7, 40_000, 3))
    _, happened = flags(0.6, 1.7, 40_000, 2)
    calibrated = slopes(foreseen)
    for low, high in ((0.02, 0.1), (0.1, 0.5), (0.5, 0.9), (0.9, 1.0)):
        here = (foreseen >= low) & (foreseen < high)
        error = 4 * np.sqrt(0.25 / here.sum()) + 0.01
        assert happened[here].mean() == pytest.approx(calibrated[here].mean(), abs=error)
    least = foreseen < 0.1  # as foretold they would not come true
    assert happened[least].mean() > foreseen[least].mean() + 4 * np.sqrt(0.25 / least.sum())


def test_nothing_changes_before_any_run():
    slopes = Slopes.learn(np.empty(0), np.empty(0, bool))
    assert (slopes.unlikely, slopes.likely) == pytest.approx((1.0, 1.0), abs=1e-4)
    p = np.array([0.0, 1e-5, 0.3, 0.5, 0.9, 1.0])
    np.testing.assert_allclose(slopes(p), np.clip(p, 1e-6, 1 - 1e-6), rtol=1e-3)


def test_one_surprise_does_not_end_all_belief():
    foreseen = np.r_[np.full(30, 0.05), 0.0]
    found = Slopes.learn(foreseen, np.r_[np.zeros(30, bool), True])
    assert 0.3 < found.unlikely < 1
    # The other side has learnt nothing.
    assert found.likely == pytest.approx(1.0, abs=1e-4)


def test_doubt_is_learnt_at_once_and_sureness_as_far_as_it_is_shown():
    """Sureness differs from the slope of highest density by a standard deviation, here found on a grid."""
    for slope, sure in ((0.6, False), (1.8, True)):
        foreseen, happened = flags(slope, slope, 400, 5)
        below = foreseen < 0.5
        towards = np.where(happened[below], 1, -1) * ndtri(foreseen[below])
        grid = np.linspace(-1.2, 1.5, 4001)
        log_density = log_ndtr(np.exp(grid)[:, None] * towards).sum(1) - (grid / SLOPE_SPREAD) ** 2 / 2
        density = np.exp(log_density - log_density.max())
        mode, mean = grid[density.argmax()], (grid * density).sum() / density.sum()
        deviation = np.sqrt(((grid - mean) ** 2 * density).sum() / density.sum())
        found = np.log(Slopes.learn(foreseen, happened).unlikely)
        assert found == pytest.approx(mode - sure * deviation, abs=0.2 * deviation)


def two_views(size, seed, *, scores_are_right):
    """Return what two surrogates foretold, and what happened by one of them."""
    generator = np.random.default_rng(seed)
    foreseen = generator.uniform(0.02, 0.98, (size, 2))
    return foreseen, generator.random(size) < foreseen[:, int(scores_are_right)]


@pytest.mark.parametrize("scores_are_right", [False, True])
def test_the_surrogate_that_foretells_better_is_trusted(scores_are_right):
    calibration = Calibration.learn(*two_views(400, 8, scores_are_right=scores_are_right))
    assert calibration.trust == pytest.approx(MOST_TRUST if scores_are_right else 0.0, abs=1e-6)


def test_trust_follows_from_the_odds_of_what_came_true():
    """By hand: the likelihood of the flags under each view, with slopes that are learnt apart."""
    foreseen, happened = two_views(6, 9, scores_are_right=True)
    calibrated = [Slopes.learn(said, happened)(said) for said in foreseen.T]
    likelihood = [np.where(happened, p, 1 - p).prod() for p in calibrated]
    found = Calibration.learn(foreseen, happened)
    assert found.trust == pytest.approx(MOST_TRUST * likelihood[1] / sum(likelihood))
    assert abs(found.trust - MOST_TRUST / 2) > 0.02
    by_flags, by_scores = found.first(foreseen[:, 0]), found.second(foreseen[:, 1])
    mixed = by_flags + found.trust * (by_scores - by_flags)
    np.testing.assert_allclose(found(foreseen), mixed)


def test_before_any_run_both_count_alike_and_the_flags_never_lose_all():
    found = Calibration.learn(np.empty((0, 2)), np.empty(0, bool))
    assert found.trust == pytest.approx(MOST_TRUST / 2)
    sure = Calibration.learn(*two_views(400, 8, scores_are_right=True))
    held_possible = np.array([[0.5, 1e-9]])
    assert sure(held_possible)[0] > 0.9 * (1 - MOST_TRUST) * 0.5


def test_two_surrogates_that_say_the_same_are_one():
    """Where the scores say nothing of their own, what is believed is what the flags say, calibrated."""
    foreseen, happened = flags(0.7, 1.8, 2000, 4)
    found = Calibration.learn(np.column_stack([foreseen, foreseen]), happened)
    alone = Slopes.learn(foreseen, happened)
    np.testing.assert_allclose(found(np.column_stack([foreseen, foreseen])), alone(foreseen))
