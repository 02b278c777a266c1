"""Many normal scores: their few coordinates, the directions that are learnt, pools, and the whole sampler."""

import numpy as np
import pytest
from fewruns import Cover, InputError, Predecessor, Sampler, certificate
from fewruns.constants import WHOLE_SHARE
from fewruns.directions import _Model, _Regression, learn_directions
from fewruns.graded import graded
from fewruns.pools import Defence, Subspace, WholeSpace, draw_pool, outward, space_along, square_of_distance
from fewruns.wide_laws import draw_at
from sampler_checks import drive, new_sampler, resumed, saved, standard_normal_event
from scipy.stats import chi2, kstest, norm

DIMENSION = 20
ALIKE = np.full(DIMENSION, DIMENSION**-0.5)
STATED = Cover.by_default(DIMENSION)


def half_space(level=4.5):
    return standard_normal_event(lambda z: level - z @ ALIKE, dimension=DIMENSION)


@pytest.fixture
def space():
    directions = np.random.default_rng(1).normal(size=(DIMENSION, 2))
    return space_along(directions, DIMENSION)


# ---- coordinates


@pytest.mark.parametrize("dimension", [1, 4, 99])
def test_a_distance_and_its_normal_score_are_the_same_probability(dimension):
    score = np.array([-8.0, -1.0, -1e-3, 1e-3, 1.0, 8.0, 20.0])
    square = square_of_distance(score, dimension)
    np.testing.assert_allclose(chi2.logsf(square, dimension), norm.logsf(score), rtol=1e-8)
    np.testing.assert_allclose(outward(square, dimension), score, rtol=1e-8)


def test_points_that_are_drawn_have_the_coordinates_asked_for(space):
    generator = np.random.default_rng(2)
    coordinates = 3 * generator.normal(size=(50, space.dimension))
    z = space.draw(coordinates, generator)
    np.testing.assert_allclose(space.coordinates(z), coordinates, atol=1e-8)


def test_coordinates_of_normal_vectors_are_normal_and_unrelated_to_the_rest(space):
    generator = np.random.default_rng(3)
    z = generator.normal(size=(20_000, DIMENSION))
    coordinates = space.coordinates(z)
    assert min(kstest(column, "norm").pvalue for column in coordinates.T) > 1e-3
    again = space.draw(coordinates, generator)  # other directions across, and the same law
    assert min(kstest(column, "norm").pvalue for column in again.T) > 1e-3
    correlation = np.corrcoef(np.column_stack([coordinates, again @ ALIKE, z @ ALIKE]).T)
    assert np.abs(correlation[:3, :3] - np.eye(3)).max() < 4 / np.sqrt(len(z))


def test_all_coordinates_are_kept_where_there_are_few():
    z = np.random.default_rng(4).normal(size=(5, 3))
    np.testing.assert_array_equal(WholeSpace(3).coordinates(z), z)
    assert space_along(None, 3) == WholeSpace(3)


def test_directions_that_hardly_matter_are_left_out():
    directions = np.zeros((DIMENSION, 2))
    directions[0], directions[1] = [1.0, 0.0], [0.0, 1e-4]
    assert space_along(directions, DIMENSION).dimension == 2  # one direction, and the distance across it


# ---- pools


def pool_and_error(space, inside, exact, seed=5):
    centres = np.random.default_rng(seed).normal(size=(200, DIMENSION))
    rng = np.random.default_rng(seed + 1)
    pool = draw_pool(space, centres, 40_000, lambda z: np.full(len(z), 0.5), rng)
    terms = pool.weight * inside(pool.z)
    return pool, (terms.mean() - exact) / (terms.std() / np.sqrt(len(terms)))


@pytest.mark.parametrize("along", [True, False])
def test_the_weights_of_a_pool_give_probabilities_along_and_across(space, along):
    direction = space.axes[:, 0] if along else np.linalg.svd(space.axes)[0][:, -1]

    def inside(z):
        return z @ direction > 1.0

    pool, error = pool_and_error(space, inside, norm.sf(1.0))
    assert abs(error) < 4
    wrong = pool.weight * inside(pool.z) / (1 - WHOLE_SHARE)  # as if the wide law had no part in it
    assert abs(wrong.mean() - norm.sf(1.0)) / (wrong.std() / np.sqrt(len(wrong))) > 4


def test_the_guard_reaches_along_the_coordinates_and_across_them(space):
    pool, _ = pool_and_error(space, lambda z: z[:, 0] > 1, norm.sf(1.0))
    guard = pool.guard(15.0, Defence())
    assert (guard[pool.weight > 0] > 0).all()
    near, whole = pool.along.within(0.0, 15.0), pool.within(0.0, 15.0)
    assert (guard >= 0.3 * near).all()
    assert (guard >= 0.3 * whole).all()


# ---- directions


def runs_of(event, count, seed):
    generator = np.random.default_rng(seed)
    z = draw_at(generator.uniform(0, 30, count), event.dimension, generator)
    return z, *event.evaluate(z)


def captured(directions, vectors):
    """Return which share of the length of each vector, one a column, lies along the directions."""
    return np.linalg.norm(np.linalg.svd(directions, full_matrices=False)[0].T @ vectors, axis=0)


def test_the_gradient_of_the_posterior_is_that_of_differences():
    z, happened, score = runs_of(half_space(), 30, 6)
    regression = _Regression(z, graded(happened, score))
    model = _Model(0.1 * np.random.default_rng(7).normal(size=(DIMENSION, 2)), np.log([0.3, 0.9, 0.2]))
    value, gradient, growth = regression.posterior(model, model.free)
    assert np.isfinite(value)
    for i in (0, 7, 39, 40, 41, 42):
        step = 1e-5 * np.eye(len(model.vector))[i]
        ends = [regression.posterior(model.at(model.vector + sign * step), model.free)[0] for sign in (1, -1)]
        assert (ends[0] - ends[1]) / 2e-5 == pytest.approx(gradient[i], rel=1e-4, abs=1e-4)
    # A new column v changes the log evidence by v' L v.
    column = np.random.default_rng(8).normal(size=DIMENSION)
    wider = model.with_column(1e-3 * column)
    change = value - regression.posterior(wider, model.with_column(column * 0).free)[0]
    assert change == pytest.approx(1e-6 * column @ growth @ column, rel=1e-2)


def test_a_direction_of_any_kind_is_learnt_from_few_runs():
    z, happened, score = runs_of(half_space(), 50, 9)
    directions = learn_directions(z, happened, score, None)
    assert directions.shape[1] == 1
    assert captured(directions, ALIKE[:, None]) > 0.98
    shuffled = np.random.default_rng(10).permutation(score)
    assert captured(learn_directions(z, happened & False, shuffled, None), ALIKE[:, None]) < 0.9


def test_single_inputs_are_found_among_many():
    event = standard_normal_event(lambda z: np.maximum(3 - z[:, 3], 4 - 2 * z[:, 11]), dimension=DIMENSION)
    z, happened, score = runs_of(event, 80, 11)
    directions = learn_directions(z, happened, score, None)
    assert captured(directions, np.eye(DIMENSION)[:, [3, 11]]).min() > 0.999
    others = np.delete(directions, [3, 11], axis=0)
    assert (others != 0).sum() <= 1  # a single input too many does little harm


def test_what_was_found_before_is_not_lost():
    z, happened, score = runs_of(half_space(), 50, 12)
    before = learn_directions(z, happened, score, None)
    again = learn_directions(z, happened, score, before)
    assert captured(again, before).min() > 0.95 * np.linalg.norm(before)


# ---- the certificate, and the whole sampler


def test_in_many_dimensions_draws_look_far_out():
    wide_draws, reach = np.array([[60.0, 0.0, 15.0]]), 15.0
    begin = certificate.look_beyond(wide_draws, DIMENSION, reach, 0.0, 1e-3)
    assert 5 < begin < reach
    moved = np.array([[60.0, begin, reach]])
    bounds = [certificate.Unseen.after(each, DIMENSION, reach, 0.0).mode for each in (wide_draws, moved)]
    assert bounds[1] < 0.7 * bounds[0]


@pytest.fixture(scope="module")
def course():
    return drive(new_sampler(DIMENSION, seed=1, batch_size=5, certificate=STATED), half_space())


def test_a_half_space_in_20_dimensions_takes_less_than_300_runs(course):
    assert course.result.converged
    assert course.sampler.simulations < 300
    assert course.result.probability == pytest.approx(norm.sf(4.5), rel=0.4)
    assert isinstance(course.sampler.belief.space, Subspace)


def test_a_predecessor_of_many_inputs_is_refused():
    z = np.random.default_rng(13).normal(size=(5, DIMENSION))
    known = Predecessor(z, np.ones(5, bool))
    with pytest.raises(InputError, match=r"seen 20 inputs; expected at most 10.*Leave the predecessor out"):
        Sampler(DIMENSION, np.random.default_rng(14), fingerprint="new", predecessor=known)


@pytest.mark.seeds
def test_batches_are_unbiased_whatever_the_directions():
    errors = []
    for seed in range(2):
        sampler = drive(
            new_sampler(DIMENSION, seed=seed, batch_size=5, certificate=STATED), half_space(3.5)
        ).sampler
        # Batches of a sampler whose directions are wrong: the estimate needs more runs, and is not biased.
        sampler.progress.directions = np.random.default_rng(seed).normal(size=(DIMENSION, 1))
        again = resumed(sampler)
        first = len(again.progress.estimates)
        again.progress.learnt_at = 10**6
        for _ in range(40):
            again.tell(*half_space(3.5).evaluate(again.ask()))
        errors += [batch.probability / norm.sf(3.5) - 1 for batch in again.progress.estimates[first:]]
    assert abs(np.mean(errors)) < 4 * np.std(errors) / np.sqrt(len(errors))


@pytest.mark.parametrize("batches", [2, 8, 15])
def test_an_interrupted_run_in_many_dimensions_goes_on_like_a_whole_one(batches):
    whole, event = new_sampler(DIMENSION, seed=1, batch_size=5), half_space()
    for _ in range(batches):
        whole.tell(*event.evaluate(whole.ask()))
    again = resumed(whole)
    for _ in range(6):
        for sampler in (whole, again):
            sampler.tell(*event.evaluate(sampler.ask()))
    assert saved(again) == saved(whole)
