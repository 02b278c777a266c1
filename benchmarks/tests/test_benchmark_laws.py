"""Laws from outside the family, which only a benchmark compares with it."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from accelerated_evaluation.laws.smooth.conditional import Places, SpeedLaw
from accelerated_evaluation.laws.smooth.family import DistinctRecords, Fitter, members_at
from accelerated_evaluation.laws.smooth.shapes import Exponential

sys.path.append(str(Path(__file__).resolve().parents[2] / "benchmarks" / "laws"))

from extremes import ConditionalExtremes
from regressions import REGRESSIONS, fit_regression

pytestmark = pytest.mark.studies
SIZE = 12_000
MEAN = 2.0  # [m/s], of the closing speeds that do not depend on lead speed and range
STEP = 1e-6


@pytest.fixture(scope="module")
def records():
    """Return closing speeds that are exponential, with a mean that is smooth in lead speed and range."""
    generator = np.random.default_rng(1)
    lead_speed, range_ = generator.uniform(5, 35, SIZE), 75 * generator.uniform(0.01, 1, SIZE) ** 0.5
    mean = 1 + 0.02 * (35 - lead_speed) + 0.02 * range_
    return DistinctRecords(lead_speed, range_, mean * generator.standard_exponential(SIZE))


@pytest.mark.parametrize("regression", REGRESSIONS, ids=lambda regression: regression.name)
def test_regressions_have_the_density_and_the_derivatives_that_they_state(regression):
    c, scale, shape = np.array([0.5, 2.0, 6.0]), np.array([0.2, 0.9, 1.1]), np.array([0.1, 0.3, -0.2])
    numbers = np.array([scale, shape, *np.full((len(regression.shared), 3), 0.0)])
    numbers[2:] += np.array(regression.shared)[:, None]

    def terms(values):
        """Each record has shared numbers of its own here, so that a difference is that of one record."""
        return [regression.terms(c[[k]], *values[:2, [k]], values[2:, k]) for k in range(c.size)]

    def difference(name):
        steps = STEP * np.eye(len(numbers))[:, :, None]
        pairs = [(terms(numbers + step), terms(numbers - step)) for step in steps]
        return np.array(
            [
                [
                    (getattr(high, name) - getattr(low, name))[..., 0] / (2 * STEP)
                    for high, low in zip(*pair, strict=True)
                ]
                for pair in pairs
            ]
        )

    here = terms(numbers)
    survival = [regression.log_survival(c + sign * STEP, scale, shape, numbers[2:, 0]) for sign in (-1, 0, 1)]
    slope = (survival[0] - survival[2]) / (2 * STEP) * np.exp(survival[1])
    np.testing.assert_allclose(slope, np.exp([part.value[0] for part in here]), rtol=1e-5)
    gradient = np.array([part.gradient[:, 0] for part in here])
    np.testing.assert_allclose(gradient.T, difference("value"), atol=1e-6)
    hessian = np.array([part.hessian[..., 0] for part in here])
    np.testing.assert_allclose(hessian.transpose(1, 0, 2), difference("gradient"), atol=1e-6)


@pytest.mark.parametrize("regression", REGRESSIONS, ids=lambda regression: regression.name)
def test_fits_of_a_regression_end_at_one_point_from_wherever_they_start(records, regression):
    """Where the steps end may not hang on the last digits of a processor."""
    fitted = fit_regression(regression, records)
    moved = replace(fitted, coefficients=fitted.coefficients + 0.01)
    again = fit_regression(regression, records, moved)
    np.testing.assert_allclose(again.shared, fitted.shared, atol=1e-6)
    places, c = records.places, records.closing_speed
    one, two = (fit.given(places).log_density(c) for fit in (fitted, again))
    assert two.sum() == pytest.approx(one.sum(), abs=1e-6)
    assert moved.given(places).log_density(c).sum() != pytest.approx(one.sum(), abs=1e-2)


def test_conditional_extremes_are_one_distribution_above_their_threshold():
    generator = np.random.default_rng(1)
    lead_speed, range_ = generator.uniform(5, 34.9, SIZE), 75 * generator.random(SIZE) ** 0.5
    records = DistinctRecords(lead_speed, range_, MEAN * generator.standard_exponential(SIZE))
    body = Fitter(records, members_at(())).fit().body
    law = ConditionalExtremes.fit(records, body, 0.9, Exponential())
    places = Places.of(np.array([10.0]), np.array([40.0]))
    given, start = law.given(places), np.array([law.threshold])
    assert given.cumulative(start + 1e-9) == pytest.approx(
        SpeedLaw(body).given(places).cumulative(start), rel=0.02
    )
    # Closing speeds do not depend on range or lead speed here, so the excess stays exponential.
    added = given.cumulative(start + 4.0) - given.cumulative(start)
    assert added[0] == pytest.approx(4.0 / MEAN, rel=0.25)
