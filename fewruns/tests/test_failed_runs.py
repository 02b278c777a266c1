"""Runs without an outcome leave the estimate, and its interval allows for any outcome of them."""

import numpy as np
import pytest
from fewruns import InputError, Stopping
from fewruns.combining import combine, estimate_batch
from fewruns.two_phase import TwoPhaseBatch
from sampler_checks import new_sampler, numbers, resumed, standard_normal_event
from scipy.stats import norm

GOAL = Stopping(maximum_simulations=500)
EVENT = standard_normal_event(lambda z: 4.2 - z[:, 0])


def driven(seed, fails):
    """Return a sampler at its end, and its batches with the flags of all runs and with those that fail."""
    sampler, batches = new_sampler(2, seed, 5), []
    while not sampler.is_done(GOAL):
        z = sampler.ask(certify=sampler.is_narrow(GOAL))
        batch, (happened, score), failed = sampler.progress.pending, EVENT.evaluate(z), fails(z)
        sampler.tell(happened, np.where(failed, np.nan, score), failed=failed)
        if isinstance(batch, TwoPhaseBatch):
            batches.append((batch, happened, failed))
    return sampler, batches


def at_random(share):
    generator = np.random.default_rng(7)
    return lambda z: generator.random(len(z)) < share


def by_place(z):
    """One of a hundred inputs, which always fails."""
    return np.abs(z[:, 1] - 0.5) < 0.0143


def test_the_interval_contains_the_answers_if_all_or_no_failed_runs_are_events():
    sampler, batches = driven(1, at_random(0.1))
    counted, found = len(sampler.progress.consistent), sampler.estimate(GOAL)
    batches = batches[-counted:]
    assert sum(failed.sum() for *_, failed in batches) > 3
    answers = {}
    for name in ("none", "all"):
        flags = [np.where(failed, name == "all", happened) for _, happened, failed in batches]
        estimates = [estimate_batch(batch, each) for (batch, *_), each in zip(batches, flags, strict=True)]
        answers[name] = combine([each for each in estimates if each.runs]).probability
    combined = combine(sampler.progress.sampled)
    assert combined.probability - combined.less == pytest.approx(answers["none"])
    assert combined.probability + combined.more == pytest.approx(answers["all"])
    low, high = combined.interval(GOAL.alpha)
    assert answers["none"] <= combined.probability < answers["all"]
    assert (found.low, found.high) == pytest.approx((low - combined.less, high + combined.more))
    assert found.low < answers["none"] < answers["all"] < found.high
    assert high < found.high  # the wrong variant leaves the failed runs out of the interval
    assert f"{len(sampler.progress.failed)} of {found.simulations} runs" in found.warning
    assert (found.tables["runs"]["phase"] == "failed").sum() == len(sampler.progress.failed)
    assert numbers(resumed(sampler).estimate(GOAL)) == numbers(found)


@pytest.mark.parametrize("fails", [at_random(0.01), by_place])
def test_few_failures_take_few_more_runs(fails):
    plain = [driven(seed, lambda z: np.zeros(len(z), bool))[0].simulations for seed in range(10)]
    sampled = [driven(seed, fails)[0] for seed in range(10)]
    assert sum(len(sampler.progress.failed) for sampler in sampled) > 0
    assert np.mean([sampler.simulations for sampler in sampled]) <= 1.2 * np.mean(plain)
    assert sum(sampler.has_converged(GOAL) for sampler in sampled) >= 9
    assert sum(sampler.estimate(GOAL).covers(norm.sf(4.2)) for sampler in sampled) >= 7  # 80 % are expected


def test_many_failures_end_without_convergence():
    """Half of the event always fails: no number of runs shows it, and the interval says so."""
    sampler, _ = driven(1, lambda z: (z[:, 0] > 4) & (z[:, 1] > 0))
    found = sampler.estimate(GOAL)
    assert found.simulations < GOAL.maximum_simulations
    assert not found.converged
    assert "failed runs may be events" in found.reason
    assert found.covers(norm.sf(4.2))


def test_failed_runs_are_named_by_booleans():
    sampler = new_sampler()
    sampler.ask()
    with pytest.raises(InputError, match="which runs have no outcome"):
        sampler.tell(np.zeros(10, bool), failed=[3])
    with pytest.raises(InputError, match="NaN"):
        sampler.tell(np.zeros(10, bool), np.full(10, np.nan), failed=np.arange(10) > 0)
    sampler.tell(np.zeros(10, bool), np.full(10, np.nan), failed=np.ones(10, bool))
    assert (sampler.simulations, len(sampler.progress.z)) == (10, 0)
