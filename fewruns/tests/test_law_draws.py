"""Draws of the law itself: they show events in thin stripes, which repeats of runs cannot show."""

from dataclasses import replace

import numpy as np
import pytest
from fewruns import SystemProblem
from fewruns.constants import CONTRADICTION, ENOUGH_DRAWS, IN_VAIN, REACH
from fewruns.progress import LawDraws
from fewruns.two_phase import Prediction
from fewruns.wide_laws import bound_without_event, draw_wide
from sampler_checks import STOPPING, half_plane, new_sampler, resumed, saved, standard_normal_event
from scipy.special import ndtr
from scipy.stats import binom

LEVEL, STRIPES = 3.5, 0.04


def system(stripes):
    """A half-plane; besides, a share of all points is in thin stripes that are events as well."""

    def respond(z):
        score = LEVEL - z[:, 0]
        return (score < 0) | ((z[:, 1] * 1e4) % 1 < stripes), score

    return SystemProblem(respond, 2, fingerprint="stripes")


def sampler_of(*, draws=ENOUGH_DRAWS, seed=0):
    settings = {"deterministic": None, "enough_repeats": 5, "enough_draws": draws}
    return new_sampler(seed=seed, batch_size=5, **settings)


def step(sampler, event):
    sampler.tell(*event.evaluate(sampler.ask(certify=sampler.is_narrow(STOPPING))))


def drive(sampler, event, most=1000):
    while not sampler.has_ended(is_narrow=sampler.is_narrow(STOPPING)) and sampler.simulations < most:
        step(sampler, event)
    return sampler.estimate(STOPPING)


def test_stripes_that_no_run_has_met_are_found_by_draws_of_the_law():
    truth, event = STRIPES + (1 - STRIPES) * ndtr(-LEVEL), system(STRIPES)
    for seed in range(2):
        found = drive(sampler_of(seed=seed), event)
        assert found.diagnostics["counted"]
        assert found.events == found.diagnostics["law_events"]
        assert 1 / 3 < found.probability / truth < 3
        assert found.high - found.low <= 0.4 * found.probability or not found.converged
    # Wrong: without draws of the law, the interval from runs that met no stripe is far below the truth.
    without = [drive(sampler_of(draws=0, seed=seed), event, 400) for seed in (2, 3)]
    assert max(found.high for found in without) < truth / 10


def test_a_system_without_stripes_costs_the_draws_alone():
    event = system(0)
    plain, found = (drive(sampler_of(draws=draws), event) for draws in (0, ENOUGH_DRAWS))
    assert plain.converged
    assert found.converged
    assert found.simulations == plain.simulations + ENOUGH_DRAWS == len(found.tables["runs"])
    assert found.probability == plain.probability
    phases = found.tables["runs"]["phase"]
    assert (phases == "law").sum() == found.diagnostics["law_draws"] == ENOUGH_DRAWS
    assert found.tables["runs"]["run"].tolist() == list(range(1, found.simulations + 1))


def test_a_state_keeps_the_draws():
    event = system(0)
    sampler = sampler_of(draws=30)
    while len(sampler.progress.law_draws) < 10:
        step(sampler, event)
    sampler.ask(certify=True)
    again = resumed(sampler)
    assert again.enough_draws == 30
    assert again.draws_next
    assert saved(again) == saved(sampler)
    assert drive(again, event).row() == drive(sampler, event).row()


@pytest.mark.parametrize(("count", "events"), [(60, 0), (60, 2)])
def test_draws_of_a_search_in_vain_count_until_batches_give_an_estimate(count, events):
    """They are runs as well; without them, nothing was known but that there are events and others."""
    sampler, drawn = new_sampler(), np.random.default_rng(3).standard_normal((count, 2))
    progress, happened = sampler.progress, np.arange(count) < events
    progress.z, progress.happened = np.vstack([drawn, [[9.0, 9.0]]]), np.append(happened, True)
    progress.score, progress.sizes = np.zeros(count + 1), np.array([count + 1])
    found = sampler.estimate(STOPPING)
    assert np.isnan(found.probability)
    assert (found.low, found.high) == (0, 1)
    progress.plain = progress.plain.extended(drawn, happened)
    found = resumed(sampler).estimate(STOPPING)
    assert (found.low, found.high) == of_counts(events, count)
    assert found.probability == events / count if events else np.isnan(found.probability)
    assert not found.converged


def test_a_ball_at_the_origin_is_estimated_from_its_first_event():
    """Wide draws do not meet it, so that pools need points around the known event."""
    event = standard_normal_event(lambda z: np.linalg.norm(z, axis=1) - 0.05)
    known = draw_wide(150, 2, generator := np.random.default_rng(5))
    sampler = new_sampler(batch_size=5)
    progress = sampler.progress
    progress.z = np.vstack([known, generator.normal(size=(100, 2)), [[0.015, 0.01]]])
    progress.happened, progress.score = event.evaluate(progress.z)
    progress.sizes, progress.searched, progress.rarest = np.array([251]), 99.0, 0.001
    assert progress.happened.sum() == 1
    found = drive(sampler, event, 500)
    assert found.low / 1.5 < -np.expm1(-(0.05**2) / 2) < found.high * 1.5


def test_flags_that_show_no_event_are_bounded_by_draws_of_the_law():
    """Wide draws alone, which say little about a ball at the origin, bound it by 9 % after 1,000 runs."""
    sampler = new_sampler(batch_size=5)
    for _ in range(200):
        sampler.tell(np.zeros(len(sampler.ask()), bool))
    drawn = len(sampler.progress.plain)
    assert drawn == pytest.approx((1000 - IN_VAIN * REACH) / 3, abs=5)
    found = sampler.estimate(STOPPING)
    assert (found.probability, found.low) == (0, 0)
    assert found.high == pytest.approx(1 - 0.2 ** (1 / drawn))
    assert found.high < 0.01 < bound_without_event(1000 - drawn, 0.2)


@pytest.mark.parametrize(("vain", "is_drawn"), [(1, False), (3, False), (4, True)])
def test_the_law_is_drawn_if_no_recent_batch_gave_an_estimate_and_not_after_one_bad_batch(
    monkeypatch, vain, is_drawn
):
    event, sampler = half_plane(), new_sampler(batch_size=5)
    while not sampler.is_narrow(STOPPING):
        step(sampler, event)
    monkeypatch.setattr("fewruns.checks.ENOUGH_UNLEARNT", 20)
    monkeypatch.setattr("fewruns.checks.ENOUGH_BATCHES", 4)
    estimates = sampler.progress.estimates
    for i in range(-vain, 0):
        estimates[i] = replace(estimates[i], prediction=Prediction(0.0, np.inf))
    sampler.ask()
    assert sampler.draws_next == is_drawn


def coverage(interval, probability, draws=900):
    """Return how often intervals of counts contain the probability if an event is met, without simulation."""
    events = np.arange(1, draws + 1)
    mass = binom.pmf(events, draws, probability)
    ends = [interval(k, draws) for k in events[mass > 1e-9]]
    covered = [low <= probability <= high for low, high in ends]
    return float(mass[mass > 1e-9] @ covered / mass.sum())


def of_counts(events, draws):
    return LawDraws(np.zeros((draws, 1)), np.arange(draws) < events).interval(0.2)


def test_the_ends_are_those_of_clopper_and_pearson():
    low, high = of_counts(2, 50)
    assert binom.sf(1, 50, low) == pytest.approx(0.1)
    assert binom.cdf(2, 50, high) == pytest.approx(0.1)
    assert of_counts(0, 50)[0] == 0
    assert of_counts(5, 5)[1] == 1
    assert of_counts(0, 0) == (0, 1)


def of_normal(events, draws):
    share = events / draws
    reach = 1.2816 * np.sqrt(share * (1 - share) / draws)
    return share - reach, share + reach


def test_the_interval_of_counted_events_covers_although_they_count_only_if_one_is_met():
    for probability in (0.003, 0.0118, 0.02, 0.3):
        assert coverage(of_counts, probability) >= 0.8
    assert coverage(of_normal, 0.003) < 0.75


@pytest.mark.parametrize("probability", [0.08, 0.3])
def test_the_interval_covers_if_the_draws_end_when_it_is_narrow(probability):
    """The number of events moves from batch to batch as a Markov chain, which is followed exactly."""
    mass, covered, steps = np.ones(1), 0.0, binom.pmf(np.arange(6), 5, probability)
    for draws in range(5, 1001, 5):
        mass = np.convolve(mass, steps)
        for events in np.flatnonzero(mass > 1e-7):
            low, high = of_counts(events, draws)
            if draws == 1000 or (events and (high - low) / 2 <= 0.2 * events / draws):
                covered += mass[events] * (low <= probability <= high)
                mass[events] = 0.0
    assert covered > 0.78


@pytest.mark.parametrize(("count", "events"), [(300, 0), (300, 1), (300, 4), (80, 1)])
def test_draws_contradict_an_estimate_that_makes_their_events_improbable(count, events):
    draws = LawDraws(np.zeros((count, 2)), np.arange(count) < events)
    for probability in (0.0, 1e-6, 1e-3, 0.01, 0.6):
        chance = binom.sf(events - 1, count, min(2 * probability, 1.0))
        assert draws.contradict(probability) == (events > 0 and chance < CONTRADICTION)
