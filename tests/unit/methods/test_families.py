"""Families of f*: Cross-Entropy updates against brute force, and weights with a lower bound."""

import dataclasses
import math

import numpy as np
import pytest
from accelerated_evaluation.laws.distributions import BoundedExponential
from accelerated_evaluation.methods.cross_entropy.families import (
    PiecewiseFamily,
    SingleFamily,
    bounded_weights,
)
from scipy.optimize import minimize
from toy_segment import F


def weighted_likelihood(law, x, weight):
    return float((weight * law.logpdf(x)).sum())


@pytest.fixture
def events():
    """Events of one variable with weights of any size, most of them in the tail piece."""
    generator = np.random.default_rng(5)
    x = np.concatenate([generator.uniform(0.05, 0.16, 40), 0.3 + generator.exponential(0.1, 60)])
    return x, generator.exponential(1.0, 100) ** 3


def test_single_update_maximizes_the_weighted_likelihood(events):
    family = SingleFamily.start(F.second)
    assert family.distribution.mean() == pytest.approx(F.second.mean())
    best = family.update(*events)
    brute = minimize(lambda p: -weighted_likelihood(BoundedExponential(math.exp(p[0])), *events), [1.0])
    assert best.parameters() == {"rate": best.distribution.rate}
    assert best.distribution.rate == pytest.approx(math.exp(brute.x[0]), rel=1e-4)
    assert weighted_likelihood(best.distribution, *events) >= -brute.fun


def test_piecewise_update_maximizes_the_weighted_likelihood(events):
    best = PiecewiseFamily.start(F.second, 0.01, 5).update(*events)

    def loss(parameters):
        share = 1 / (1 + math.exp(-parameters[0]))
        tilts = parameters[1], 21 - math.exp(parameters[2])
        return -weighted_likelihood(F.second.accelerated(tilts, (share, 1 - share)), *events)

    brute = minimize(loss, [0.0, 0.0, 3.0], method="Nelder-Mead", options={"xatol": 1e-7, "fatol": 1e-9})
    assert weighted_likelihood(best.distribution, *events) == pytest.approx(-brute.fun, abs=1e-6)
    assert best.thetas == pytest.approx((brute.x[1], 21 - math.exp(brute.x[2])), rel=1e-3)
    assert best.weights[0] == pytest.approx(1 / (1 + math.exp(-brute.x[0])), rel=1e-4)
    unweighted = PiecewiseFamily.start(F.second, 0.01, 5).update(events[0], np.ones(100))
    assert weighted_likelihood(unweighted.distribution, *events) < -brute.fun - 1e-3


@pytest.mark.parametrize("light", [0.0, 5e-324, 1e-320])
def test_pieces_without_events_keep_theta(light):
    family = dataclasses.replace(PiecewiseFamily.start(F.second, 0.01, 5), thetas=(7.0, 1.0))
    x = np.array([0.01, 0.02, 0.03, 0.04, 0.05, 0.06, 0.3, 0.4, 0.5, 0.6, 0.7])
    few = family.update(x[2:], np.ones(9))  # four events in the body
    assert few.thetas[0] == 7.0
    assert few.thetas[1] == pytest.approx(21 - 1 / (0.5 - 0.166))
    lost = family.update(x, np.where(x < 0.166, light, 1.0))  # six, but their weights underflow
    assert lost.thetas == few.thetas
    assert lost.weights == pytest.approx((0.01, 0.99))
    assert family.update(x[:6], np.ones(6)).thetas[1] == 1.0


def test_needles_at_the_edge_of_a_bounded_piece_are_blunted():
    family = PiecewiseFamily.start(F.second, 0.01, 5)
    for edge, mean in ((1e-6, 0.02 * 0.166), (0.166 - 1e-6, 0.98 * 0.166)):
        body = family.update(np.full(9, edge), np.ones(9)).distribution.components[0]
        assert body.mean() == pytest.approx(mean)


def test_the_tail_of_f_star_is_never_lighter_than_that_of_f():
    family = PiecewiseFamily.start(F.second, 0.01, 5)
    near, far = (
        family.update(np.full(9, x), np.ones(9)).distribution.components[1].rate for x in (0.17, 0.6)
    )
    assert near == 21  # nine events next to the knot ask for a rate of 250
    assert far == pytest.approx(1 / (0.6 - 0.166))


@pytest.mark.parametrize(
    "shares", [(0.2, 0.3, 0.5), (0.0, 0.0, 1.0), (0.06, 0.9, 0.04), (0.11, 0.8, 0.09), (1 / 3,) * 3]
)
@pytest.mark.parametrize("minimum", [0.01, 0.1, 0.33])
def test_bounded_weights_are_the_best_of_all_that_are_allowed(shares, minimum):
    shares = np.array(shares)
    weights = np.array(bounded_weights(shares, minimum))
    assert weights.sum() == pytest.approx(1, rel=1e-15)
    assert weights.min() >= minimum
    assert np.all(np.diff(weights[np.argsort(shares)]) >= -1e-15)
    grid = np.linspace(minimum, 1 - 2 * minimum, 201)
    first, second = (part.ravel() for part in np.meshgrid(grid, grid))
    allowed = np.stack([first, second, 1 - first - second])[:, 1 - first - second >= minimum]
    assert shares @ np.log(weights) >= (shares @ np.log(allowed)).max() - 1e-12


@pytest.mark.parametrize(("size", "minimum"), [(3, 0.34), (2, 0.5), (2, 0.7), (2, 0.0), (2, math.nan)])
def test_weights_that_cannot_be_are_refused(size, minimum):
    with pytest.raises(ValueError, match=f"{size} weights cannot sum to one and each be at least"):
        bounded_weights(np.full(size, 1 / size), minimum)
