"""The calibration of the surrogate's probabilities, against laws of flags whose slopes are known."""

import numpy as np
import pytest
from accelerated_evaluation.methods.surrogate.calibration import Calibration
from accelerated_evaluation.methods.surrogate.constants import SLOPE_SPREAD
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
    found = Calibration.learn(*flags(unlikely, likely, 40_000, 1))
    # The Fisher information of a slope is at least 0.05 a run here: four standard errors of 20,000 runs.
    error = 4 / np.sqrt(0.05 * 20_000)
    assert found.unlikely == pytest.approx(unlikely, abs=error)
    assert found.likely == pytest.approx(likely, abs=error)
    assert abs(Calibration.learn(*flags(1.0, 1.0, 40_000, 1)).unlikely - 1.8) > error


def test_calibrated_probabilities_come_true():
    foreseen, _ = flags(0.6, 1.7, 40_000, 2)
    calibration = Calibration.learn(*flags(0.6, 1.7, 40_000, 3))
    _, happened = flags(0.6, 1.7, 40_000, 2)
    calibrated = calibration(foreseen)
    for low, high in ((0.02, 0.1), (0.1, 0.5), (0.5, 0.9), (0.9, 1.0)):
        here = (foreseen >= low) & (foreseen < high)
        error = 4 * np.sqrt(0.25 / here.sum()) + 0.01
        assert happened[here].mean() == pytest.approx(calibrated[here].mean(), abs=error)
    least = foreseen < 0.1  # as foretold they would not come true
    assert happened[least].mean() > foreseen[least].mean() + 4 * np.sqrt(0.25 / least.sum())


def test_nothing_changes_before_any_run():
    calibration = Calibration.learn(np.empty(0), np.empty(0, bool))
    assert (calibration.unlikely, calibration.likely) == pytest.approx((1.0, 1.0), abs=1e-4)
    p = np.array([0.0, 1e-5, 0.3, 0.5, 0.9, 1.0])
    np.testing.assert_allclose(calibration(p), np.clip(p, 1e-6, 1 - 1e-6), rtol=1e-3)


def test_one_surprise_does_not_end_all_belief():
    foreseen = np.r_[np.full(30, 0.05), 0.0]
    found = Calibration.learn(foreseen, np.r_[np.zeros(30, bool), True])
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
        found = np.log(Calibration.learn(foreseen, happened).unlikely)
        assert found == pytest.approx(mode - sure * deviation, abs=0.2 * deviation)
