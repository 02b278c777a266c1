"""Runs that are requested while others are pending, and outcomes in any order and in parts."""

import heapq

import numpy as np
import pytest
from fewruns import InputError, Stopping
from sampler_checks import new_sampler, resumed, saved, standard_normal_event
from scipy.spatial.distance import pdist
from scipy.stats import norm

EVENT, GOAL = standard_normal_event(lambda z: 4.2 - z[:, 0]), Stopping()


def at_work(workers, seed):
    """Return the time, the runs and the estimate of workers that need 1 to 4 units of time for a run."""
    sampler, generator = new_sampler(2, seed, 5), np.random.default_rng(1000 + seed)
    busy, now = [], 0.0
    while not sampler.is_done(GOAL):
        if len(busy) < workers:
            z = sampler.ask(workers - len(busy), certify=sampler.is_narrow(GOAL))
            for number, point in zip(sampler.numbers, z, strict=True):
                heapq.heappush(busy, (now + generator.uniform(1, 4), int(number), tuple(point)))
        now, number, point = heapq.heappop(busy)
        sampler.tell(*EVENT.evaluate(np.array([point])), runs=[number])
    return now, sampler.simulations, sampler.estimate(GOAL)


def test_many_workers_end_early():
    """Five workers that wait for the slowest of their batch take 73 units of time."""
    found = [at_work(64, seed) for seed in range(3)]
    assert all(estimate.converged for *_, estimate in found)
    assert np.mean([now for now, *_ in found]) <= 24
    assert np.mean([runs for _, runs, _ in found]) <= 200


@pytest.mark.seeds
def test_pending_runs_do_not_bias_the_estimate():
    """The estimates vary by 0.06, so that a bias of 0.07 is noticed with a probability of 0.98."""
    seeds = 12
    ratios = np.array([at_work(64, seed)[-1].probability for seed in range(seeds)]) / norm.sf(4.2)
    assert abs(ratios.mean() - 1) < 2 * ratios.std(ddof=1) / np.sqrt(seeds)


@pytest.mark.parametrize("course", ["one worker", "in parts and backwards"])
def test_the_order_of_the_outcomes_changes_nothing(course):
    whole, other = new_sampler(2, 1, 5), new_sampler(2, 1, 5)
    while not whole.is_done(GOAL):
        certify = whole.is_narrow(GOAL)
        z = whole.ask(certify=certify)
        whole.tell(*EVENT.evaluate(z))
        if course == "one worker":
            for point in z:
                assert (other.ask(1, certify=certify) == point).all()
                other.tell(*EVENT.evaluate(point[None]))
        else:
            again, numbers = other.ask(certify=certify)[::-1], other.numbers[::-1]
            for part in np.array_split(np.arange(len(z)), min(2, len(z))):
                flags, score = EVENT.evaluate(again[part])
                other.tell(flags, score, runs=numbers[part])
    assert whole.has_converged(GOAL)
    assert saved(other) == saved(whole)


def test_pending_runs_are_not_proposed_again():
    sampler = new_sampler(2, 1, 5)
    while not len(sampler.progress.sampled) or sampler.progress.estimates[-1].runs == 0:
        sampler.tell(*EVENT.evaluate(sampler.ask()))
    z = np.vstack([sampler.ask(10, certify=True) for _ in range(3)])
    assert len(sampler.outstanding) == len(z) > 10
    assert pdist(z).min() > 1e-3


def test_outcomes_in_parts_are_saved():
    sampler = new_sampler(2, 1, 5)
    z = sampler.ask(8)
    assert sampler.numbers.tolist() == list(range(8))
    sampler.tell(np.zeros(2, bool), runs=[1, 6])
    assert sampler.simulations == 0  # no batch is complete
    for each in (sampler, resumed(sampler)):
        assert (each.ask(4) == each.ask()[6:]).all()  # all outstanding runs, with those of the last request
        assert each.numbers.tolist() == [0, 2, 3, 4, 5, 7, 8, 9]
        assert (each.ask()[:6] == z[[0, 2, 3, 4, 5, 7]]).all()
        each.tell(np.zeros(4, bool), runs=[4, 3, 0, 2])
        assert each.simulations == 5


@pytest.mark.parametrize("runs", [[0, 0], [1, 7], [-1, 0]])
def test_runs_that_are_not_outstanding_are_refused(runs):
    sampler = new_sampler(2, 1, 5)
    sampler.ask(4)
    with pytest.raises(InputError, match="each once"):
        sampler.tell([False, False], runs=runs)
    assert sampler.outstanding.tolist() == [0, 1, 2, 3]
