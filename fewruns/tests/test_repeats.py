"""Whether a system repeats itself: what repeats show, and that no estimate converges without knowing it."""

import math
from functools import partial

import numpy as np
import pytest
from fewruns import Sampler, SystemProblem
from fewruns.constants import DRIFT, DRIFT_PAIRS, ENOUGH_REPEATS, FIRST_REPEATS, FREQUENT_SHARE
from fewruns.repeats import RepeatBatch, Repeats, end_differently, where_lapses_matter
from fewruns.repeats import choose_repeats as choose
from sampler_checks import STOPPING, estimate, new_sampler, resumed, saved
from scipy.special import ndtr
from scipy.stats import binom

LEVEL = 3.5


def system(rate, generator, *, deterministic=None):
    """A half-plane; in a share of the runs everything beyond another level is an event as well."""

    def respond(z):
        score = LEVEL - z[:, 0]
        score = np.where(generator.random(len(z)) < rate, score - 1.5, score)
        return score < 0, score

    return SystemProblem(respond, 2, fingerprint="lapses", deterministic=deterministic)


def sampler_of(event, enough, seed=0):
    settings = {"deterministic": event.deterministic, "enough_repeats": enough, "upper_set": True}
    return new_sampler(seed=seed, batch_size=5, **settings)


def drive(sampler, event, most=400):
    while not sampler.has_converged(STOPPING) and sampler.simulations < most:
        sampler.tell(*event.evaluate(sampler.ask(certify=sampler.is_narrow(STOPPING))))
    return sampler.estimate(STOPPING)


def test_a_system_that_repeats_itself_costs_the_repeats_alone():
    rng = np.random.default_rng
    known = drive(sampler_of(event := system(0, rng(0), deterministic=True), 40), event)
    found = drive(sampler := sampler_of(event := system(0, rng(0)), 40), event)
    assert known.converged
    assert known.diagnostics["repeats"] == 0
    assert found.converged
    assert found.diagnostics["repeats"] == 40
    assert found.diagnostics["differed"] == 0
    assert found.simulations == sampler.simulations == len(found.tables["runs"])
    assert (found.tables["runs"]["phase"] == "repeat").sum() == 40


def test_noise_that_is_noticed_late_is_the_reason_why_earlier_batches_do_not_count():
    event = system(0, np.random.default_rng(0))
    sampler, before = sampler_of(event, 40), ""
    while not sampler.progress.chance_since and sampler.simulations < 400:
        happened, score = event.evaluate(sampler.ask(certify=sampler.is_narrow(STOPPING)))
        is_late = sampler.repeats_next and len(sampler.progress.repeats) > 0
        before = sampler.estimate(STOPPING).reason
        sampler.tell(happened, score + 0.1 * is_late)
    assert sampler.progress.chance_since > 0
    assert "checks for random outcomes are missing" in before
    found = sampler.estimate(STOPPING)
    assert (found.low, found.high) == (0, 1)
    assert "most outcomes are random" in found.reason


def test_lapses_that_repeats_notice_end_all_claims():
    """With lapses in a tenth of the runs no estimate claims to be exact as that of the first runs would."""
    event = system(0.1, np.random.default_rng(1))
    found = drive(sampler := sampler_of(event, 200), event)
    assert sampler.progress.chance
    assert found.diagnostics["differed"] > 0
    believed = system(0.1, np.random.default_rng(1), deterministic=True)
    assert drive(sampler_of(believed, 200), believed).converged  # the wrong variant is silent


def test_repeats_that_agree_exclude_the_stated_rate_of_lapses():
    """A system that lapses twice as often as is excluded never converges; with few repeats it does."""
    rate = 2 * (1 - 0.05 ** (1 / ENOUGH_REPEATS))
    for seed in range(3):
        event = system(rate, np.random.default_rng((2, seed)))
        assert not drive(sampler_of(event, ENOUGH_REPEATS, seed), event).converged
    events = (system(rate, np.random.default_rng((2, seed))) for seed in range(3))
    assert any(drive(sampler_of(event, 5, seed), event).converged for seed, event in enumerate(events))


def noisy(drift, generator):
    """A half-plane with noise, whose boundary moves by ``drift`` with every run."""
    runs = 0

    def respond(z):
        nonlocal runs
        runs += len(z)
        noise = 0.1 * generator.standard_normal(len(z))
        score = LEVEL - drift * (runs - len(z) + np.arange(len(z))) - z[:, 0] + noise
        return score < 0, score

    return SystemProblem(respond, 2)


def test_noise_converges_after_pairs_of_repeats_and_a_drift_never_does():
    for seed in range(3):
        found = estimate(noisy(0.0, np.random.default_rng(seed)), seed)
        assert found.converged
        assert (
            found.diagnostics["repeats"] == found.diagnostics["differed"] == FIRST_REPEATS + 2 * DRIFT_PAIRS
        )
        assert 0.5 < found.probability / ndtr(-LEVEL / np.hypot(1, 0.1)) < 2
        faded = estimate(noisy(0.002, np.random.default_rng(seed)), seed)
        assert faded.diagnostics["drift"]
        assert not faded.converged


@pytest.mark.parametrize("graded", [True, False])
def test_a_steady_system_seems_to_drift_as_rarely_as_stated(graded):
    """Of all outcomes of the pairs, those that count as a drift have at most the probability `DRIFT`."""
    runs, alarm = np.arange(DRIFT_PAIRS), 0.0
    nothing = np.zeros(DRIFT_PAIRS, bool)
    for rises in range(DRIFT_PAIRS + 1):
        up = runs < rises
        known = Repeats.none().extended(RepeatBatch(np.zeros((10, 2)), runs), nothing, nothing, 0.0 * runs)
        happened, score = (nothing, np.where(up, 1.0, -1.0)) if graded else (~up, 0.0 * runs)
        if not graded:
            known = Repeats.none().extended(RepeatBatch(np.zeros((10, 2)), runs), up, up, 0.0 * runs)
        again = known.extended(RepeatBatch(np.zeros((10, 2)), runs), happened, nothing, score)
        assert known.pairs_wanted(1) == DRIFT_PAIRS == again.pairs_wanted(2)
        assert again.pairs_wanted(1) == 0
        assert not known.drift
        alarm += again.drift * binom.pmf(rises, DRIFT_PAIRS, 0.5)
    assert 0.9 * DRIFT < alarm <= DRIFT


def test_a_rebuilt_sampler_without_repeats_makes_the_first_ones_again():
    """The state of another version may lack them, and it must not be forgotten that outcomes are random."""
    sampler = Sampler(2, np.random.default_rng(0), deterministic=None)
    sampler.progress.chance = True
    assert sampler.repeats_wanted(certify=False) == FIRST_REPEATS


def test_a_state_keeps_the_repeats():
    event = system(0.0, np.random.default_rng(0))
    sampler = sampler_of(event, 30)
    while len(sampler.progress.repeats) < 5 or not sampler.repeats_next:
        z = sampler.ask(certify=sampler.is_narrow(STOPPING))
        if not sampler.repeats_next or len(sampler.progress.repeats) < 5:
            sampler.tell(*event.evaluate(z))
    again = resumed(sampler)
    assert again.deterministic is None
    assert again.enough_repeats == 30
    assert saved(again) == saved(sampler)
    assert drive(again, event).row() == drive(sampler, event).row()


def test_repeats_are_of_events_first_then_of_what_came_near_and_of_each_run_in_turn():
    rng = np.random.default_rng(0)
    score = np.array([-2.0, -1.0, 1.0, 2.0, 3.0, np.finfo(float).max])
    z, happened = rng.normal(size=(6, 2)), score < 0
    known, unexpected = Repeats.none(), np.zeros(6, bool)
    choose_repeats = partial(choose, frequent=np.zeros(6, bool))
    first = choose_repeats(z, happened, score, known, 3, unexpected)
    assert first.repeated.tolist() == [1, 2, 3]  # the first ones are of both kinds
    np.testing.assert_array_equal(first.z, z[first.repeated])
    flags, nothing = happened[first.repeated], np.zeros(3, bool)
    steady = known.extended(first, flags, nothing, score[first.repeated])
    assert choose_repeats(z, happened, score, steady, 3, unexpected).repeated.tolist() == [0, 4, 1]
    assert choose_repeats(z, happened, score, steady, 2, happened).repeated.tolist() == [4, 2]
    assert 5 not in choose_repeats(z, happened, score, steady, 30, unexpected).repeated
    noisy = known.extended(first, flags, ~nothing, score[first.repeated])
    assert choose_repeats(z, happened, score, noisy, 2, unexpected).repeated.tolist() == [4, 0]
    assert choose_repeats(z, happened, score, noisy, 3, unexpected, rounds=1).repeated.tolist() == [2, 3, 1]
    once = known.extended(RepeatBatch(z[1:2], np.array([1])), happened[1:2], nothing[:1], score[1:2])
    two = choose(z[:2], happened[:2], score[:2], once, 4, unexpected[:2], np.zeros(2, bool))
    assert two.repeated.tolist() == [0, 1, 0, 1]


def repeats_of(count, z, frequent):
    """Return how often each run at z, shape (n, 2), is repeated; the first an event, the last the easiest."""
    score = np.arange(len(z)) - 0.5
    happened, known, nothing = score < 0, Repeats.none(), np.zeros(5, bool)
    while len(known) < count:
        batch = choose(z, happened, score, known, 5, np.zeros(len(z), bool), frequent)
        known = known.extended(batch, happened[batch.repeated], nothing, score[batch.repeated])
    return np.bincount(known.repeated, minlength=len(z))


def test_a_share_of_the_repeats_is_of_frequent_runs_where_fewest_are_near():
    """Ninety runs next to the event, and ten frequent runs, of which the last one is alone."""
    beside = np.random.default_rng(0).normal(size=(99, 2))
    z, frequent = np.vstack([beside, [[6.0, 0.0]]]), np.arange(100) >= 90
    times = repeats_of(100, z, frequent)
    assert times.sum() == 100
    assert times[frequent].sum() == math.ceil(100 * FREQUENT_SHARE)
    assert times[-1] > 2 * times[frequent].mean()  # in turn, all of them would have the mean
    without = repeats_of(100, z, np.zeros(100, bool))  # the wrong variant
    assert without[frequent].sum() < 50 * FREQUENT_SHARE


def test_lapses_matter_at_runs_that_are_frequent_enough():
    checks, probability, radius = 350, 1e-6, np.linspace(0.1, 6, 60)
    found = where_lapses_matter(np.column_stack([radius, np.zeros(60)]), probability, checks)
    added = (1 - 0.05 ** (1 / checks)) * np.exp(-(radius**2) / 2)  # beyond this distance in two inputs
    np.testing.assert_array_equal(found, added > probability)
    assert 0 < found.sum() < 60
    assert not where_lapses_matter(np.zeros((3, 2)), 0.0, checks).any()  # there is no estimate yet


def test_rounding_is_no_difference():
    flags, score = np.array([True, False, True, False]), np.array([1e-9, 5.0, 0.1, np.inf])
    again = np.array([False, False, True, False]), np.array([1e-9, 5.0 + 1e-6, 0.2, np.inf])
    assert end_differently(flags, score, *again).tolist() == [True, False, True, False]
