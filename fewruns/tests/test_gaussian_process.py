"""The surrogate against exact orthant probabilities, its gradient, and a boundary that it has to find."""

import math

import numpy as np
import pytest
from fewruns import Predecessor, gaussian_process
from fewruns.constants import UNUSED
from fewruns.gaussian_process import EventSurrogate, with_distance
from scipy.stats import multivariate_normal

THETA = np.log([1.5, 0.8, 2.5, 2.0])  # lengths of two inputs and of the distance, and amplitude


def matern(a, b, lengths):
    r = np.sqrt(5 * (((a[:, None] - b) / lengths) ** 2).sum(-1))
    return (1 + r + r * r / 3) * np.exp(-r)


def orthant(covariance):
    """P(y > 0) of y ~ N(0, covariance)."""
    below = multivariate_normal(np.zeros(len(covariance)), covariance, maxpts=1_000_000, abseps=1e-6)
    return below.cdf(np.zeros(len(covariance)))


def exact(z, sign, theta, new=None):
    """P(the flags seen), and with a new point also P(event there | the flags seen).

    A probit of a latent Gaussian f is the chance that f + N(0, 1) has the sign seen, so that every one of
    these is the probability of an orthant.
    """
    points = z if new is None else np.vstack([z, new])
    points = np.column_stack([points, np.hypot(*points.T)])  # the distance from the origin
    signs = sign if new is None else np.append(sign, 1.0)
    variance = math.exp(2 * theta[-1])
    latent = variance * (1 + matern(points, points, np.exp(theta[:-1])))
    probability = orthant(np.outer(signs, signs) * (latent + np.eye(len(points))))
    return probability if new is None else probability / exact(z, sign, theta)


def surrogate_at(theta):
    surrogate = EventSurrogate(len(theta) - 2)
    surrogate.theta = np.array(theta)
    return surrogate


def runs(n, seed=1, spread=1.5):
    """Return runs, and the flags of an event beyond an oblique line."""
    z = np.random.default_rng(seed).normal(0, spread, (n, 2))
    distance = z @ [0.8, 0.6] - 0.5
    return z, distance > 0


@pytest.mark.parametrize(("n", "m"), [(3, 7), (100, 1), (1000, 90), (5, 2 * gaussian_process.BLOCK)])
def test_covariances_are_those_of_the_formula_whatever_the_blocks(n, m):
    generator = np.random.default_rng(n)
    a, b = generator.normal(0, 3, (n, 3)), generator.normal(0, 3, (m, 3))
    b[0] = a[0]  # at a distance of 0, where rounding may make the square negative
    value, slope = gaussian_process.covariance_between(a, b, 4.0, with_slope=True)
    np.testing.assert_allclose(value, 4 * (1 + matern(a, b, np.ones(3))), rtol=1e-6)
    # -2 d/d(r^2) of the correlation, by a small step of r^2
    square, step = ((a[:, None] - b) ** 2).sum(-1), 1e-5
    near, far = (np.sqrt(5 * (square + h)) for h in (step, 3 * step))
    difference = ((1 + far + far**2 / 3) * np.exp(-far) - (1 + near + near**2 / 3) * np.exp(-near)) / step
    np.testing.assert_allclose(slope, -difference, atol=2e-2)
    assert abs(slope + 1.1 * difference).max() > 0.1  # a slope that is a tenth too small is seen


@pytest.mark.parametrize("event", [[True, False], [True, False, True], [False, False, True]])
@pytest.mark.parametrize(("amplitude", "tolerance"), [(1.0, 5e-3), (2.0, 1e-2), (6.0, 2e-2)])
def test_probability_is_the_exact_posteriors(event, amplitude, tolerance):
    """Errors of up to 2e-3, 8e-3 and 1.5e-2 were seen.

    The orthants are known to 1e-6; what is left is the Gaussian form of the posterior, and sites that stop
    when the log evidence is known to 1e-3. Both grow with the amplitude.
    """
    z = np.array([[0.0, 0.0], [1.5, 0.3], [-0.4, 1.0]])[: len(event)]
    theta = np.append(THETA[:-1], math.log(amplitude))
    surrogate = surrogate_at(theta)
    surrogate.fit(z, np.array(event), learn=False)
    new = np.array([[0.5, 0.2], [-1.0, -1.0], [4.0, 1.0]])
    sign = np.where(event, 1.0, -1.0)
    truth, wrong = (
        [exact(z, sign, t, point) for point in new] for t in (theta, theta + np.array([0.7, 0.7, 0.7, 0.0]))
    )
    assert surrogate.probability(new) == pytest.approx(truth, abs=tolerance)
    assert surrogate.probability(new) != pytest.approx(wrong, abs=tolerance)


def test_evidence_is_the_exact_posteriors():
    z, sign = np.array([[0.0, 0.0], [1.5, 0.3], [-0.4, 1.0]]), np.array([1.0, -1.0, 1.0])
    surrogate = surrogate_at(THETA)
    surrogate.fit(z, sign > 0, learn=False)
    prior = 0.5 * (((THETA - surrogate._centre) / surrogate._scale) ** 2).sum()
    for _ in range(20):
        loss, _ = surrogate._loss(THETA, with_distance(z), sign, surrogate._centre)
    assert prior - loss == pytest.approx(math.log(exact(z, sign, THETA)), abs=1e-2)


def test_gradient_of_the_loss():
    """Central differences of 1e-3 are wrong by about 1e-6; the sites leave about 1e-5."""
    z, event = runs(25)
    sign = np.where(event, 1.0, -1.0)
    surrogate = surrogate_at(THETA)
    surrogate.fit(z, event, learn=False)

    def loss(theta):
        for _ in range(40):  # until the sites have settled, which one call need not wait for
            value = surrogate._loss(theta, with_distance(z), sign, surrogate._centre)
        return value

    step = 1e-3
    numeric = [(loss(THETA + step * e)[0] - loss(THETA - step * e)[0]) / (2 * step) for e in np.eye(4)]
    gradient = loss(THETA)[1]
    assert gradient == pytest.approx(numeric, rel=1e-3, abs=1e-3)
    assert min(abs(gradient)) > 0.01  # so that a missing term would show


def test_learning_lowers_the_loss():
    z, event = runs(60)
    sign = np.where(event, 1.0, -1.0)
    fixed, learnt = EventSurrogate(2), EventSurrogate(2)
    fixed.fit(z, event, learn=False)
    learnt.fit(z, event, learn=True)
    np.testing.assert_allclose(fixed.theta, np.log([*[1.5 * math.sqrt(2)] * 2, UNUSED, 20.0]))
    known = with_distance(z), sign, learnt._centre
    # two looks at evidence that is each known to 0.03
    assert learnt._loss(learnt.theta, *known)[0] < fixed._loss(fixed.theta, *known)[0] - 0.06


@pytest.mark.parametrize("curved", [False, True])
def test_the_distance_is_a_coordinate_if_the_boundary_is_curved_around_the_origin(curved):
    """All runs are on one side, so that only the distance says something about the other side."""
    z = 2.0 * np.random.default_rng(1).standard_normal((400, 2))
    z, far = z[z[:, 0] > 0.5], np.array([[-5.0, 0.5], [-4.5, -1.5], [-5.0, 2.0]])
    event = np.linalg.norm(z, axis=1) > 2.5 if curved else z[:, 0] > 2.0
    surrogate = EventSurrogate(2)
    surrogate.fit(z, event, learn=True)
    assert (surrogate.theta[2] < math.log(UNUSED) - 1) == curved
    there = surrogate.probability(far)
    surrogate.theta[2] = math.log(UNUSED)
    surrogate.fit(z, event, learn=False)
    assert (there > surrogate.probability(far) + 0.05).all() == curved


@pytest.mark.parametrize("learn", [False, True])
def test_a_linear_boundary_is_found(learn):
    z, event = runs(60, spread=2.0)
    surrogate = EventSurrogate(2)
    surrogate.fit(z, event, learn=learn)
    direction = np.array([0.8, 0.6])
    along = np.array([[t * -0.6, t * 0.8] for t in (-1.0, 0.0, 1.0)]) + 0.5 * direction
    assert (surrogate.probability(along + 2 * direction) > 0.97).all()
    assert (surrogate.probability(along - 2 * direction) < 0.03).all()
    edge = surrogate.probability(along)
    assert ((edge > 0.03) & (edge < 0.97)).all()
    at_runs = surrogate.probability(z)
    assert ((at_runs > 0.5) == event).mean() > 0.95
    flipped = EventSurrogate(2)
    flipped.fit(z, ~event, learn=learn)
    np.testing.assert_allclose(flipped.probability(z), 1 - at_runs, atol=1e-9)


def test_new_runs_join_the_earlier_ones():
    z, event = runs(60)
    together, later = EventSurrogate(2), EventSurrogate(2)
    together.fit(z, event, learn=False)
    later.fit(z[:30], event[:30], learn=False)
    assert later.sites.shape == (2, 30)
    before = later.probability(z)
    later.fit(z, event, learn=False)
    assert later.sites.shape == (2, 60)
    # both have settled to 1e-3 of the log evidence
    np.testing.assert_allclose(later.probability(z), together.probability(z), atol=5e-3)
    assert abs(before - together.probability(z)).max() > 0.05


def test_learning_forgets_the_sites_of_earlier_runs():
    z, event = runs(60)
    fresh, again, kept = (EventSurrogate(2) for _ in range(3))
    for surrogate in (again, kept):
        surrogate.fit(z, z[:, 0] < -0.5, learn=False)
    for surrogate in (fresh, again):
        surrogate.fit(z, event, learn=True)
    kept.theta = fresh.theta
    kept.fit(z, event, learn=False)
    assert again.probability(z).tolist() == fresh.probability(z).tolist()
    assert kept.probability(z).tolist() != fresh.probability(z).tolist()


def slab(direction, n=120, seed=3):
    """Return runs next to a thin slab, and whether they are in it."""
    z = np.random.default_rng(seed).normal(0, 1.5, (n, 2))
    across = z @ direction
    z = z - 0.7 * across[:, None] * direction  # most runs are near it
    return z, abs(z @ direction) < 0.25


@pytest.mark.parametrize(("direction", "oblique"), [((0.8, 0.6), True), ((0.0, 1.0), False)])
def test_axes_are_those_that_the_flags_bear_out(direction, oblique):
    z, event = slab(np.array(direction))
    along, turned = EventSurrogate(2), EventSurrogate(2)
    wrong = np.array([[0.8, -0.6], [0.6, 0.8]])
    axes = gaussian_process.principal_axes(z[event]) if oblique else [wrong]
    along.fit(z, event, learn=True)
    turned.fit(z, event, learn=True, turned=axes)
    assert along.axes.tolist() == np.eye(2).tolist()
    assert (turned.axes == (axes[0] if oblique else np.eye(2))).all()
    new, there = slab(np.array(direction), 400, seed=4)
    by_axes, by_turned = (
        np.log(np.where(there, p, 1 - p)).mean() for p in (along.probability(new), turned.probability(new))
    )
    assert by_turned > by_axes + 0.05 if oblique else by_turned == by_axes


@pytest.mark.parametrize("known", [False, True])
def test_lengths_are_measured_along_the_axes(known):
    """A surrogate of points along other axes is the surrogate of the turned points."""
    z, event = runs(40)
    other, happened = runs(15, seed=2)
    axes = np.array([[0.6, -0.8], [0.8, 0.6]])
    turned = EventSurrogate(2, Predecessor(other, happened) if known else None)
    plain = EventSurrogate(2, Predecessor(other @ axes, happened) if known else None)
    turned.axes = axes
    turned.theta[:2] = plain.theta[:2] = np.log([0.7, 3.0])
    turned.fit(z, event, learn=False)
    plain.fit(z @ axes, event, learn=False)
    np.testing.assert_allclose(turned.probability(z), plain.probability(z @ axes), atol=1e-9)
    assert abs(turned.probability(z) - plain.probability(z)).max() > 0.05


def test_repeated_points_are_no_obstacle():
    z = np.repeat([[0.0, 0.0], [3.0, 0.0]], 20, axis=0)
    surrogate = EventSurrogate(2)
    surrogate.fit(z, z[:, 0] > 1, learn=True)
    p = surrogate.probability(np.array([[0.0, 0.0], [3.0, 0.0]]))
    assert p[0] < 0.05
    assert p[1] > 0.95
