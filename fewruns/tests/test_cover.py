"""The default certificate: no simple part of the event and no minimum of the scores is without a run."""

import dataclasses
import math

import numpy as np
import pytest
from fewruns import Cover, InputError, Sampler, SystemProblem, estimate, parts, results
from fewruns.certificate import BY_DEFAULT
from fewruns.combining import combine, counted_batches, estimate_batch
from fewruns.constants import (
    BASIN_CLOSED,
    CENTRE_NEAR,
    CORE,
    COVER_MISSED,
    FINE_NOISE,
    GRADED_RUNS,
    MODES,
    NOISE,
    REACHED,
)
from fewruns.graded import GradedSurrogate, graded
from fewruns.parts import open_basins, open_minima, probe
from fewruns.running import estimate_problem
from fewruns.two_phase import reach_of
from fewruns.wide_laws import draw_wide, rarity
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
        z = np.vstack([z, cover.next_runs(5, z, 1e-3, generator)])
    bound, trials = norm.isf(cover.unseen(z)), 40_000
    error = 4 * math.sqrt(COVER_MISSED / trials) + 4 * math.sqrt(COVER_MISSED / MODES)
    assert 0 < bound < 11
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
        z, added = np.vstack([z, cover.next_runs(5, z, probability, generator)]), added + 5
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
    first = [not batch.runs for batch in progress.estimates].index(True)
    known = [batch for batch in counted_batches(progress.estimates[:first]) if batch.runs]
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
    assert any(of_cover)
    assert not of_cover[-1]  # one batch is sampled afterwards
    assert (
        course.result.diagnostics["unseen_mode"] <= course.sampler.required.share * course.result.probability
    )
    cover_runs = sum(10 - batch.runs for batch in progress.estimates)
    assert (course.result.tables["runs"]["phase"] == "cover").sum() == cover_runs
    place = of_cover.index(True)
    batch = progress.batches[place]
    assert (batch.weight == 0).all()
    # An event where none was foreseen restarts the estimate.
    unforeseen = dataclasses.replace(batch, aimed=np.zeros(10, bool))
    assert estimate_batch(unforeseen, np.arange(10) == 3).surprising
    assert not estimate_batch(
        dataclasses.replace(batch, aimed=np.ones(10, bool)), np.ones(10, bool)
    ).surprising
    # The same holds if only a part of the batch is sampled, which alone counts as the runs of the estimate.
    sampled = next(each for each in progress.batches if each.weight.all())
    few, none = np.arange(10) < 7, np.arange(10) == 8
    mixed = dataclasses.replace(sampled, weight=sampled.weight * few, aimed=few)
    assert [estimate_batch(mixed, flags).runs for flags in (few, none)] == [7, 7]
    assert [estimate_batch(mixed, flags).surprising for flags in (few, none)] == [False, True]
    again = resumed(course.sampler)
    assert numbers(again.estimate(STOPPING)) == numbers(course.result)
    assert again.required == course.sampler.required
    sampled = [each for each in progress.estimates if each.runs]
    assert combine(sampled[-3:]).batches == 3


def test_a_basin_of_the_scores_is_open_until_there_are_runs_near_its_minimum():
    generator = np.random.default_rng(2)

    def margin(z):
        return np.minimum(4.0 - z[:, 0], np.linalg.norm(z - [-3.0, 2.0], axis=1) - 0.3)

    # No run is in the disc, but the one next to it has the smallest score around.
    z = draw_wide(60, 2, generator)
    z = z[np.linalg.norm(z - [-3.0, 2.0], axis=1) > 1.0]
    z = np.vstack([z, [[-3.0, 3.1], [5.0, 0.0]]])
    happened, score, reach = margin(z) <= 0, margin(z), reach_of(ONE_PART)
    found = open_basins(z, happened, score, reach)
    assert len(z) - 2 in found
    points = probe(5, np.array([len(z) - 2]), z, happened, score, reach, generator)
    assert margin(points).min() < score[-2]
    close = np.vstack([z, z[-2] + [0.0, 0.9 * BASIN_CLOSED]])
    assert len(z) - 2 not in open_basins(close, margin(close) <= 0, margin(close), reach)
    assert not len(open_basins(z, happened, np.zeros(len(z)), reach))  # flags alone have no minima


def test_a_minimum_next_to_a_known_event_is_no_basin():
    around = 0.7 * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    score = np.array([2.0, 2.0, 2.0, 2.0, 1.0, -1.0])
    for event, expected in ((0.65, []), (0.75, [4])):  # at distances of 0.92 and 1.06
        z = np.vstack([around, [0.0, 0.0], [event, event]])
        assert list(open_basins(z, score <= 0, score, 60.0)) == expected


def followed_basins(seed, dimension, radius):
    """Whether the basins of the scores are followed into a ball that no run has met."""
    generator, centre = np.random.default_rng(seed), -4.7 * np.eye(dimension)[0]

    def margin(z):
        return np.minimum(4.2 - z[:, 0], np.linalg.norm(z - centre, axis=1) - radius)

    z = np.vstack([draw_wide(60, dimension, generator, reach_of(1e-5)), 5 * np.eye(dimension)[:1]])
    z, first = z[np.linalg.norm(z - centre, axis=1) > radius + 0.1], len(z)
    while len(basins := open_basins(*(known := (z, margin(z) <= 0, margin(z), reach_of(1e-5))))):
        z = np.vstack([z, probe(5, basins, *known, generator)])
        assert len(z) < first + 100
    return (np.linalg.norm(z - centre, axis=1) <= radius).any()


@pytest.mark.parametrize(("dimension", "radius"), [(2, 0.5), (3, 0.5), (3, 1.0)])
def test_basins_are_followed_into_balls_that_are_too_small_for_the_cover(dimension, radius):
    """Most balls were missed when the points of a batch were at the same place, and closed their basin."""
    assert 1 / radius > Cover.by_default(dimension).curvature
    assert sum(followed_basins(seed, dimension, radius) for seed in range(8)) >= 7


CENTRES = np.array([[4.2, 0.0], [4.4, -1.0], [4.3, 1.0]])


def test_a_minimum_of_the_scores_is_open_until_there_are_runs_near_it():
    bottom = np.array([-3.0, 2.0])

    def margin(z):  # without an event at the bottom
        return np.minimum(4.0 - z[:, 0], np.linalg.norm(z - bottom, axis=1) + 0.1)

    generator, reach = np.random.default_rng(2), reach_of(ONE_PART)
    z = np.vstack([draw_wide(60, 2, generator), [4.1, 0.0] + isotropic(generator, 20, 2) * [0.1, 1.0]])
    z = z[np.linalg.norm(z - bottom, axis=1) > 1.0]

    def found(z, centres, score=margin):
        return open_minima(5, z, margin(z) <= 0, score(z), centres, reach)

    first = points = found(z, CENTRES)
    assert points.shape == (5, 2)
    assert np.linalg.norm(points - bottom, axis=1).min() < 1.0
    assert cKDTree(points).query(points, 2)[0][:, 1].min() > 0.01
    closed, added = np.vstack([z, points]), 5
    while len(points := found(closed, CENTRES)):
        closed, added = np.vstack([closed, points]), added + 5
    assert added <= 80
    assert np.linalg.norm(closed - bottom, axis=1).min() < 0.4
    # A minimum next to the centres of the pool is known, and flags alone have no minima.
    again = found(z, np.vstack([CENTRES, first]))
    assert not len(again) or cKDTree(first).query(again)[0].min() > CENTRE_NEAR
    assert not len(found(z, CENTRES, score=lambda z: np.zeros(len(z))))


def around_plane(generator, dimension):
    """Return runs about the boundary of a half-space at the distance 4.2."""
    return np.column_stack(
        [4.1 + generator.exponential(0.25, 50), generator.normal(size=(50, dimension - 1))]
    )


@pytest.mark.parametrize("dimension", [2, 4, 8])
def test_a_half_space_alone_has_hardly_any_open_minima(dimension):
    generator = np.random.default_rng(1)
    near = around_plane(generator, dimension)
    z, spent = np.vstack([draw_wide(60, dimension, generator, 14.0), near]), 0
    while len(points := open_minima(5, z, z[:, 0] >= 4.2, 4.2 - z[:, 0], 4.4 * np.eye(dimension)[:1], 14.0)):
        z, spent = np.vstack([z, points]), spent + 5
    assert spent <= 40


def followed(seed, dimension, radius):
    """Whether the minima of the scores are followed into a ball that no run has met."""
    generator, centre = np.random.default_rng(seed), -4.7 * np.eye(dimension)[0]

    def margin(z):
        return np.minimum(4.2 - z[:, 0], np.linalg.norm(z - centre, axis=1) - radius)

    z = np.vstack([draw_wide(60, dimension, generator, reach_of(1e-5)), around_plane(generator, dimension)])
    first, pool = len(z), 4.4 * np.eye(dimension)[:1]
    z = z[np.linalg.norm(z - centre, axis=1) > radius + 0.1]
    while len(points := open_minima(5, z, margin(z) <= 0, margin(z), pool, reach_of(1e-5))):
        z = np.vstack([z, points])
        if len(z) > first + 100 or (np.linalg.norm(points - centre, axis=1) <= radius).any():
            break
    return (np.linalg.norm(z - centre, axis=1) <= radius).any()


@pytest.mark.parametrize(("dimension", "radius"), [(2, 0.5), (3, 1.0), (6, 1.5)])
def test_minima_are_followed_into_balls_that_are_too_small_for_the_cover(dimension, radius):
    assert 1 / radius > Cover.by_default(dimension).curvature
    assert sum(followed(seed, dimension, radius) for seed in range(8)) >= 7


def test_with_many_inputs_runs_are_made_where_there_are_none(monkeypatch):
    """The mean of the regression has no minimum where it is far from all runs, but much uncertainty."""

    def score(z):
        return 4.2 - z[:, 0] + 0.3 * np.sin(z[:, 1:]).sum(axis=1)

    def runs_in_the_gap(seed):
        generator = np.random.default_rng(seed)
        wide = draw_wide(60, 4, generator, 14.0)
        z = np.vstack([wide[wide[:, 0] > 1.0], around_plane(generator, 4)])
        first, pool = len(z), 4.4 * np.eye(4)[:1]
        while len(points := open_minima(5, z, score(z) <= 0, score(z), pool, 14.0)):
            z = np.vstack([z, points])
            if len(z) >= first + 100:
                break
        return np.count_nonzero(z[first:, 0] < 1.0)

    strict = sum(map(runs_in_the_gap, range(2)))
    monkeypatch.setattr(parts, "DOUBT", 0.0)
    assert strict > 1.5 * sum(map(runs_in_the_gap, range(2)))


def test_an_event_is_only_doubted_where_a_part_that_matters_begins(monkeypatch):
    generator, ends, descend = np.random.default_rng(1), [], parts._descend

    def recorded(*given):
        ends.append(descend(*given))
        return ends[-1]

    monkeypatch.setattr(parts, "_descend", recorded)
    z = np.vstack([draw_wide(60, 4, generator, 14.0), around_plane(generator, 4)])
    known = 4.4 * np.eye(4)[:1], 14.0, 6.0
    while len(points := open_minima(5, z, z[:, 0] >= 4.2, 4.2 - z[:, 0], *known)):
        z = np.vstack([z, points])
    assert [rarity(points).max() for points, _ in ends[-2:]] == pytest.approx([14.0, 6.0])


def test_a_regression_with_little_noise_follows_small_differences():
    """Smaller scores near a second part were taken for noise about a function without this part."""
    generator = np.random.default_rng(1)
    z = draw_wide(100, 4, generator, 14.0)
    score = np.minimum(4.2 - z[:, 0], np.linalg.norm(z + 4.0 * np.eye(4)[0], axis=1) - 1.5)
    outcome, errors = graded(score <= 0, score), []
    for noise in (NOISE, FINE_NOISE):
        regression = GradedSurrogate(4, noise)
        regression.fit(z, outcome, learn=True)
        errors.append(np.std(regression.expect(z)[0] - outcome))
    assert errors[1] < errors[0] / 2


def test_runs_far_from_all_others_are_kept_in_the_regression():
    """Of thousands of runs near the boundary, few are needed, and runs at minima are the only ones there."""
    generator, few = np.random.default_rng(1), 20
    near = np.array([4.2, 0, 0, 0]) + 0.3 * generator.normal(size=(3000, 4))
    alone = 4.0 * isotropic(generator, few, 4) - np.array([3.0, 0, 0, 0])
    place = np.sort(generator.integers(len(near), size=few)) + np.arange(few)
    z = np.empty((len(near) + few, 4))
    z[place], z[np.setdiff1d(np.arange(len(z)), place)] = alone, near
    kept = parts._spread(z, z[:, 0] >= 4.2)
    assert len(np.unique(kept)) == len(kept) == GRADED_RUNS
    assert np.isin(place, kept).all()
    assert np.count_nonzero(z[kept, 0] >= 4.2) == GRADED_RUNS // 4
    same = parts._spread(np.zeros((500, 2)), np.arange(500) < 10)  # all at the same place
    assert len(np.unique(same)) == GRADED_RUNS
    assert (parts._spread(z[:100], z[:100, 0] >= 4.2) == np.arange(100)).all()


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
    monkeypatch.setattr(results, "runs_of_cover", lambda *_: (next(covers), False))
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
    assert len(counted_batches(progress.estimates)) < len(progress.estimates) - estimates
    exact = norm.sf(4.5) + ncx2.cdf(0.9**2, 2, 4.6**2)
    predicted = [each.prediction.probability / exact for each in progress.estimates]
    assert predicted[estimates - 1] < 0.15
    assert predicted[-1] > 0.5


@pytest.mark.parametrize("wrong", [(0.0, 1.0), (1.0, 0.0), (1.0, np.inf)])
def test_covers_that_mean_nothing_are_refused(wrong):
    with pytest.raises(InputError, match="expected share above 0"):
        Cover(*wrong)
