"""Rates per kilometre and hour: a gamma rate times draws of a probability, against closed forms."""

import numpy as np
import pytest
from accelerated_evaluation.answer.consequences.rates import Rate, exposure_table
from accelerated_evaluation.answer.ways.posterior import Posterior
from scipy.stats import betaprime, gamma

LEVELS = (0.025, 0.1, 0.5, 0.9, 0.975)


@pytest.mark.parametrize("level", LEVELS)
def test_a_probability_that_is_known_gives_a_gamma_law(level):
    rate = Rate(40, 1_000.0)
    expected = 1e-3 * gamma.ppf(level, 40.5, scale=1e-3)
    assert rate.quantile(level, np.full(7, 1e-3)) == pytest.approx(expected, rel=1e-8)
    assert rate.mean(np.full(7, 1e-3)) == pytest.approx(1e-3 * 40.5e-3, rel=1e-12)


@pytest.mark.parametrize("level", LEVELS)
def test_the_product_of_gamma_and_inverse_gamma_is_beta_prime(level):
    """With p = 1 / Y, Y gamma, the product is a ratio of gammas; its quantiles stand for the draws."""
    shape, count, size = 6.0, 12, 20_000
    draws = 1 / gamma.ppf((np.arange(size) + 0.5) / size, shape)
    exact = betaprime.ppf(level, count + 0.5, shape)
    assert Rate(count, 1.0).quantile(level, draws) == pytest.approx(exact, rel=1e-3)
    # The rate alone, with the probability at its mean, is too narrow: what a careless product would be.
    wrong = draws.mean() * gamma.ppf(level, count + 0.5)
    assert level == 0.5 or wrong != pytest.approx(exact, rel=0.02)


def test_with_many_events_the_interval_is_that_of_the_probability():
    draws = np.random.default_rng(1).lognormal(-12, 0.6, 400)
    rate = Rate(10**9, 10**9 + 0.5)
    assert rate.quantile(0.9, draws) == pytest.approx(np.quantile(draws, 0.9), rel=0.05)


def test_zero_draws_are_rates_of_zero():
    draws = np.array([0.0, 0.0, 1e-6, 1e-6])
    assert Rate(100, 10.0).quantile(0.4, draws) == 0.0
    assert Rate(100, 10.0).quantile(0.75, draws) == pytest.approx(
        1e-6 * gamma.median(100.5, scale=0.1), rel=1e-8
    )
    assert Rate(100, 10.0).quantile(0.9, np.zeros(3)) == 0.0


def test_the_table_has_what_is_known():
    posterior = {"crash": Posterior(np.array([1e-6, 2e-6, 4e-6]), np.zeros(3, int))}
    assert exposure_table(posterior, 50, {"kilometres": None, "hours": None}).empty
    table = exposure_table(posterior, 50, {"kilometres": 200.0, "hours": 4.0}).set_index(["per", "event"])
    assert list(table.index) == [
        ("kilometre", "cut-in"),
        ("kilometre", "crash"),
        ("hour", "cut-in"),
        ("hour", "crash"),
    ]
    assert table.loc[("kilometre", "cut-in"), "mean"] == pytest.approx(50.5 / 200)
    assert (table["low80"] < table["median"]).all()
    assert (table["median"] < table["high80"]).all()
    # 50 km an hour: all rates of an hour are 50 times those of a kilometre.
    hour, kilometre = table.loc["hour"], table.loc["kilometre"]
    np.testing.assert_allclose(hour.to_numpy(float), 50 * kilometre.to_numpy(float), rtol=1e-8)
