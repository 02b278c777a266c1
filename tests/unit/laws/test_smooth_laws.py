"""Smooth hazards, excesses and the laws made of them, against laws that are known in closed form."""

from dataclasses import replace

import numpy as np
import pytest
from accelerated_evaluation.base.errors import ConvergenceError
from accelerated_evaluation.laws.smooth import excess as excess_module
from accelerated_evaluation.laws.smooth.conditional import Places, Threshold, range_grid, speed_grid
from accelerated_evaluation.laws.smooth.excess import fit_excess, unit_information
from accelerated_evaluation.laws.smooth.family import DistinctRecords, Fitter, members_at
from accelerated_evaluation.laws.smooth.shapes import SHAPES, Exponential, Generalised, TwoKinds
from accelerated_evaluation.laws.smooth.smooth_hazard import Binned, fit_hazard
from accelerated_evaluation.laws.smooth.splines import Basis, Constant, Penalty, Tensor
from accelerated_evaluation.laws.smooth.support import SUPPORT, Support
from scipy import stats

SIZE = 12_000
PARAMETERS = {
    "exponential": [np.empty(0)],
    "generalised": [np.array([shape]) for shape in (-0.2, -5e-5, 5e-5, 0.15)],
    "two kinds": [np.array([-2.0, 0.4]), np.array([-1.0, -0.3])],
}
SHAPED = [(SHAPES[name], parameters) for name, choices in PARAMETERS.items() for parameters in choices]
STEP = 1e-6


def mean_speed(lead_speed, range_):
    """Mean closing speed [m/s] of the law that the tests draw from: exponential, and smooth in both."""
    return 1 + 0.02 * (35 - lead_speed) + 0.02 * range_


@pytest.fixture(scope="module")
def records():
    generator = np.random.default_rng(1)
    lead_speed = generator.uniform(5, 35, SIZE)
    range_ = 75 * generator.uniform(0.01, 1, SIZE) ** 0.5  # P(R < r) rises with r^2
    return DistinctRecords(
        lead_speed, range_, mean_speed(lead_speed, range_) * generator.standard_exponential(SIZE)
    )


@pytest.fixture(scope="module")
def family(records):
    return Fitter(records, members_at((0.9, 0.95))).fit()


def test_splines_add_up_to_one_and_are_constant_beyond_their_ends():
    basis = Basis(0.0, 3.0, 4)
    values = basis(np.array([-5.0, 0.0, 1.234, 3.0, 7.0]))
    assert values.shape == (5, 7)
    np.testing.assert_allclose(values.sum(axis=1), 1, atol=1e-12)
    np.testing.assert_allclose(values[[0, -1]], values[[1, -2]], atol=1e-12)


def test_straight_lines_are_not_penalised_and_parabolas_are():
    basis = Basis(0.0, 1.0, 5)
    line, parabola = np.arange(basis.size), np.arange(basis.size) ** 2.0
    assert abs(line @ basis.penalty() @ line) < 1e-12
    assert parabola @ basis.penalty() @ parabola > 1


def test_array_products_equal_those_of_the_large_design_matrix():
    generator = np.random.default_rng(2)
    matrices = tuple(generator.normal(size=shape) for shape in ((4, 2), (5, 3), (6, 2)))
    tensor, design = Tensor(matrices), np.kron(np.kron(matrices[0], matrices[1]), matrices[2])
    coefficients, weights = generator.normal(size=(2, 3, 2)), generator.uniform(size=(4, 5, 6))
    np.testing.assert_allclose(tensor.values(coefficients).ravel(), design @ coefficients.ravel(), atol=1e-12)
    np.testing.assert_allclose(tensor.transposed(weights).ravel(), design.T @ weights.ravel(), atol=1e-12)
    np.testing.assert_allclose(
        tensor.gram(weights), design.T @ (weights.ravel()[:, None] * design), atol=1e-12
    )


def test_time_at_risk_adds_up_to_all_closing_speeds(records):
    data = speed_grid().count(records.lead_speed, np.sqrt(records.range_), records.closing_speed)
    assert data.counts.sum() == SIZE
    np.testing.assert_allclose(data.exposure.sum(), records.closing_speed.sum(), rtol=1e-10)


def test_a_smooth_hazard_finds_the_law_it_was_drawn_from(records, family):
    places = Places.of(np.array([10.0, 20.0, 30.0]), np.array([60.0, 40.0, 20.0]))
    at = np.array([3.0, 2.0, 1.0])
    found = places.body(family.body).at(at)
    # In the middle of the domain the error is that of some hundreds of records nearby.
    np.testing.assert_allclose(found, at / mean_speed(places.lead_speed, places.range_), rtol=0.12)


def test_without_time_at_risk_the_hazard_would_be_wrong(records):
    grid = speed_grid()
    data = grid.count(records.lead_speed, np.sqrt(records.range_), records.closing_speed)
    wrong = Binned(data.counts, np.full_like(data.exposure, data.exposure.mean()))
    places, at = Places.of(np.array([20.0]), np.array([40.0])), np.array([4.0])
    truth = at / mean_speed(places.lead_speed, places.range_)
    assert abs(places.body(fit_hazard(grid, wrong)).at(at) / truth - 1) > 0.3


def test_the_range_law_is_a_power_of_the_range(family):
    near = Places.of(np.array([10.0, 30.0]), np.array([75.0, 75.0])).range_hazards(family.ranges)
    # P(R < 40 m) of the drawn law; its logarithm has a local standard error of about 0.03.
    truth = -np.log(((40 / 75) ** 2 - 0.01) / 0.99)
    np.testing.assert_allclose(near.at(np.full(2, np.log(75 / 40))), truth, rtol=0.1)


def test_cumulative_hazards_and_their_inverse_agree(family):
    cumulative = Places.of(np.array([6.0, 30.0]), np.array([5.0, 70.0])).body(family.body)
    for level in (0.01, 1.0, 5.0, 20.0):  # the last beyond the grid
        np.testing.assert_allclose(cumulative.at(cumulative.inverse(level)), level, rtol=1e-10)


@pytest.mark.parametrize(("shape", "parameters"), SHAPED)
def test_shapes_have_the_derivatives_and_inverses_that_they_tell(shape, parameters):
    z = np.array([0.05, 0.7, 3.0, 8.0])
    by_z, by_parameters = shape.derivatives(z, parameters)
    log_density = shape.log_density
    numeric = (log_density(z + STEP, parameters) - log_density(z - STEP, parameters)) / (2 * STEP)
    np.testing.assert_allclose(by_z, numeric, atol=1e-6)
    for place, step in enumerate(STEP * np.eye(parameters.size)):
        numeric = (log_density(z, parameters + step) - log_density(z, parameters - step)) / (2 * STEP)
        np.testing.assert_allclose(by_parameters[:, place], numeric, atol=1e-5)
    np.testing.assert_allclose(shape.inverse(shape.cumulative(z, parameters), parameters), z, rtol=1e-8)
    slope = (shape.cumulative(z + STEP, parameters) - shape.cumulative(z - STEP, parameters)) / (2 * STEP)
    np.testing.assert_allclose(
        np.log(slope) - shape.cumulative(z, parameters), log_density(z, parameters), atol=1e-6
    )


def test_the_generalised_shape_is_generalised_pareto_above_zero_and_has_no_end_below():
    z = np.array([0.5, 5.0, 50.0])
    ours = Generalised().cumulative(z, np.array([0.2]))
    np.testing.assert_allclose(ours, -stats.genpareto.logsf(z, 0.2), rtol=1e-10)
    assert np.isneginf(stats.genpareto.logsf(50.0, -0.1))  # the law that it replaces ends at 10
    assert np.isfinite(Generalised().cumulative(z, np.array([-0.1]))).all()


def test_information_is_the_variance_of_the_score():
    generator, parameters = np.random.default_rng(3), np.array([0.1])
    z = Generalised().inverse(generator.standard_exponential(200_000), parameters)
    by_z, by_shape = Generalised().derivatives(z, parameters)
    scores = np.column_stack([-1 - z * by_z, by_shape])
    found = unit_information(Generalised(), parameters)
    np.testing.assert_allclose(found, np.cov(scores.T), rtol=0.03)
    # Closed form of the generalised Pareto law (Smith 1984).
    truth = np.array([[1 / 1.2, 1 / (1.1 * 1.2)], [1 / (1.1 * 1.2), 2 / (1.1 * 1.2)]])
    np.testing.assert_allclose(found, truth, rtol=1e-3)


@pytest.mark.parametrize("shape", [-0.1, 0.15])
def test_excesses_give_back_shape_and_scale(shape):
    generator, size = np.random.default_rng(4), 8000
    places = Places.of(generator.uniform(5, 35, size), generator.uniform(1, 75, size))
    scale = np.exp(0.5 - 0.02 * places.lead_speed)
    excess = scale * Generalised().inverse(generator.standard_exponential(size), np.array([shape]))
    fit = fit_excess(excess, places.splines, SUPPORT.penalty, Generalised())
    deviation = np.sqrt(np.linalg.inv(fit.factor.T @ fit.factor)[-1, -1])
    assert abs(fit.parameters[0] - shape) < 4 * deviation
    assert abs(np.mean(np.log(fit.scale(places.splines) / scale))) < 4 * 1.5 / np.sqrt(size)
    wrong = fit_excess(excess, places.splines, SUPPORT.penalty, Exponential())
    z = excess / wrong.scale(places.splines)
    assert abs(np.mean(z > 3) / np.exp(-3) - 1) > 0.15  # the exponential misses the tail by far


def test_a_fit_that_is_cut_short_says_so(monkeypatch):
    monkeypatch.setattr(excess_module, "ITERATIONS", 1)
    x = np.random.default_rng(5).exponential(size=500) ** 2
    with pytest.raises(ConvergenceError, match="excesses"):
        fit_excess(x, np.ones((500, 1)), Penalty.of([Constant()]), TwoKinds())


def test_draws_of_a_fit_spread_as_their_covariance_says():
    x = np.random.default_rng(6).exponential(2.0, size=400)
    fit = fit_excess(x, np.ones((400, 1)), Penalty.of([Constant()]), Exponential())
    generator = np.random.default_rng(7)
    drawn = np.array([fit.drawn(generator).coefficients[0] for _ in range(4000)])
    assert abs(drawn.mean() - np.log(x.mean())) < 4 * 0.05 / np.sqrt(4000) + 1e-3
    assert abs(drawn.std() / 0.05 - 1) < 0.06  # 1 / sqrt(400), to five standard errors


def test_a_threshold_is_exceeded_as_often_as_its_level_says(records, family):
    threshold = family.thresholds[0.9]
    share = np.mean(records.closing_speed > threshold(records.lead_speed, records.range_))
    assert abs(share - 0.1) < 4 * np.sqrt(0.09 / SIZE)


def test_a_surface_is_exact_at_its_nodes_and_bilinear_between():
    surface = Threshold(0.9, np.array([0.0, 1.0]), np.array([0.0, 1.0]), np.array([[0.0, 1.0], [2.0, 5.0]]))
    np.testing.assert_allclose(surface(np.array([1.0, 0.5]), np.array([1.0, 0.25])), [5.0, 2.0])


def test_every_law_of_the_family_is_one_distribution_through_body_and_tail(family):
    places = Places.of(np.array([8.0, 15.0, 33.0]), np.array([4.0, 40.0, 74.0]))
    for member in (*family.tails, members_at(())[0]):
        given = family.law(member).given(places)
        for level in (0.5, 2.29, 2.31, 3.5, 12.0):  # below and above the thresholds
            speed = given.inverse(level)
            np.testing.assert_allclose(given.cumulative(speed), level, rtol=1e-8)
            slope = (given.cumulative(speed + STEP) - given.cumulative(speed - STEP)) / (2 * STEP)
            np.testing.assert_allclose(np.exp(given.log_density(speed) + level), slope, rtol=1e-4)
        assert np.isinf(given.cumulative(np.full(3, np.inf))).all()


def test_speeds_that_all_places_share_have_the_same_cumulative_hazards(family):
    places, speeds = Places.of([8.0, 15.0, 33.0], [4.0, 40.0, 74.0]), np.array([0.0, 0.7, 3.0, 9.0, 60.0])
    for member in (*family.tails, members_at(())[0]):
        given = family.law(member).given(places)
        one_by_one = [given.cumulative(np.full(3, speed)) for speed in speeds]
        assert np.array_equal(given.cumulative_at(speeds, slice(1, 3)), np.array(one_by_one)[:, 1:])


def test_refits_without_a_block_differ_and_those_without_nothing_do_not(records, family):
    fitter = Fitter(records, members_at((0.9, 0.95)))
    same = fitter.refit(family, np.array([], dtype=int))
    np.testing.assert_allclose(same.body.coefficients, family.body.coefficients, atol=0.05)
    other = fitter.refit(family, np.arange(3000))
    assert np.abs(other.body.coefficients - family.body.coefficients).max() > 0.05


def test_repeated_rows_are_one_event():
    import pandas as pd

    table = pd.DataFrame({"lead_speed": [7.0, 7, 8], "range": [9.0, 9, 9], "closing_speed": [1.0, 1, 1]})
    assert DistinctRecords.of(table).lead_speed.tolist() == [7, 8]


def test_few_rounded_records_are_fitted_with_and_without_a_block():
    """Values on the edges of bins spend no time there, which alone would make their hazard infinite."""
    draw = np.random.default_rng(1).choice
    speeds, ranges = draw([22.7, 25.7], 60), draw(np.linspace(35, 73, 8), 60)
    rounded = DistinctRecords(
        speeds, ranges, draw([0.1, 0.5, 1.0, 1.5, 2.5], 60), Support((22.0, 26.0), 74.0, 3.0)
    )
    fitter = Fitter(rounded)
    whole = fitter.fit()
    for fitted in (whole, fitter.refit(whole, np.arange(12))):
        survival = np.exp(-fitted.body.cumulative(rounded.places.splines).table)
        assert np.all(np.diff(survival, axis=1) <= 0)
        assert survival[:, -1].max() < 0.2


@pytest.mark.parametrize("range_max", [1.0, 2.5, 75.0, 300.0])
def test_grids_cover_the_whole_domain(range_max):
    support = Support(range_max=range_max)
    for grid in (speed_grid(support), range_grid(support)):
        assert grid.edges[2][0] == 0
        assert all(np.all(np.diff(edges) > 0) for edges in grid.edges)
    assert replace(speed_grid()).tensor.shape[0] == Basis(5, 35, 6).size


def test_a_share_that_is_rounded_to_one_keeps_its_logarithm():
    """The logit 40 leaves 4e-18 for the first kind; without its logit, this would be a division by zero."""
    parameters, z = np.array([40.0, 0.3]), np.array([0.0, 1.0, 60.0])
    with np.errstate(all="raise", under="ignore"):
        found = TwoKinds().log_density(z, parameters), TwoKinds().cumulative(z, parameters)
    second = np.exp(0.3)
    np.testing.assert_allclose(found[0], -0.3 - z / second, rtol=1e-12)
    np.testing.assert_allclose(found[1], z / second, rtol=1e-12, atol=1e-15)
    first = TwoKinds()._parts(z, parameters)[0]
    np.testing.assert_allclose(first, -40 - z, rtol=1e-12)
