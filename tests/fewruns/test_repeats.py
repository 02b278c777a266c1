"""Whether a system repeats itself: what repeats show, and that no estimate converges without knowing it."""

from dataclasses import replace

import numpy as np
from fewruns import SystemProblem
from fewruns.constants import FIRST_REPEATS
from fewruns.repeats import Repeats, choose_repeats, end_differently
from sampler_checks import STOPPING, estimate, new_sampler, resumed, saved

LEVEL = 3.5


def system(rate, generator, *, deterministic=None):
    """A half-plane; in a share of the runs everything beyond another level is an event as well."""

    def respond(z):
        score = LEVEL - z[:, 0]
        score = np.where(generator.random(len(z)) < rate, score - 1.5, score)
        return score < 0, score

    return SystemProblem(respond, 2, fingerprint="lapses", deterministic=deterministic)


def sampler_of(event, enough):
    settings = {"deterministic": event.deterministic, "enough_repeats": enough, "upper_set": True}
    return new_sampler(batch_size=5, **settings)


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
    assert found.tables["runs"]["phase"].eq("repeat").sum() == 40


def test_lapses_that_repeats_notice_end_all_claims():
    """With lapses in a tenth of the runs no estimate claims to be exact as that of the first runs would."""
    event = system(0.1, np.random.default_rng(1))
    found = drive(sampler := sampler_of(event, 200), event)
    assert sampler.progress.chance
    assert found.diagnostics["differed"] > 0
    believed = system(0.1, np.random.default_rng(1), deterministic=True)
    assert drive(sampler_of(believed, 200), believed).converged  # the wrong variant is silent


def test_noise_is_noticed_by_the_first_repeats():
    generator = np.random.default_rng(0)

    def respond(z):
        score = LEVEL - z[:, 0] + 0.3 * generator.standard_normal(len(z))
        return score < 0, score

    few = replace(STOPPING, maximum_simulations=300)
    found = estimate(SystemProblem(respond, 2), 0, few)
    assert found.diagnostics["repeats"] == found.diagnostics["differed"] == FIRST_REPEATS


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


def test_repeats_are_of_events_and_of_what_came_near_and_of_each_run_in_turn():
    rng = np.random.default_rng(0)
    score = np.array([-2.0, -1.0, 1.0, 2.0, 3.0, np.finfo(float).max])
    z, happened = rng.normal(size=(6, 2)), score < 0
    known = Repeats.none()
    first = choose_repeats(z, happened, score, known, 2, rng)
    assert sorted(first.repeated) == [1, 2]
    np.testing.assert_array_equal(first.z, z[first.repeated])
    flags = happened[first.repeated]
    second = choose_repeats(z, happened, score, known.extended(first, flags, flags), 2, rng)
    assert sorted(second.repeated) == [0, 3]
    assert 5 not in choose_repeats(z, happened, score, known, 30, rng).repeated
    assert sorted(choose_repeats(z[:2], happened[:2], score[:2], known, 4, rng).repeated) == [0, 0, 1, 1]


def test_rounding_is_no_difference():
    flags, score = np.array([True, False, True, False]), np.array([1e-9, 5.0, 0.1, np.inf])
    again = np.array([False, False, True, False]), np.array([1e-9, 5.0 + 1e-6, 0.2, np.inf])
    assert end_differently(flags, score, *again).tolist() == [True, False, True, False]
