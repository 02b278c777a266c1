"""The limits of a predicted count against exact Poisson limits, and the map of severe braking."""

import numpy as np
import pytest
from accelerated_evaluation.answer.consequences.human_prediction import (
    SEVERE,
    VARIANTS,
    BrakingHuman,
    compared_with,
    predictive_limits,
    updated_weights,
)
from accelerated_evaluation.answer.consequences.in_service import resampled
from accelerated_evaluation.answer.ways.posterior import Posterior
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.vehicles.builtin.human import Human
from accelerated_evaluation.vehicles.protocol import CRASH, RandomVehicle
from scipy.stats import betaprime, norm, poisson


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


def test_counts_correct_the_draws_from_which_they_come():
    """The true draw is one of the draws, so an interval of 80 % contains its crashes in 80 % of trials."""
    generator = np.random.default_rng(4)
    covered, far = [], []
    for _ in range(600):
        drift, law = generator.random(4001), np.exp(generator.normal(0, 0.2, 4001))
        means = {"crash": law * 3 * np.exp(1.8 * drift), "near-crash": law * 33 * np.exp(drift)}
        counted = {event: generator.poisson(of[0]) for event, of in means.items()}
        for inside, distance in ((covered, 1.0), (far, 1.5)):
            weights = updated_weights({event: distance * of[1:] for event, of in means.items()}, counted)
            place = resampled(means["crash"][1:], weights)
            low, high = np.quantile(means["crash"][1:][place], (0.1, 0.9))
            inside.append(low <= means["crash"][0] <= high)
    error = np.sqrt(0.8 * 0.2 / 600)
    assert np.mean(covered) == pytest.approx(0.8, abs=3 * error)
    # With the wrong distance, the interval misses.
    assert np.mean(far) < 0.8 - 3 * error
    assert updated_weights({"crash": np.zeros(3)}, {"crash": 1}) is None


@pytest.mark.parametrize("count", [0, 25])
def test_a_car_is_compared_with_the_corrected_driver(count):
    """Gamma rates stay gamma distributed after counts, so that their ratio has a beta prime distribution."""
    generator, size, exposure = np.random.default_rng(5), 20_000, 4.0
    human, car = (
        generator.gamma(3.0, size=size),
        Posterior(generator.gamma(2.0, size=size), np.zeros(size, int)),
    )
    weights = updated_weights({"crash": exposure * human}, {"crash": count})
    found = compared_with(car, human, resampled(human, weights))
    after, before = (betaprime(2.0, 3.0 + n, scale=1 + e) for n, e in ((count, exposure), (0, 0)))
    assert found["safer"] == pytest.approx(after.cdf(1), abs=0.02)
    assert found["ratio"] == pytest.approx(after.median(), rel=0.05)
    assert found["ratio_high80"] == pytest.approx(after.ppf(0.9), rel=0.07)
    assert abs(after.cdf(1) - before.cdf(1)) > 0.1  # the driver without the counts would fail


def test_a_car_and_the_driver_keep_the_law_that_they_share():
    generator = np.random.default_rng(6)
    law, noise = np.exp(generator.normal(0, 2, 20_000)), np.exp(generator.normal(-0.5, 0.5, 20_000))
    place = resampled(law, updated_weights({"crash": 3 * law}, {"crash": 2}))
    car = Posterior(law * noise, np.zeros(law.size, int))
    assert compared_with(car, law, place)["safer"] == pytest.approx(norm.cdf(1.0), abs=0.02)
    apart = Posterior(generator.permutation(car.probabilities), car.member)
    assert abs(compared_with(apart, law, place)["safer"] - norm.cdf(1.0)) > 0.1
    assert np.isnan(compared_with(None, law, place)["safer"])
    # A second population after the first one, of which only draws were resampled.
    assert compared_with(car, np.append(0 * law, law), place + law.size) == compared_with(car, law, place)
