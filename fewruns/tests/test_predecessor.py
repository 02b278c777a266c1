"""Runs of a similar system: they save runs, do not mislead, and are part of the saved state."""

from dataclasses import replace

import numpy as np
import pytest
from fewruns import InputError, Predecessor, Sampler
from sampler_checks import (
    HALF_PLANE,
    STOPPING,
    drive,
    estimate,
    half_plane,
    new_sampler,
    numbers,
    resumed,
    standard_normal_event,
)
from scipy.stats import ttest_1samp

SEEDS = 5


def runs_of(event, seed=100):
    """Return the runs of another vehicle, as the sampler chose them."""
    progress = drive(new_sampler(seed=seed, batch_size=5), event).sampler.progress
    return Predecessor(progress.z, progress.happened)


def successors(predecessor, seeds=SEEDS):
    return [estimate(half_plane(), seed, predecessor=predecessor, upper_set=True) for seed in range(seeds)]


def ratios(results):
    return np.array([result.probability for result in results]) / HALF_PLANE


@pytest.fixture(scope="module")
def like():
    """Estimates of the half plane at 4, from the runs of one at 4.2."""
    return successors(runs_of(half_plane(4.2)))


@pytest.mark.seeds
def test_the_runs_of_a_like_vehicle_save_half_and_do_not_mislead(like):
    alone = successors(None)
    assert all(result.converged for result in like)
    assert ttest_1samp(ratios(like), 1).pvalue > 0.01
    assert np.sqrt(np.mean((ratios(like) - 1) ** 2)) < 0.25
    # The predecessor's own probability, which is .41 of the truth, would be a wrong answer.
    assert ttest_1samp(ratios(like), 0.41).pvalue < 1e-3
    spent = [np.mean([result.simulations for result in results]) for results in (like, alone)]
    assert spent[0] < 0.7 * spent[1]


@pytest.mark.seeds
def test_a_predecessor_that_is_not_alike_costs_runs_and_not_the_truth(like):
    other = standard_normal_event(lambda z: 4 - z @ [0.0, 1.0])
    results = successors(runs_of(other), seeds=3)
    assert (np.abs(np.log(ratios(results))) < np.log(2)).all()
    mean = [np.mean([result.simulations for result in part]) for part in (results, like)]
    assert mean[0] > mean[1]


def test_a_vehicle_that_never_fails_after_one_that_did_has_a_bound():
    never = standard_normal_event(lambda z: np.ones(len(z)))
    few = replace(STOPPING, maximum_simulations=60)
    result = estimate(never, 1, few, predecessor=runs_of(half_plane()))
    assert (result.probability, result.events, result.converged) == (0, 0, False)
    assert 0 < result.high < 1


def test_the_state_keeps_the_predecessor():
    event, predecessor = half_plane(), runs_of(half_plane(4.2))
    whole = new_sampler(seed=3, batch_size=5, predecessor=predecessor)
    whole.tell(*event.evaluate(whole.ask()))
    few = replace(STOPPING, maximum_simulations=60)
    ends = [drive(sampler, event, few) for sampler in (resumed(whole), whole)]
    assert numbers(ends[0].result) == numbers(ends[1].result)
    np.testing.assert_array_equal(ends[0].sampler.progress.z, ends[1].sampler.progress.z)


@pytest.mark.parametrize(
    ("z", "happened", "message"),
    [
        (np.zeros((3, 2)), np.zeros(3, bool), "no event"),
        (np.zeros((3, 3)), np.ones(3, bool), r"shape \(3, 3\); expected \(3, 2\)"),
        (np.zeros((3, 2)), np.ones(2, bool), r"shape \(3, 2\); expected \(2, 2\)"),
        (np.full((3, 2), np.nan), np.ones(3, bool), "points that are not finite"),
        (np.zeros((3, 2)), [0.0, np.nan, 1.0], "flags of the type float64; expected booleans"),
        (np.zeros((3, 2)), ["0", "0", "1"], "flags of the type <U1; expected booleans"),
    ],
)
def test_runs_that_do_not_fit_are_refused(z, happened, message):
    with pytest.raises(InputError, match=message):
        Sampler(2, np.random.default_rng(0), fingerprint="x", predecessor=Predecessor(z, happened))
