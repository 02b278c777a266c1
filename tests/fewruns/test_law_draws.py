"""Draws of the law itself: they show events in thin stripes, which repeats of runs cannot show."""

import numpy as np
import pytest
from fewruns import SystemProblem
from fewruns.constants import CONTRADICTION, ENOUGH_DRAWS
from fewruns.law_draws import LawDraws
from sampler_checks import STOPPING, new_sampler, resumed, saved
from scipy.special import ndtr
from scipy.stats import binom

LEVEL, STRIPES = 3.5, 0.02


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
    truth, event, silent = STRIPES + (1 - STRIPES) * ndtr(-LEVEL), system(STRIPES), 0
    for seed in range(2):
        found = drive(sampler_of(seed=seed), event)
        assert not found.converged
        assert found.high >= truth or found.simulations >= 1000
        without = drive(sampler_of(draws=0, seed=seed), event, 400)
        silent += without.converged and without.high < truth / 10
    assert silent  # the wrong variant


def test_a_system_without_stripes_costs_the_draws_alone():
    event = system(0)
    plain, found = (drive(sampler_of(draws=draws), event) for draws in (0, ENOUGH_DRAWS))
    assert plain.converged
    assert found.converged
    assert found.simulations == plain.simulations + ENOUGH_DRAWS == len(found.tables["runs"])
    assert found.probability == plain.probability
    phases = found.tables["runs"]["phase"]
    assert phases.eq("law").sum() == found.diagnostics["law_draws"] == ENOUGH_DRAWS
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


@pytest.mark.parametrize(("count", "events"), [(300, 0), (300, 1), (300, 4), (80, 1)])
def test_draws_contradict_an_estimate_that_makes_their_events_improbable(count, events):
    draws = LawDraws(np.zeros((count, 2)), np.arange(count) < events)
    for probability in (0.0, 1e-6, 1e-3, 0.01, 0.6):
        chance = binom.sf(events - 1, count, min(2 * probability, 1.0))
        assert draws.contradict(probability) == (events > 0 and chance < CONTRADICTION)
