"""The limits of a predicted count against exact Poisson limits, and the map of severe braking."""

import numpy as np
import pytest
from accelerated_evaluation.answer.human_prediction import SEVERE, VARIANTS, BrakingHuman, predictive_limits
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.vehicles.builtin.human import Human
from accelerated_evaluation.vehicles.protocol import CRASH, RandomVehicle
from scipy.stats import poisson


@pytest.mark.parametrize("mean", [0.02, 1.0, 17.0, 80.0])
def test_limits_of_a_known_mean_are_those_of_poisson(mean):
    low, high = predictive_limits(np.full(7, mean))
    assert (low, high) == tuple(poisson.ppf([0.05, 0.95], mean))


def test_limits_include_what_is_not_known_of_the_mean():
    means = np.exp(np.random.default_rng(1).normal(np.log(17), 0.7, 4000))
    low, high = predictive_limits(means)
    drawn = np.random.default_rng(2).poisson(np.repeat(means, 100))
    assert np.mean(drawn < low) <= 0.05 <= np.mean(drawn <= low) + 0.002
    assert np.mean(drawn > high) <= 0.05 <= np.mean(drawn >= high) + 0.002
    # The limits of a count with the mean of all draws are too narrow.
    narrow = poisson.ppf([0.05, 0.95], means.mean())
    assert low < narrow[0] < narrow[1] < high


def test_severe_braking_contains_every_crash_and_less_of_it_is_harder():
    human, generator = Human(), np.random.default_rng(3)
    braking = BrakingHuman(human)
    assert isinstance(braking, RandomVehicle)
    cut_ins = np.full(4000, 15.0), generator.uniform(3, 60, 4000), generator.uniform(0, 20, 4000)
    inner = human.draw_inner(4000, generator)
    outcomes = braking.simulate_given(*cut_ins, inner)
    np.testing.assert_array_equal(outcomes.crash, human.simulate_given(*cut_ins, inner).crash)
    severe = [CUT_IN.event("impact_speed", 9.81 * level).happens(outcomes) for level in SEVERE.values()]
    counts = [CRASH.happens(outcomes).sum(), *(flags.sum() for flags in severe[::-1])]
    assert counts == sorted(counts)
    assert 0 < counts[0] < counts[-1] < 4000
    for flags in severe:
        assert not (outcomes.crash & ~flags).any()
    _, largest = human.braking_given(*cut_ins, inner)
    np.testing.assert_array_equal(severe[1], outcomes.crash | (largest > 0.5 * 9.81))


def test_every_variant_is_a_driver():
    for parameters in VARIANTS.values():
        Human(**parameters)
