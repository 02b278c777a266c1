"""Intervals: closed forms, exact coverage, and a stopping rule that holds where the paper's does not."""

import math
from dataclasses import replace

import numpy as np
import pytest
from accelerated_evaluation.methods import Stopping
from accelerated_evaluation.methods.importance_sampling import first_converged, running
from accelerated_evaluation.methods.intervals import (
    Interval,
    Sums,
    binomial_interval,
    gamma_interval,
    normal_interval,
    sequential_estimate,
)
from scipy import stats

CRASH_SHARE = 0.1
STOPPING = Stopping(alpha=0.2, beta=0.2, minimum_events=10, maximum_simulations=20_000)


def skewed_weights(generator, size, spread=1.2):
    """Log-normal crash weights with mean 1, of a tenth of the simulations."""
    crash = generator.random(size) < CRASH_SHARE
    return np.where(crash, np.exp(spread * generator.standard_normal(size) - spread**2 / 2), 0.0)


def test_sums_of_two_samples_add_up():
    weights = skewed_weights(np.random.default_rng(1), 5000)
    joined, whole = Sums.of(weights[:1234]) + Sums.of(weights[1234:]), Sums.of(weights)
    assert (joined.simulations, joined.events, joined.largest) == (5000, whole.events, weights.max())
    assert joined.total == pytest.approx(weights.sum(), rel=1e-13)
    assert joined.squares == pytest.approx((weights**2).sum(), rel=1e-13)


@pytest.mark.parametrize("events", [0, 1])
def test_one_crash_has_no_normal_interval(events):
    interval = normal_interval(Sums.unweighted(1000, events), 0.2)
    assert (interval.low, interval.high) == (0, 1)


@pytest.mark.parametrize("events", [1, 2, 17, 400])
@pytest.mark.parametrize("weight", [1.0, 3e-6])
def test_gamma_interval_of_equal_weights_is_the_exact_poisson_interval(events, weight):
    weights = np.zeros(10_000)
    weights[:events] = weight
    interval = gamma_interval(Sums.of(weights), 0.05)
    low, high = stats.chi2.ppf(0.025, 2 * events) / 2, stats.chi2.ppf(0.975, 2 * events + 2) / 2
    assert interval.low == pytest.approx(low * weight / 10_000, rel=1e-10)
    assert interval.high == pytest.approx(high * weight / 10_000, rel=1e-10)


def test_gamma_interval_of_a_rare_event_is_that_of_clopper_and_pearson():
    gamma, exact = gamma_interval(Sums.unweighted(10**8, 55), 0.2), binomial_interval(55, 10**8, 0.2)
    # Binomial and Poisson differ by the order of the probability.
    assert gamma.low == pytest.approx(exact.low, rel=1e-5)
    assert gamma.high == pytest.approx(exact.high, rel=1e-5)


def test_gamma_interval_matches_mean_and_variance():
    weights = np.array([0.0, 0.1, 0.4, 0.0, 0.2])
    interval = gamma_interval(Sums.of(weights), 0.1)
    below = stats.gamma(49 / 21, scale=2.1 / 7)  # of sum 0.7 and sum of squares 0.21
    above = stats.gamma(121 / 37, scale=3.7 / 11)  # with one more of the largest weight 0.4
    assert interval.low == pytest.approx(below.ppf(0.05) / 5, rel=1e-12)
    assert interval.high == pytest.approx(above.ppf(0.95) / 5, rel=1e-12)


def test_a_known_bound_of_the_weights_widens_the_gamma_interval_upwards():
    sums = Sums.of(skewed_weights(np.random.default_rng(3), 2000))
    seen, bound = gamma_interval(sums, 0.2), gamma_interval(sums, 0.2, weight_bound=2 * sums.largest)
    assert seen.low == bound.low
    assert seen.high < bound.high


def test_without_a_crash_there_is_an_upper_bound_alone():
    nothing = Sums.of(np.zeros(1000))
    assert gamma_interval(nothing, 0.05).high == 1
    bound = gamma_interval(nothing, 0.05, weight_bound=0.2)
    assert (bound.low, bound.high) == (0, pytest.approx(-math.log(0.025) * 0.2 / 1000, rel=1e-12))
    exact = binomial_interval(0, 1000, 0.05)
    assert (exact.low, exact.high) == (0, pytest.approx(1 - 0.025 ** (1 / 1000), rel=1e-10))


@pytest.mark.parametrize(("events", "simulations"), [(1, 10), (3, 7), (45, 60_000_000), (10, 10)])
def test_binomial_interval_is_that_of_clopper_and_pearson(events, simulations):
    interval = binomial_interval(events, simulations, 0.2)
    low = stats.beta.ppf(0.1, events, simulations - events + 1)
    high = stats.beta.ppf(0.9, events + 1, simulations - events) if events < simulations else 1
    assert interval.low == pytest.approx(low, rel=1e-9)
    assert interval.high == pytest.approx(high, rel=1e-9)


def one_sided_without_an_event(events, simulations, alpha):
    """The wrong way: the side is chosen after the count is known."""
    interval = binomial_interval(events, simulations, alpha)
    return interval if events else Interval(0, 1 - alpha ** (1 / simulations))


@pytest.mark.parametrize("alpha", [0.2, 0.05])
def test_exact_coverage_of_crude_monte_carlo(alpha):
    """Summed over the binomial law, for 0.5 to 20 expected crashes."""
    n = 10**6
    rules = {
        "gamma": lambda k: gamma_interval(Sums.unweighted(n, k), alpha, weight_bound=1),
        "binomial": lambda k: binomial_interval(k, n, alpha),
        "flip-flop": lambda k: one_sided_without_an_event(k, n, alpha),
        "normal": lambda k: normal_interval(Sums.unweighted(n, k), alpha),
    }
    expected = np.geomspace(0.5, 20, 60)
    chance = stats.binom.pmf(np.arange(60), n, expected[:, None] / n)
    lowest = {}
    for name, rule in rules.items():
        low, high = np.array([(found.low, found.high) for found in map(rule, range(60))]).T * n
        lowest[name] = min((chance * ((low <= expected[:, None]) & (expected[:, None] <= high))).sum(axis=1))
    assert lowest["gamma"] >= 1 - alpha
    assert lowest["binomial"] >= 1 - alpha
    assert lowest["flip-flop"] < 1 - 1.15 * alpha
    assert lowest["normal"] < 1 - 1.15 * alpha


def coverage(interval_of_replicate, replicates=2000):
    generator = np.random.default_rng(4)
    intervals = [interval_of_replicate(generator) for _ in range(replicates)]
    held = np.mean([interval.low <= CRASH_SHARE <= interval.high for interval in intervals])
    return held, math.sqrt(0.8 * 0.2 / replicates)


def test_gamma_interval_holds_its_level_at_a_fixed_size_where_the_normal_one_does_not():
    def sums(generator):
        return Sums.of(skewed_weights(generator, 1000))

    gamma, error = coverage(lambda generator: gamma_interval(sums(generator), 0.2))
    normal, _ = coverage(lambda generator: normal_interval(sums(generator), 0.2))
    assert normal < 0.8 - 2 * error
    assert gamma > 0.8 + 2 * error


def test_the_rule_holds_its_level_where_the_papers_does_not_and_costs_less_than_a_fresh_sample():
    sizes = {"paper": [], "ours": []}

    def ours(generator):
        sums, _ = sequential_estimate(
            lambda size: Sums.of(skewed_weights(generator, size)), STOPPING, first=100
        )
        sizes["ours"].append(sums.simulations)
        return gamma_interval(sums, 0.2)

    def papers(generator):
        weights = skewed_weights(generator, 6000)
        first = first_converged(running(weights, 0.2), STOPPING)
        sizes["paper"].append(first or weights.size)
        return normal_interval(Sums.of(weights[:first]), 0.2)

    (held, error), (held_papers, _) = coverage(ours), coverage(papers)
    assert held > 0.8 + 2 * error
    assert held_papers < 0.8 - 3 * error
    assert np.mean(sizes["ours"]) < 2 * np.mean(sizes["paper"])


def test_the_rule_looks_at_growing_sizes_and_stops_at_the_first_that_is_narrow():
    looks = []

    def draw(size):
        looks.append(size)
        return Sums.unweighted(size, size // 10)

    found, converged = sequential_estimate(
        draw, replace(STOPPING, maximum_simulations=10**6), first=100, growth=1.5
    )
    interval = gamma_interval(found, 0.2)
    sizes = np.cumsum(looks).tolist()
    assert sizes == [math.ceil(100 * 1.5**k) for k in range(len(sizes))]
    assert converged
    assert found == Sums.unweighted(sizes[-1], sum(size // 10 for size in looks))
    assert (interval.high - interval.low) / 2 <= 0.2 * found.probability
    one_look_less = Sums.unweighted(sizes[-2], sum(size // 10 for size in looks[:-1]))
    before = gamma_interval(one_look_less, 0.2)
    assert (before.high - before.low) / 2 > 0.2 * one_look_less.probability


def test_the_rule_waits_for_the_least_number_of_events():
    rule = replace(STOPPING, beta=0.5, minimum_events=80, maximum_simulations=10**6)
    found, converged = sequential_estimate(lambda size: Sums.unweighted(size, size // 10), rule)
    assert converged
    assert 80 <= found.events <= 90


def test_without_a_crash_the_rule_ends_at_the_largest_size():
    limits = replace(STOPPING, minimum_events=0, maximum_simulations=3000)
    found, converged = sequential_estimate(lambda size: Sums.of(np.zeros(size)), limits)
    assert (found.simulations, converged) == (3000, False)
    assert gamma_interval(found, 0.2) == (0, 1)


def test_a_known_bound_of_the_weights_makes_the_rule_go_on():
    """Every crash weighs 0.2; with a bound of 50 on the next one the interval is wide for longer."""

    def draw(size):
        crash = np.arange(size) % 10 == 0
        return Sums.of(np.where(crash, 0.2, 0.0))

    rule = replace(STOPPING, maximum_simulations=10**6)
    (seen, _), (bound, converged) = (
        sequential_estimate(draw, rule, weight_bound=weight) for weight in (None, 50.0)
    )
    assert converged
    assert bound.simulations > 2 * seen.simulations
    interval = gamma_interval(bound, 0.2, 50.0)
    assert (interval.high - interval.low) / 2 <= 0.2 * bound.probability
