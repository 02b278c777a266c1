"""The far tail: its posterior against exact integrals, its map and density against differences and mpmath."""

import warnings
from dataclasses import replace
from itertools import pairwise

import mpmath
import numpy as np
import pytest
from accelerated_evaluation.laws.smooth.conditional import Places, SpeedLaw, speed_grid
from accelerated_evaluation.laws.smooth.family import FarRecords
from accelerated_evaluation.laws.smooth.far_tail import (
    RECORDS,
    SHAPE,
    FarPrior,
    FarTail,
    Layers,
    _derivatives,
    field_components,
    levels_of,
)
from accelerated_evaluation.laws.smooth.shapes import Generalised
from accelerated_evaluation.laws.smooth.smooth_hazard import SmoothHazard
from accelerated_evaluation.laws.smooth.support import SUPPORT
from scipy.special import logsumexp
from scipy.stats import gamma, norm

SIZE = 50_000
FACTORS = np.array([0.7, 1.6, 0.4])
ONE = FarPrior(deviations=(0.0,))  # one factor for all places


def places_of(generator, size):
    return Places.of(generator.uniform(5, 35, size), generator.uniform(5, 75, size))


def bent(generator, factors, size=SIZE):
    """Return exponential variables whose hazard changes by the factors beyond the levels, by inversion."""
    layers = Layers(np.log(SIZE / RECORDS), np.asarray(factors))
    return layers.original(generator.standard_exponential(size))


def posterior_of(values, places, prior=ONE):
    return prior.posterior(values, places.splines, SUPPORT.bases, np.log(SIZE / RECORDS))


def far_records(generator, factors):
    """Return cumulative hazards of records that reach the far tail, and their places."""
    values = bent(generator, factors)
    values = values[values > np.log(SIZE / RECORDS[0]) - 1]
    return values, places_of(generator, values.size)


@pytest.fixture(scope="module")
def layers():
    return Layers(np.log(SIZE / RECORDS), FACTORS)


@pytest.fixture(scope="module")
def far():
    """Return a far tail whose factors vary over the places."""
    fields = np.random.default_rng(9).normal(0, 0.3, (3, field_components(SUPPORT.bases).shape[1]))
    log_factors = np.log(FACTORS)[:, None] + fields @ field_components(SUPPORT.bases).T
    return FarTail(np.log(SIZE / RECORDS), log_factors)


def test_one_factor_for_all_places_has_the_posterior_of_quadrature():
    values, places = far_records(np.random.default_rng(1), [1, 1, 1])
    found = posterior_of(values, places)
    factors = found.mean().at(places.splines).factors
    np.testing.assert_allclose(factors, np.broadcast_to(factors[:, :1], factors.shape), rtol=1e-9)
    generator = np.random.default_rng(4)
    drawn = np.array([found.drawn(generator).at(places.splines[:1]).factors[:, 0] for _ in range(4000)])
    grid = np.linspace(1e-4, 8, 40_001)
    for layer, (low, high) in enumerate(pairwise([*found.levels, np.inf])):
        inside = values[values > low]
        ended = np.sum(inside <= high)
        log_density = gamma.logpdf(grid, SHAPE, scale=1 / SHAPE)
        log_density += ended * np.log(grid) - grid * np.sum(np.minimum(inside, high) - low)
        density = np.exp(log_density - log_density.max())
        mean = np.sum(grid * density) / density.sum()
        deviation = np.sqrt(np.sum((grid - mean) ** 2 * density) / density.sum())
        assert factors[layer, 0] == pytest.approx(mean, rel=1e-3)
        assert drawn[:, layer].mean() == pytest.approx(mean, abs=4 * deviation / np.sqrt(4000))
        assert drawn[:, layer].std() == pytest.approx(deviation, rel=0.08)


def log_joint(found, deviation, z):
    """Return the log of prior times likelihood at m points z, (m, layers, J), without the common factors.

    They are integrated out by quadrature here, and not by the formula: for 4001 values of the risk, with
    linear interpolation between them, whose error is about 1e-4 or less.
    """
    log_factor = np.linspace(-6, 3, 181)[:, None]
    total = norm.logpdf(z).sum(axis=(1, 2))
    fields = deviation * np.cumsum(z, axis=1)
    for layer in range(len(found.levels)):
        field = fields[:, layer] @ found.fields.T
        own = np.where(found.ended[layer], field, 0).sum(axis=1)
        risk = np.exp(field) @ found.inside[layer]
        rate, shape = found.prior.shape, found.prior.shape + found.ended[layer].sum()
        grid = np.geomspace(risk.min(), risk.max(), 4001)
        integral = logsumexp(shape * log_factor - np.exp(log_factor) * (rate + grid), axis=0)
        total += own + np.interp(np.log(risk), np.log(grid), integral)
    return total


@pytest.fixture(scope="module")
def two_halves():
    """Return the posterior of records whose hazard differs between slow and fast traffic, and their places.

    One component of the fields, so that its posterior is an integral over one variable in each layer.
    """
    generator = np.random.default_rng(12)
    places, values = places_of(generator, SIZE), generator.standard_exponential(SIZE)
    slow = places.lead_speed < 15
    levels = np.log(SIZE / RECORDS)
    values[slow] = Layers(levels, np.array([0.6, 0.6, 0.6])).original(values[slow])
    few = values > levels[0] - 1
    prior = FarPrior(deviations=(0.0, 0.4, 0.8))
    found = posterior_of(values[few], places.only(few), prior)
    speed = (found.fields @ found.fields.T @ places.lead_speed[few][values[few] > levels[0]])[:, None]
    speed = (speed - speed.mean()) / speed.std()
    return replace(found, fields=speed, components=found.components[:, :1])


def test_the_fields_and_their_deviation_have_the_posterior_of_importance_sampling(two_halves):
    generator, size = np.random.default_rng(5), 100_000
    log_evidence, means = [], []
    for mode in two_halves._modes:
        z = generator.standard_normal((size, *mode.z.shape))  # of the prior, which is wide enough here
        log_weight = log_joint(two_halves, mode.deviation, z) - norm.logpdf(z).sum(axis=(1, 2))
        log_evidence.append(logsumexp(log_weight))
        weight = np.exp(log_weight - log_weight.max())
        means.append(weight @ (mode.deviation * np.cumsum(z, axis=1))[..., 0] / weight.sum())
    exact = np.exp(log_evidence - logsumexp(log_evidence))
    np.testing.assert_allclose(two_halves._evidence, exact, atol=0.02)
    assert np.max(np.abs(exact - 1 / 3)) > 0.1  # the wrong answer: the prior
    for mode, mean in zip(two_halves._modes, means, strict=True):
        np.testing.assert_allclose(mode.fields(np.zeros_like(mode.z))[:, 0], mean, atol=0.03)


def test_draws_of_the_fields_have_their_means_and_spread(two_halves):
    only = replace(two_halves, prior=FarPrior(deviations=(0.8,)))
    generator, size = np.random.default_rng(6), 100_000
    z = generator.standard_normal((size, 3, 1))
    log_weight = log_joint(only, 0.8, z) - norm.logpdf(z).sum(axis=(1, 2))
    weight = np.exp(log_weight - logsumexp(log_weight))
    fields = 0.8 * np.cumsum(z, axis=1)[..., 0]
    mean = weight @ fields
    deviation = np.sqrt(weight @ (fields - mean) ** 2)
    component = only.components[:, 0]

    def contrast(tail):  # the coefficient of the only component, whatever the common factor is
        return (tail.log_factors - tail.log_factors.mean(axis=1, keepdims=True)) @ (
            (component - component.mean()) / np.sum((component - component.mean()) ** 2)
        )

    drawn = np.array([contrast(only.drawn(generator)) for _ in range(4000)])
    assert np.all(np.abs(drawn.mean(axis=0) - mean) < 4 * deviation / np.sqrt(4000) + 0.03)
    np.testing.assert_allclose(drawn.std(axis=0), deviation, rtol=0.1)


def test_the_derivatives_of_the_posterior_are_those_of_differences():
    found = posterior_of(*far_records(np.random.default_rng(14), FACTORS), FarPrior())
    z = np.random.default_rng(15).normal(0, 0.3, (3, found.fields.shape[1]))
    records = 0.8, found.ended @ found.fields, found.inside, found.fields, found._shapes, found.prior.shape
    _, gradient, information = _derivatives(z, *records)
    for place, step in enumerate(1e-5 * np.eye(z.size)):
        ends = [_derivatives(z + sign * step.reshape(z.shape), *records) for sign in (1, -1)]
        assert (ends[0][0] - ends[1][0]) / 2e-5 == pytest.approx(gradient[place], abs=1e-4)
        slope = (ends[0][1] - ends[1][1]) / 2e-5
        np.testing.assert_allclose(-slope, information[place], atol=1e-4)


def test_factors_are_found_by_place_if_many_records_show_them():
    """Ten times the records beyond each level: the halves are told apart, and equal ones stay together."""
    generator = np.random.default_rng(16)
    places = places_of(generator, 10 * SIZE)
    slow, levels = places.lead_speed < 20, np.log(SIZE / RECORDS)
    ends = Places.of([8.0, 32.0], [40.0, 40.0]).splines
    for factor in (0.5, 1.0):
        values = generator.standard_exponential(10 * SIZE)
        values[slow] = Layers(levels, np.full(3, factor)).original(values[slow])
        few = values > levels[0]
        found = posterior_of(values[few], places.only(few), FarPrior())
        ratio = np.divide(*found.mean().at(ends).factors[0])
        assert ratio == pytest.approx(factor, abs=0.15)
        deviation = found._evidence @ found.prior.deviations
        assert deviation > 0.25 if factor < 1 else deviation < 0.25


def test_factors_stay_uncertain_where_there_are_no_records():
    nothing = posterior_of(np.array([]), places_of(np.random.default_rng(2), 0))
    place = Places.of([12.0], [30.0]).splines
    np.testing.assert_allclose(nothing.mean().at(place).factors, 1)
    generator = np.random.default_rng(3)
    drawn = np.array([nothing.drawn(generator).at(place).factors for _ in range(4000)])
    assert drawn.mean() == pytest.approx(1, abs=4 / np.sqrt(SHAPE * drawn.size))
    assert np.quantile(drawn, [0.1, 0.9]) == pytest.approx([0.27, 1.94], abs=0.04)  # as stated
    by_place = replace(nothing, prior=FarPrior(deviations=(0.8,)))
    logs = np.log([by_place.drawn(generator).at(place).factors[:, 0] for _ in range(4000)])
    # The variances of common factor and field add up, and the field collects one change in each layer.
    variance = np.log(drawn).var() + 0.8**2 * np.arange(1, 4) * np.sum((place @ nothing.components) ** 2)
    np.testing.assert_allclose(logs.var(axis=0), variance, rtol=0.1)


def test_the_components_have_the_covariance_of_the_kernel():
    """At the maxima of the splines, the field is a smoothed Gaussian process of variance near 1."""
    components = field_components(SUPPORT.bases)
    ends = Places.of([5.0, 20.0, 20.0, 35.0], [30.0, 30.0, 31.0, 30.0]).splines @ components
    covariance = ends @ ends.T
    assert np.all((np.diag(covariance) > 0.8) & (np.diag(covariance) < 1.05))
    correlation = covariance / np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    assert correlation[1, 2] > 0.99  # near places
    assert correlation[0, 1] == pytest.approx(np.exp(-0.5), abs=0.1)  # half an interval apart
    assert correlation[0, 3] == pytest.approx(np.exp(-2), abs=0.1)


def test_the_inverse_returns_the_hazard_and_the_density_is_its_derivative(layers):
    original = np.linspace(0.01, 25, 997)
    changed = layers.cumulative(original)
    np.testing.assert_allclose(layers.original(changed), original, rtol=1e-12)
    step = 1e-6
    density = -(np.exp(-layers.cumulative(original + step)) - np.exp(-layers.cumulative(original - step))) / (
        2 * step
    )
    exact = np.exp(layers.log_density_ratio(original) - original)
    np.testing.assert_allclose(density, exact, rtol=1e-5)
    wrong = np.exp(-changed)  # without the factor of the hazard
    assert np.max(np.abs(wrong / exact - 1)) > 0.5
    assert np.isinf(layers.cumulative(np.array([np.inf]))).all()
    assert layers.log_density_ratio(np.array([np.inf])).tolist() == [0.0]


def test_a_hazard_that_grows_to_the_largest_number_becomes_infinite_without_a_warning(layers):
    """Records whose excesses end abruptly have a Gompertz tail, whose hazard passes through all numbers."""
    hazard = Generalised().cumulative(np.linspace(0, 1600, 200_001), np.array([-0.5]))
    assert hazard[np.isfinite(hazard)].max() > 1.3e308  # times the last factor it is too large
    steep = replace(layers, factors=np.array([0.7, 1.6, 1.4]))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        changed, ratio = steep.cumulative(hazard), steep.log_density_ratio(hazard)
    assert np.all(np.diff(changed[np.isfinite(changed)]) > 0)
    assert np.isinf(changed[hazard > 1.3e308]).all()
    assert not np.isnan(ratio).any()


def test_stacked_draws_are_the_single_ones(far):
    tails = [
        far,
        replace(far, log_factors=far.log_factors[::-1]),
        replace(far, log_factors=0 * far.log_factors),
    ]
    generator = np.random.default_rng(6)
    original, splines = generator.uniform(0, 20, (3, 40)), places_of(generator, 40).splines
    stacked = FarTail.stacked(tails).at(splines)
    for k, tail in enumerate(tails):
        own = tail.at(splines)
        np.testing.assert_allclose(stacked.cumulative(original)[k], own.cumulative(original[k]))
        np.testing.assert_allclose(stacked.log_density_ratio(original)[k], own.log_density_ratio(original[k]))
    np.testing.assert_allclose(stacked.cumulative(original)[2], original[2])
    again = FarTail.from_content(far.content())
    np.testing.assert_array_equal(again.log_factors, far.log_factors)
    np.testing.assert_array_equal(again.levels, far.levels)


def constant_law(hazard, far=None):
    """Return a law under which the closing speed is exponential at every place."""
    grid = speed_grid()
    shape = tuple(matrix.shape[1] for matrix in grid.tensor.matrices)
    return SpeedLaw(SmoothHazard(grid, np.full(shape, np.log(hazard))), far=far)


def test_a_speed_law_with_a_far_tail_is_consistent(far):
    generator = np.random.default_rng(10)
    speeds, places = np.linspace(1, 40, 200), places_of(generator, 200)
    factors = far.at(places.splines)
    given = constant_law(0.5, far).given(places)
    np.testing.assert_allclose(given.cumulative(speeds), factors.cumulative(0.5 * speeds), rtol=1e-9)
    np.testing.assert_allclose(given.inverse(given.cumulative(speeds)), speeds, rtol=1e-9)
    some = np.array([150, 3, 77, 3])
    np.testing.assert_allclose(given.cumulative(speeds[some], some), given.cumulative(speeds)[some])
    at_once = given.cumulative_at(speeds, slice(20, 50))
    for column, place in enumerate(range(20, 50)):
        own = given.cumulative(speeds, np.full(200, place))
        np.testing.assert_allclose(at_once[:, column], own, rtol=1e-12)
    density = given.log_density(speeds) + given.cumulative(speeds)
    layer = np.searchsorted(factors.levels, 0.5 * speeds) - 1
    hazard = np.where(layer < 0, 1, factors.factors[layer, np.arange(200)])
    np.testing.assert_allclose(np.exp(density), 0.5 * hazard, rtol=1e-9)
    assert np.ptp(factors.factors[0]) > 0.1  # the factors depend on the place


def test_the_density_integrates_to_the_far_probability_of_mpmath(far):
    """P(C > 60 m/s) is below 1e-6, and the integral of the density beyond this speed agrees with it."""
    place = Places.of([9.0], [25.0])
    given, factors = constant_law(0.5, far).given(place), far.at(place.splines).factors[:, 0]
    speed, top = 60.0, 400.0
    with mpmath.workdps(40):
        exact, levels = mpmath.mpf(float(far.levels[0])), [*far.levels, np.inf]
        for (low, high), factor in zip(pairwise(levels), factors, strict=True):
            exact += float(factor) * max(min(0.5 * speed, high) - low, 0)
        exact = mpmath.exp(-exact)
    assert exact < 1e-6
    assert np.exp(-given.cumulative(np.array([speed])))[0] == pytest.approx(float(exact), rel=1e-12)
    nodes, weights = np.polynomial.legendre.leggauss(400)
    closing = speed + (nodes + 1) / 2 * (top - speed)
    many = constant_law(0.5, far).given(Places.of(np.full(400, 9.0), np.full(400, 25.0)))
    integral = (top - speed) / 2 * weights @ np.exp(many.log_density(closing))
    assert integral == pytest.approx(float(exact), rel=1e-6)


def test_the_factors_of_a_draw_follow_from_the_drawn_law():
    """A law that is right gets factors near 1; another law gets others."""
    generator, size = np.random.default_rng(8), 20_000
    places = places_of(generator, size)
    records = FarRecords(places, 2 * generator.standard_exponential(size), size, 2.3)
    right, slow = (constant_law(hazard) for hazard in (0.5, 0.25))
    found = records.posterior(right, ONE)
    factors = found.mean().at(places.splines[:1]).factors[:, 0]
    assert np.all(np.abs(factors - 1) < 4 * factors / np.sqrt(SHAPE + found.ended.sum(axis=1)))
    assert records.posterior(slow, ONE).ended.sum() == 0  # no record has a level of this law
    few = records.reduced(right.given(places).cumulative(records.closing_speed))
    assert few.closing_speed.size < size / 20
    np.testing.assert_allclose(few.posterior(right, ONE).mean().log_factors, found.mean().log_factors)


def test_levels_are_not_below_the_lowest_threshold():
    np.testing.assert_allclose(levels_of(1000, 0.0), np.log([10, 100, 1000]))
    assert levels_of(50, 2.3).tolist() == [2.3, 2.3, np.log(50)]
