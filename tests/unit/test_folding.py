"""Folding of a joint law: against the density of the law itself at both signs."""

import numpy as np
import pytest
from accelerated_evaluation import Box, InputError
from accelerated_evaluation.laws.joint.truncated import Normals
from accelerated_evaluation.laws.joint.truncated_normals import TruncatedNormalMixture

SIGN = np.array([1, -1, 1])


def law(lower=-7.0):
    mean = np.array([[5.0, 1.2, 20.0], [6.0, -1.5, 25.0]])
    covariance = np.array([[4.0, 0.8, 2.0], [0.8, 1.0, -1.0], [2.0, -1.0, 30.0]])
    box = Box(("v", "w", "r"), (0.0, lower, 5.0), (13.0, 7.0, 60.0))
    normals = Normals(mean, np.array([covariance, 2 * covariance]), box)
    return TruncatedNormalMixture(np.array([0.4, 0.6]), normals)


def test_the_density_is_the_sum_of_those_of_both_signs():
    x = np.abs(law().draw(500, np.random.default_rng(1)))
    found, plain = law().folded(1), law()
    both = np.logaddexp(plain.log_density(x), plain.log_density(x * SIGN))
    assert found.log_density(x) == pytest.approx(both, abs=1e-4)
    assert not np.allclose(found.log_density(x), plain.log_density(x), atol=1e-2)
    assert (found.log_density(x * SIGN) == -np.inf).all()


def test_the_samples_are_the_absolute_values():
    generator = np.random.default_rng(2)
    own, other = law().folded(1).draw(20_000, generator), np.abs(law().draw(20_000, generator))
    error = np.sqrt((own.var(axis=0) + other.var(axis=0)) / 20_000)
    assert (np.abs(own.mean(axis=0) - other.mean(axis=0)) < 4.5 * error).all()
    assert np.corrcoef(own.T) == pytest.approx(np.corrcoef(other.T), abs=0.05)


def test_limits_that_are_far_from_symmetric_are_refused():
    with pytest.raises(InputError, match="expected symmetric limits"):
        law(lower=-2.0).folded(1)
