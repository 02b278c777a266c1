"""The problems of public collections have the probabilities that are published for them."""

import sys
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

pytestmark = pytest.mark.studies
SAMPLERS = Path(__file__).parents[1] / "samplers"


@pytest.fixture(scope="module")
def public():
    sys.path.insert(0, str(SAMPLERS))
    import public_problems

    yield public_problems
    sys.path.remove(str(SAMPLERS))


# To the digits that are published. RP77 and RP111 are published 7 % too high and 5 % too low.
@pytest.mark.parametrize(
    "name", ["rp_22", "rp_25", "rp_28", "rp_33", "rp_53", "rp_75", "rp_110", "rp_54", "rp_63"]
)
def test_probabilities_are_the_published_ones(public, name):
    problem = public.public_problems()[name]
    probability, _ = public.probability_of(problem, np.random.default_rng(1))
    assert probability == pytest.approx(problem.published, rel=0.01)


@pytest.mark.parametrize(
    "name", ["rp_8", "rp_14", "rp_33", "rp_38", "rp_54", "rp_60", "rp_63", "rp_91", "linear_50"]
)
def test_probabilities_are_those_of_random_draws(public, name):
    problem = public.public_problems()[name]
    expected = problem.exact or problem.published
    z = np.random.default_rng(2).standard_normal((200_000, problem.event.dimension))
    happened, score = problem.event.evaluate(z)
    np.testing.assert_array_equal(happened, score <= 0)
    error = np.sqrt(expected / len(z)) + 0.005 * expected  # of the draws, and of three published digits
    assert abs(happened.mean() - expected) < 4 * error
    narrower = problem.event.evaluate(0.5 * z)[0]  # another law has another probability
    assert abs(narrower.mean() - expected) > 4 * error


def test_inputs_of_no_influence_leave_the_probability_as_it_is(public):
    z = np.random.default_rng(3).standard_normal((20_000, 20))
    for little in (0.0, 0.1):
        mixed = public.diluted(z, little)
        np.testing.assert_allclose(np.cov(mixed.T), np.eye(3), atol=0.05)
    np.testing.assert_array_equal(public.diluted(z, 0.0), z[:, :3])


@pytest.mark.parametrize("inputs", [20, 40])
def test_many_small_influences_have_the_probability_of_weighted_draws(public, inputs):
    """The draws are about the nearest point of the plane that the boundary would be without curvature."""
    problem = public.public_problems()[f"many_small_{inputs}"]
    influence, curvature = public.many_small(inputs)
    centre = 4.5 * influence
    z = centre + np.random.default_rng(4).standard_normal((400_000, inputs))
    weight = np.exp(centre @ centre / 2 - z @ centre) * problem.event.evaluate(z)[0]
    error = weight.std() / np.sqrt(len(z))
    assert abs(weight.mean() - problem.exact) < 4 * error
    flat = public.tail_of_squares(4.5, influence, 0 * curvature)
    assert flat == pytest.approx(stats.norm.sf(4.5), rel=1e-6)
    for wrong in (flat, public.tail_of_squares(4.4, influence, curvature)):
        assert abs(weight.mean() - wrong) > 10 * error
