"""How far around a run its score excludes the event, and the runs that are made where no run excludes it."""

import numpy as np
import pytest
from fewruns import Cover
from fewruns.constants import STEEPER
from fewruns.cover import balls_with, clearances, find_open_balls, points_in_open_balls
from fewruns.wide_laws import draw_wide
from sampler_checks import estimate, standard_normal_event
from scipy.spatial.distance import cdist
from scipy.stats import ncx2, norm

PLANE = norm.sf(4.2)
LARGEST = 1.25


def to_plane(z):
    return 4.2 - z[:, 0]


def disc(radius, *centre):
    return lambda z: np.linalg.norm(z - np.array(centre), axis=1) - radius


def around_plane(generator, dimension, n=60):
    """Return runs about the boundary of a half-space at the distance 4.2, and others everywhere."""
    across = generator.normal(size=(n, dimension - 1))
    near = np.column_stack([4.1 + generator.exponential(0.25, n), across])
    return np.vstack([near, draw_wide(40, dimension, generator, 14.0)])


def transformed(score):
    return np.sign(score) * np.abs(score) ** 3


@pytest.mark.parametrize("dimension", [2, 4])
def test_a_clearance_is_at_most_the_distance_to_the_event_if_the_score_says_it(dimension):
    z = around_plane(np.random.default_rng(1), dimension)
    score = to_plane(z)
    happened, centres = score <= 0, 4.2 * np.eye(dimension)[:1]
    clear = clearances(z, happened, score, np.vstack([z[happened], centres]))
    assert (clear[happened] == 0).all()
    others = ~happened & (score > 0.3)
    assert 0.8 < np.median(STEEPER * clear[others] / score[others]) < 1.5
    assert (clear[others & (score < 3)] < score[others & (score < 3)]).all()
    # Only the order of the scores matters, and equal scores exclude nothing but a known event.
    again = clearances(z, happened, transformed(score), np.vstack([z[happened], centres]))
    assert again == pytest.approx(clear)
    equal = clearances(z, happened, np.zeros(len(z)), z[happened])
    assert equal[~happened] == pytest.approx(cdist(z[~happened], z[happened]).min() / STEEPER)


def test_a_distant_run_is_no_farther_from_the_event_than_its_neighbours_say():
    """Its score is the largest one, so that no run around the known part says what it means."""
    z = np.vstack([around_plane(np.random.default_rng(1), 2), [[-9.0, -3.0]]])
    margin = disc(0.3, -3.1, -1.0)
    score = np.minimum(to_plane(z), margin(z))
    happened = to_plane(z) <= 0  # no run is in the disc
    clear = clearances(z, happened, score, z[happened])
    assert clear[-1] < margin(z[-1:]).item()
    alone = cdist(z[-1:], z[happened]).min() / STEEPER  # the wrong variant
    assert alone > margin(z[-1:]).item()


@pytest.mark.parametrize("dimension", [1, 2, 6])
def test_balls_have_the_stated_probability(dimension):
    radius, begin = balls_with(1e-6, LARGEST, dimension)
    assert radius[-1] == LARGEST
    assert (np.diff(begin) >= 0).all()
    found = ncx2.cdf(radius**2, dimension, (begin + radius) ** 2)
    inside = begin > 0
    assert inside.any()
    assert found[inside] == pytest.approx(np.full(inside.sum(), 1e-6), rel=1e-4)
    assert (found[~inside] <= 1e-6).all()


def test_open_balls_contain_no_run_and_are_outside_all_clearances():
    generator = np.random.default_rng(3)
    z = around_plane(generator, 2)
    happened = to_plane(z) <= 0
    clear = clearances(z, happened, to_plane(z), z[happened]) / 2  # so that some balls are open
    balls = find_open_balls(z, clear, z[happened], 0.5 * PLANE, LARGEST, generator)
    gap = cdist(balls[:, :-1], z) - balls[:, -1:]
    assert len(balls)
    assert (gap > clear).all()
    inside = ncx2.cdf(balls[:, -1] ** 2, 2, (balls[:, :-1] ** 2).sum(axis=1))
    assert inside == pytest.approx(np.full(len(balls), 0.5 * PLANE), rel=0.05)


PARTS = {
    "beside": disc(0.3, 2.6, 2.3),
    "between": disc(0.25, 3.2, 0.0),
    "behind": disc(0.3, -3.1, -1.0),
    "in three inputs": disc(0.5, 2.6, 2.3, 0.0),
}


@pytest.mark.parametrize("name", PARTS)
@pytest.mark.parametrize("transform", [lambda score: score, transformed])
def test_scores_are_followed_into_a_part(name, transform):
    """Until a run is in the part, some ball is open, wherever the part is."""
    part, dimension, found, spent = PARTS[name], 3 if name == "in three inputs" else 2, 0, []
    for seed in range(3):
        z = around_plane(np.random.default_rng(seed), dimension)
        z, first = z[part(z) > 0.2], len(z)
        while (part(z) > 0).all():
            score = np.minimum(to_plane(z), part(z))
            asked = z[:0], 0.5 * PLANE, LARGEST
            points = points_in_open_balls(5, z, score <= 0, transform(score), *asked, z[:0])
            if not len(points) or len(z) > first + 150:
                break
            z = np.vstack([z, points])
        found += (part(z) <= 0).any()
        spent.append(len(z) - first)
    assert found == 3
    assert np.median(spent) <= 60


@pytest.mark.parametrize("dimension", [2, 4])
def test_a_half_space_alone_takes_few_runs(dimension):
    z, spent = around_plane(np.random.default_rng(1), dimension), 0
    largest, centres = 1 / Cover.by_default(dimension).curvature, 4.4 * np.eye(dimension)[:1]
    while len(points := points_in_open_balls(5, z, *known(z), centres, 0.5 * PLANE, largest, z[:0])):
        z, spent = np.vstack([z, points]), spent + len(points)
        assert spent <= 100


def known(z):
    return to_plane(z) <= 0, to_plane(z)


def test_a_part_next_to_the_known_one_is_not_missed(monkeypatch):
    """A disc with nine tenths of the probability; without clearances it is said to be excluded."""
    part = disc(0.25, 3.2, 0.0)
    event = standard_normal_event(lambda z: np.minimum(to_plane(z), part(z)))
    exact = PLANE + ncx2.cdf(0.25**2, 2, 3.2**2)
    found = estimate(event, 1)
    assert found.converged
    assert 0.5 < found.probability / exact < 2
    monkeypatch.setattr("fewruns.exclusion.points_in_open_balls", lambda n, z, *_: z[:0])
    wrong = estimate(event, 1)
    assert wrong.converged
    assert wrong.high < 0.5 * exact
