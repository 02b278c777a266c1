"""Parts of the event that a run has met, and that the estimate ignores because the surrogate does."""

import numpy as np
import pytest
from fewruns import Stopping, exclusion
from fewruns.combining import consistent_batches
from fewruns.parts import draw_in_balls_together, open_balls, shares_of_parts
from fewruns.wide_laws import draw_wide
from sampler_checks import drive, new_sampler, resumed, standard_normal_event
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.special import chndtr
from scipy.stats import ncx2, norm

PLANE = norm.sf(4.2)
CENTRE = np.array([-4.76478466, 0.0, 0.0])  # of a ball of radius 1 that is as probable as the half-space


def margin(z, radius=1.0):
    return np.minimum(4.2 - z[:, 0], np.linalg.norm(z - CENTRE, axis=1) - radius)


def known_runs(radius=1.0):
    """Return runs of which one is in the ball, their flags, and the centres of a pool that ignores it."""
    generator = np.random.default_rng(3)
    z = draw_wide(60, 3, generator, 14.0)
    z = z[np.linalg.norm(z - CENTRE, axis=1) > 1.2]
    plane = np.array([4.5, 0.0, 0.0]) + generator.normal(size=(100, 3)) * [0.2, 0.8, 0.8]
    plane[:, 0] = np.maximum(plane[:, 0], 4.2)
    z = np.vstack([z, plane[:30], CENTRE - [0.6, 0.2, -0.1]])
    return z, margin(z, radius) <= 0, plane


def test_events_belong_to_the_part_with_which_other_events_link_them():
    z, happened, centres = known_runs()
    far = np.array([[4.6, 3.0, 0.0]])  # reached by way of the other events
    z, happened = np.vstack([z, far]), np.append(happened, True)
    share = shares_of_parts(z, happened, centres)
    is_in_ball = z[happened][:, 0] < 0
    assert (share[~is_in_ball] == 1).all()
    assert (share[is_in_ball] == 0).all()
    # With some centres in the ball, its share is known.
    both = np.vstack([centres, np.tile(CENTRE, (100, 1))])
    assert shares_of_parts(z, happened, both)[is_in_ball] == 0.5
    # If no run is between them, nothing separates the two parts.
    assert (shares_of_parts(z[happened], happened[happened], centres) == 1).all()


@pytest.mark.parametrize("dimension", [2, 4])
def test_parts_are_those_of_all_pairs(dimension):
    """The pairs are examined in blocks, the nearest first; here all of them are at once."""
    generator, shares = np.random.default_rng(dimension), set()
    for _ in range(5):
        z, happened = generator.normal(size=(300, dimension)), generator.random(300) < 0.1
        centres = generator.normal(size=(20, dimension))
        points = np.vstack([centres, z[happened]])
        middle = (points[:, None] + points) / 2
        apart = cKDTree(z[~happened]).query(middle)[0]
        linked = apart >= np.linalg.norm(points[:, None] - points, axis=2) / 2
        part = connected_components(linked, directed=False)[1]
        expected = [(part[:20] == own).mean() for own in part[20:]]
        assert (shares_of_parts(z, happened, centres) == expected).all()
        shares.update(expected)
    assert len(shares) > 3  # several parts of different sizes


def test_balls_are_open_around_an_event_that_the_pool_ignores():
    z, happened, centres = known_runs()
    balls = open_balls(z, happened, centres, PLANE, 0.5)
    middle, radius = balls[:, :3], balls[:, 3]
    assert (np.linalg.norm(middle - z[-1], axis=1) <= radius).all()
    assert (cKDTree(z[~happened]).query(middle)[0] > radius).all()
    assert (chndtr(radius**2, 3, (middle**2).sum(axis=1)) >= 0.5 * PLANE).all()
    assert len(open_balls(z, happened, centres, 100 * PLANE, 0.5)) == 0  # the ball would be negligible
    both = np.vstack([centres, np.tile(CENTRE, (100, 1))])
    assert len(open_balls(z, happened, both, PLANE, 0.5)) == 0
    # The points of a batch exclude most balls, or show that the ball is large.
    points = draw_in_balls_together(5, balls, np.random.default_rng(1))
    inside = (np.linalg.norm(middle[:, None] - points, axis=2) <= radius[:, None]).any(axis=1)
    assert inside.mean() > 0.95
    assert cKDTree(points).query(points, k=2)[0][:, 1].min() > 0.1
    assert (margin(points) <= 0).sum() >= 2


@pytest.mark.parametrize("radius", [0.7, 0.9])
def test_open_balls_are_closed_by_few_runs(radius):
    """The event is in a ball with less than half of the probability, which the pool may ignore."""
    assert ncx2.cdf(radius**2, 3, 4.76**2) < PLANE
    (z, happened, centres), generator, added = known_runs(radius), np.random.default_rng(2), 0
    while len(balls := open_balls(z, happened, centres, PLANE, 1.0)):
        z = np.vstack([z, draw_in_balls_together(5, balls, generator)])
        happened, added = margin(z, radius) <= 0, added + 5
        assert added <= 100
    assert added > 0


def test_an_estimate_does_not_converge_while_it_ignores_an_event(monkeypatch):
    """Without clearances, a seed converges below the probability, although runs have met the ball."""
    event, goal = standard_normal_event(margin, dimension=3), Stopping()
    monkeypatch.setattr(exclusion, "points_in_open_balls", lambda n, z, *_: z[:0])
    with monkeypatch.context() as without:
        without.setattr(exclusion, "open_balls", lambda z, *_: z[:0])
        wrong = drive(sampler := new_sampler(3, 14, 5), event, goal)
    assert wrong.result.converged
    assert wrong.result.high < 2 * PLANE
    sampler = resumed(sampler)  # a sampler does not check its certificate again before it has more runs
    progress, counted = sampler.progress, consistent_batches(sampler.progress.estimates)
    assert ((margin(progress.z) <= 0) & (progress.z[:, 0] < 0)).any()
    assert not sampler.has_converged(goal)
    right = drive(sampler, event, Stopping(maximum_simulations=sampler.simulations + 100)).result
    assert counted[0] not in consistent_batches(progress.estimates)  # the estimate has begun again
    assert right.low < 2 * PLANE < right.high
