"""The default certificate: no simple part of the event is without a run."""

import dataclasses
import math

import numpy as np
import pytest
from fewruns import Cover, InputError, Sampler, Stopping, SystemProblem, estimate
from fewruns.certificate import BY_DEFAULT
from fewruns.combining import combine, consistent_batches, estimate_batch
from fewruns.constants import CORE, COVER_MISSED, FARTHEST, MODES, REACHED
from fewruns.exclusion import Exclusion
from fewruns.running import estimate_problem
from fewruns.wide_laws import draw_wide
from sampler_checks import STOPPING, drive, new_sampler, numbers, resumed, standard_normal_event
from scipy.spatial import cKDTree
from scipy.stats import ncx2, norm

ONE_PART = norm.sf(4.2)


def contains_run(z, direction, distance, curvature):
    """Whether a run is in the mode: in the ball behind its tangent plane, in each of t directions."""
    centres = direction * (distance + 1 / curvature)[:, None]
    return cKDTree(z).query(centres)[0] <= 1 / curvature


def isotropic(generator, n, dimension):
    u = generator.normal(size=(n, dimension))
    return u / np.linalg.norm(u, axis=1, keepdims=True)


@pytest.mark.parametrize(("dimension", "curvature"), [(1, 0.5), (2, 1.0), (3, 0.4), (6, 0.1)])
def test_the_unseen_mode_is_the_nearest_without_a_run(dimension, curvature):
    """Up to the bound, the stated share of the modes lacks a run; a little farther out, more of them do."""
    generator = np.random.default_rng(dimension)
    z, cover = draw_wide(40, dimension, generator), Cover(0.5, curvature)
    while cover.unseen(z) > 1e-3:
        z = np.vstack([z, cover.next_runs(5, z, 1e-3, cover.unseen(z), generator)])
    bound, trials = norm.isf(cover.unseen(z)), 40_000
    assert 0 < bound < FARTHEST
    nearer = MODES * (bound / FARTHEST) ** 2  # as many of the modes of `Cover.unseen` decide
    error = 4 * math.sqrt(COVER_MISSED / trials) + 4 * math.sqrt(COVER_MISSED / nearer)
    for farthest, within in ((bound, True), (1.15 * bound, False)):
        distance = farthest * np.sqrt(generator.random(trials))
        missed = 1 - contains_run(z, isotropic(generator, trials, dimension), distance, curvature).mean()
        assert (missed < COVER_MISSED + error) == within


@pytest.mark.parametrize("dimension", [2, 4, 8])
def test_next_runs_exclude_all_modes_with_few_runs(dimension):
    """They also exclude modes that were not drawn for them; as many draws of the wide law do not."""
    generator, probability = np.random.default_rng(1), 1e-5
    cover, z = Cover.by_default(dimension), draw_wide(20, dimension, generator)
    added = 0
    while cover.unseen(z) > probability:
        further = cover.next_runs(5, z, probability, cover.unseen(z), generator)
        z, added = np.vstack([z, further]), added + 5
        assert added <= 80
    wide = draw_wide(len(z), dimension, generator)
    u = isotropic(generator, 20_000, dimension)
    distance = norm.isf(probability) * np.sqrt(generator.random(len(u)))
    covered, drawn = (contains_run(runs, u, distance, cover.curvature).mean() for runs in (z, wide))
    assert drawn < 1 - 2 * COVER_MISSED < covered


def with_hidden_disc(z):
    """A half-plane at 4.5 and a disc opposite that is twelve times as probable."""
    return np.minimum(4.5 - z[:, 0], np.hypot(z[:, 0] + 4.6, z[:, 1]) - 0.9)


def test_a_hidden_part_is_found_unless_the_event_is_stated_to_have_none():
    """With flags alone, some of the seeds that trust the statement miss the disc, and say nothing."""

    def flags(z):
        return with_hidden_disc(z) <= 0

    exact = norm.sf(4.5) + ncx2.cdf(0.9**2, 2, 4.6**2)
    ratios = {}
    for stated in (False, True):
        found = [
            estimate(flags, 2, np.random.default_rng(seed), deterministic=True, upper_set=stated)
            for seed in (4, 9)
        ]
        assert all(each.converged for each in found)
        ratios[stated] = np.array([each.probability / exact for each in found])
    assert (ratios[False] > 0.6).all()
    assert (ratios[True] < 0.5).any()


def test_defaults_follow_the_statement():
    sampler, stated = (Sampler(3, np.random.default_rng(0), upper_set=stated) for stated in (False, True))
    assert stated.required == BY_DEFAULT
    assert sampler.required == Cover.by_default(3, with_scores=False)
    happened = np.zeros(len(sampler.ask()), bool)
    sampler.tell(happened)  # flags alone need the stricter cover
    assert sampler.required == Cover.by_default(3, with_scores=False)
    sampler.tell(happened, sampler.ask()[:, 0])
    assert sampler.required == Cover.by_default(3) == resumed(sampler).required
    assert sampler.required.curvature < Cover.by_default(3, with_scores=False).curvature


def when_the_cover_began(course, stopping=STOPPING):
    """Return whether the first run of a cover came before the interval was narrow."""
    progress = course.sampler.progress
    first = [(batch.weight == 0).any() for batch in progress.batches].index(True)
    known = [batch for batch in consistent_batches(progress.estimates[:first]) if batch.runs]
    low, high = combine(known).interval(stopping.alpha)
    return (high - low) / 2 > stopping.beta * combine(known).probability


def test_with_two_inputs_the_cover_begins_with_the_estimate_and_the_search_is_short():
    courses = {}
    for dimension in (2, 3):
        event = standard_normal_event(lambda z: 4.0 - z[:, 0], dimension=dimension)
        courses[dimension] = drive(new_sampler(dimension, 1), event)
    assert when_the_cover_began(courses[2])
    assert not when_the_cover_began(courses[3])
    searched = [(course.result.tables["runs"]["phase"] == "search").sum() for course in courses.values()]
    assert searched[0] < 0.7 * searched[1]
    # If draws are to exclude other parts, or there are none, the search has to find everything.
    event = standard_normal_event(lambda z: 4.0 - z[:, 0])
    stated = drive(new_sampler(2, 1, upper_set=True), event)
    assert (stated.result.tables["runs"]["phase"] == "search").sum() > 0.7 * searched[1]


@pytest.mark.parametrize(("settings", "may_be_lower"), [({}, False), ({"upper_set": True}, True)])
def test_a_low_estimate_goes_on_if_the_surrogate_has_learnt_of_another_part(settings, may_be_lower):
    course = drive(new_sampler(2, 1, **settings), standard_normal_event(lambda z: 4.0 - z[:, 0]))
    estimates, probability = course.sampler.progress.estimates, course.result.probability
    last = estimates[-1]

    def converges(predicted):
        prediction = dataclasses.replace(last.prediction, probability=predicted)
        estimates[-1] = dataclasses.replace(last, prediction=prediction)
        return course.sampler.has_converged(STOPPING)

    assert converges(0.99 * REACHED * probability)
    assert converges(1.01 * REACHED * probability) == may_be_lower


def test_runs_of_a_cover_have_no_weight_in_the_estimate_and_are_resumed():
    event = standard_normal_event(lambda z: 4.0 - z[:, 0])
    course = drive(new_sampler(2, 1), event)
    progress = course.sampler.progress
    of_cover = [not batch.runs for batch in progress.estimates]
    assert not of_cover[-1]  # one batch is sampled after one that was not
    assert (
        course.result.diagnostics["unseen_mode"] <= course.sampler.required.share * course.result.probability
    )
    pairs = zip(progress.batches, progress.estimates, strict=True)
    cover_runs = sum(len(batch.z) - estimate.runs for batch, estimate in pairs)
    assert (course.result.tables["runs"]["phase"] == "cover").sum() == cover_runs
    sampled = next(each for each in progress.batches if each.weight.all() and len(each.z) == 10)
    batch = dataclasses.replace(sampled, weight=np.zeros(10), inclusion=np.ones(10))
    # An event where none was foreseen restarts the estimate.
    unforeseen = dataclasses.replace(batch, aimed=np.zeros(10, bool))
    assert estimate_batch(unforeseen, np.arange(10) == 3).surprising
    assert not estimate_batch(
        dataclasses.replace(batch, aimed=np.ones(10, bool)), np.ones(10, bool)
    ).surprising
    # The same holds if only a part of the batch is sampled, which alone counts as the runs of the estimate.
    few, none = np.arange(10) < 7, np.arange(10) == 8
    mixed = dataclasses.replace(sampled, weight=sampled.weight * few, aimed=few)
    assert [estimate_batch(mixed, flags).runs for flags in (few, none)] == [7, 7]
    assert [estimate_batch(mixed, flags).surprising for flags in (few, none)] == [False, True]
    again = resumed(course.sampler)
    assert numbers(again.estimate(STOPPING)) == numbers(course.result)
    assert again.required == course.sampler.required
    sampled = [each for each in progress.estimates if each.runs]
    assert combine(sampled[-3:]).batches == 3


def test_flags_alone_converge_in_many_inputs_only_if_a_certificate_is_stated():
    event = standard_normal_event(lambda z: 3.5 - z[:, 0], graded=False, dimension=4)
    repeated = SystemProblem(lambda z: (z[:, 0] > 3.5, 1.0 - (z[:, 0] > 3.5)), 4, deterministic=True)
    for silent in (event, repeated):  # scores that only repeat the flags say nothing more
        found = estimate_problem(silent, np.random.default_rng(1), STOPPING)
        assert found.covers(norm.sf(3.5))
        assert not found.converged
        assert found.simulations < STOPPING.maximum_simulations
    stated = Cover.by_default(4, with_scores=False)
    assert estimate_problem(event, np.random.default_rng(1), STOPPING, certificate=stated).converged
    scored = standard_normal_event(lambda z: 3.5 - z[:, 0], dimension=4)
    assert estimate_problem(scored, np.random.default_rng(1), STOPPING).converged


@pytest.mark.parametrize("poor", [lambda margin: np.minimum(margin, 0.5), np.negative])
def test_poor_scores_end_with_the_cover_of_flags(poor, monkeypatch):
    """Scores that saturate never close the clearances, and those of the wrong sign lead away."""

    def found():
        event = SystemProblem(lambda z: (z[:, 0] > 4.2, poor(4.2 - z[:, 0])), 2, deterministic=True)
        return estimate_problem(event, np.random.default_rng(1), Stopping(maximum_simulations=260))

    right, radius = found(), 1 / Cover.by_default(2, with_scores=False).curvature
    assert right.converged
    assert right.covers(ONE_PART)
    assert right.excluded.endswith(f"a radius of at least {radius:.2g} normal scores")
    monkeypatch.setattr(Exclusion, "has_scores", True)  # the wrong variant follows them for ever
    wrong = found()
    assert not wrong.converged
    assert wrong.excluded.startswith("nothing")


@pytest.mark.parametrize("dimension", [8, 20])
def test_scores_converge_in_many_inputs_only_if_a_certificate_is_stated(dimension):
    event = standard_normal_event(lambda z: 3.5 - z[:, 0], dimension=dimension)
    silent = estimate_problem(event, np.random.default_rng(1), STOPPING)
    assert silent.covers(norm.sf(3.5))
    assert not silent.converged
    stated = Cover.by_default(dimension)
    found = estimate_problem(event, np.random.default_rng(1), STOPPING, certificate=stated)
    assert found.converged
    assert numbers(found)[:4] == numbers(silent)[:4]


def test_a_part_that_only_the_cover_has_found_restarts_the_estimate(monkeypatch):
    """The surrogate expects it only after the last runs, and the batches of the estimate did not know it."""
    disc = np.array([-4.6, 0.0])

    def margin(z):
        return np.minimum(4.5 - z[:, 0], np.linalg.norm(z - disc, axis=1) - 0.9)

    sampler = new_sampler(2, 1, certificate=BY_DEFAULT)
    progress = drive(sampler, standard_normal_event(lambda z: 4.5 - z[:, 0])).sampler.progress
    assert (margin(progress.z) <= 0).sum() == progress.happened.sum()  # no run is in the disc
    event = standard_normal_event(margin)
    sampler.certificate, estimates = Cover.by_default(2), len(progress.estimates)
    direction = isotropic(np.random.default_rng(1), 20, 2)
    approach, inside = disc + direction[:10] * np.linspace(1.5, 0.0, 10)[:, None], disc + 0.4 * direction[10:]
    covers = iter([approach, inside])
    monkeypatch.setattr(Exclusion, "runs", lambda *_: next(covers))
    for points in (approach, inside):
        assert (sampler.ask(certify=True) == points).all()
        assert not progress.pending.aimed.any()
        if points is inside:  # the wrong variant: the surrogate has learnt from the approach
            assert (sampler.belief.probability(inside) >= CORE).all()
            assert (progress.cover_runs == np.arange(len(progress.z) - 10, len(progress.z))).all()
        sampler.tell(*event.evaluate(points))
    assert progress.estimates[-1].surprising
    # The next pool has kernels around the events.
    assert cKDTree(progress.centres).query(inside)[0].max() == 0
    monkeypatch.undo()
    for _ in range(3):
        sampler.tell(*event.evaluate(sampler.ask()))
    assert progress.cover_runs.size == 0
    assert len(consistent_batches(progress.estimates)) < len(progress.estimates) - estimates
    exact = norm.sf(4.5) + ncx2.cdf(0.9**2, 2, 4.6**2)
    predicted = [each.prediction.probability / exact for each in progress.estimates]
    assert predicted[estimates - 1] < 0.15
    assert predicted[-1] > 0.5


@pytest.mark.parametrize("wrong", [(0.0, 1.0), (1.0, 0.0), (1.0, np.inf)])
def test_covers_that_mean_nothing_are_refused(wrong):
    with pytest.raises(InputError, match="expected share above 0"):
        Cover(*wrong)
