"""The far tail: its posterior against quadrature, its map and density against differences, and its draws."""

import warnings
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from accelerated_evaluation.laws.smooth.conditional import Places, SpeedLaw, speed_grid
from accelerated_evaluation.laws.smooth.family import FarRecords
from accelerated_evaluation.laws.smooth.shapes import PRIOR, RECORDS, FarTail, Generalised
from accelerated_evaluation.laws.smooth.smooth_hazard import SmoothHazard
from scipy.stats import gamma

SIZE = 50_000
FACTORS = np.array([0.7, 1.6, 0.4])


def bent(generator, factors, size=SIZE):
    """Return exponential variables whose hazard changes by the factors beyond the levels, by inversion."""
    levels = np.log(size / RECORDS)
    return FarTail(levels, np.asarray(factors)).original(generator.standard_exponential(size))


@pytest.fixture(scope="module")
def far():
    return FarTail(np.log(SIZE / RECORDS), FACTORS)


def test_the_posterior_is_that_of_quadrature():
    values = bent(np.random.default_rng(1), [1, 1, 1])
    found = FarTail.of(values, SIZE, 0.0)
    grid = np.linspace(1e-4, 8, 40_001)
    ends = [*found.levels, np.inf]
    for layer, (low, high) in enumerate(pairwise(ends)):
        inside = values[values > low]
        ended = np.sum(inside <= high)
        log_density = gamma.logpdf(grid, PRIOR, scale=1 / PRIOR)
        log_density += ended * np.log(grid) - grid * np.sum(np.minimum(inside, high) - low)
        density = np.exp(log_density - log_density.max())
        mean = np.sum(grid * density) / density.sum()
        deviation = np.sqrt(np.sum((grid - mean) ** 2 * density) / density.sum())
        assert found.factors[layer] == pytest.approx(mean, rel=1e-3)
        assert found.factors[layer] / np.sqrt(found.shapes[layer]) == pytest.approx(deviation, rel=1e-3)


def test_factors_are_found_where_there_are_records_and_stay_uncertain_where_there_are_none():
    generator, many = np.random.default_rng(2), 20
    # Records of many such samples, so that the factors are known to a few percent.
    values = np.concatenate([bent(generator, FACTORS) for _ in range(many)])
    found = FarTail.of(values, SIZE, 0.0)
    error = found.factors / np.sqrt(found.shapes)
    assert np.all(np.abs(found.factors - FACTORS) < 4 * error)
    assert np.any(np.abs(found.factors - 1) > 4 * error)  # the wrong answer: no change
    nothing = FarTail.of(np.array([]), SIZE, 0.0)
    assert nothing.factors.tolist() == [1, 1, 1]
    assert nothing.shapes.tolist() == [PRIOR] * 3
    drawn = np.array([nothing.drawn(generator).factors for _ in range(4000)])
    assert drawn.mean() == pytest.approx(1, abs=4 / np.sqrt(PRIOR * drawn.size))
    assert np.quantile(drawn, [0.1, 0.9]) == pytest.approx([0.27, 1.94], abs=0.04)  # as stated


def test_draws_have_the_posterior_mean_and_spread():
    found = FarTail.of(bent(np.random.default_rng(3), FACTORS), SIZE, 0.0)
    generator = np.random.default_rng(4)
    drawn = np.array([found.drawn(generator).factors for _ in range(4000)])
    spread = found.factors / np.sqrt(found.shapes)
    assert np.all(np.abs(drawn.mean(axis=0) - found.factors) < 4 * spread / np.sqrt(4000))
    assert drawn.std(axis=0) == pytest.approx(spread, rel=0.08)


def test_the_inverse_returns_the_hazard_and_the_density_is_its_derivative(far):
    original = np.linspace(0.01, 25, 997)
    changed = far.cumulative(original)
    np.testing.assert_allclose(far.original(changed), original, rtol=1e-12)
    step = 1e-6
    density = -(np.exp(-far.cumulative(original + step)) - np.exp(-far.cumulative(original - step))) / (
        2 * step
    )
    exact = np.exp(far.log_density_ratio(original) - original)
    np.testing.assert_allclose(density, exact, rtol=1e-5)
    wrong = np.exp(-changed)  # without the factor of the hazard
    assert np.max(np.abs(wrong / exact - 1)) > 0.5
    assert np.isinf(far.cumulative(np.array([np.inf]))).all()
    assert far.log_density_ratio(np.array([np.inf])).tolist() == [0.0]


def test_a_hazard_that_grows_to_the_largest_number_becomes_infinite_without_a_warning(far):
    """Records whose excesses end abruptly have a Gompertz tail, whose hazard passes through all numbers."""
    hazard = Generalised().cumulative(np.linspace(0, 1600, 200_001), np.array([-0.5]))
    assert hazard[np.isfinite(hazard)].max() > 1.3e308  # times the last factor it is too large
    steep = replace(far, factors=np.array([0.7, 1.6, 1.4]))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        changed, ratio = steep.cumulative(hazard), steep.log_density_ratio(hazard)
    assert np.all(np.diff(changed[np.isfinite(changed)]) > 0)
    assert np.isinf(changed[hazard > 1.3e308]).all()
    assert not np.isnan(ratio).any()


def test_stacked_draws_are_the_single_ones(far):
    tails = [far, replace(far, factors=far.factors[::-1]), replace(far, factors=np.ones(3))]
    original = np.random.default_rng(6).uniform(0, 20, (3, 40))
    stacked = FarTail.stacked(tails)
    for k, tail in enumerate(tails):
        np.testing.assert_allclose(stacked.cumulative(original)[k], tail.cumulative(original[k]))
        np.testing.assert_allclose(
            stacked.log_density_ratio(original)[k], tail.log_density_ratio(original[k])
        )
    np.testing.assert_allclose(stacked.cumulative(original)[2], original[2])


def test_a_speed_law_with_a_far_tail_is_consistent(far):
    grid = speed_grid()
    shape = tuple(matrix.shape[1] for matrix in grid.tensor.matrices)
    law = SpeedLaw(SmoothHazard(grid, np.full(shape, np.log(0.5))), far=far)
    speeds = np.linspace(1, 40, 200)
    given = law.given(Places.of(np.full(200, 12.0), np.full(200, 30.0)))
    np.testing.assert_allclose(given.cumulative(speeds), far.cumulative(0.5 * speeds), rtol=1e-9)
    np.testing.assert_allclose(given.inverse(given.cumulative(speeds)), speeds, rtol=1e-9)
    at_once = given.cumulative_at(speeds, slice(0, 1))[:, 0]
    np.testing.assert_allclose(at_once, given.cumulative(speeds), rtol=1e-12)
    hazard = np.exp(given.log_density(speeds) + given.cumulative(speeds))
    assert set(np.round(hazard / 0.5, 9)) == {1.0, *FACTORS}


def test_the_factors_of_a_draw_follow_from_the_drawn_law():
    """A law that is right gets factors near 1; another law gets others."""
    generator, grid = np.random.default_rng(8), speed_grid()
    shape = tuple(matrix.shape[1] for matrix in grid.tensor.matrices)
    size = 20_000
    places = Places.of(generator.uniform(5, 35, size), generator.uniform(5, 75, size))
    records = FarRecords(places, 2 * generator.standard_exponential(size), size, 2.3)
    right, slow = (SpeedLaw(SmoothHazard(grid, np.full(shape, np.log(rate)))) for rate in (0.5, 0.25))
    found = records.tail(right)
    expected = FarTail.of(0.5 * records.closing_speed, size, 2.3)
    np.testing.assert_allclose(found.factors, expected.factors, rtol=1e-9)
    assert np.all(np.abs(found.factors - 1) < 4 * found.factors / np.sqrt(found.shapes))
    assert records.tail(slow).shapes[0] < PRIOR + 1  # no record has a level of this law
    few = records.reduced(right.given(places).cumulative(records.closing_speed))
    assert few.closing_speed.size < size / 20
    np.testing.assert_allclose(few.tail(right).factors, found.factors)
