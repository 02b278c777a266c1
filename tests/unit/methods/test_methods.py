"""What every registered method must do: describe itself, and cover a known probability; and what must not."""

import dataclasses
import math
import re

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import CUT_IN, Problem, Stopping
from accelerated_evaluation.laws.distributions import BoundedExponential, Empirical, PiecewiseMixture
from accelerated_evaluation.laws.paper.models import IndependentLaw
from accelerated_evaluation.methods import METHODS, Estimate, Method, configured_stopping
from accelerated_evaluation.methods.cross_entropy.method import CrossEntropyMethod
from accelerated_evaluation.methods.importance_sampling import draw_weights, estimate_from_weights
from accelerated_evaluation.study.configuration import load
from accelerated_evaluation.vehicles import Outcomes
from fewruns import SystemProblem
from scipy.stats import binom

CONFIG = load()
STOPPING = Stopping(alpha=0.2, beta=0.3, minimum_events=50, maximum_simulations=200_000)
RUNS = 8
THRESHOLDS = 0.03, 0.4  # R^-1 [1/m] and TTC^-1 [1/s] of a crash


class Corner:
    """Crashes if and only if R^-1 and TTC^-1 both exceed their thresholds; nearer means less is missing."""

    deterministic = True

    def simulate(self, lead_speed, range_, closing_speed):
        values = 1 / range_, closing_speed / range_
        missing = np.max([limit - value for limit, value in zip(THRESHOLDS, values, strict=True)], axis=0)
        crash = missing <= 0
        nearest = np.maximum(missing, 0)
        return Outcomes(crash, np.where(crash, 0.0, range_), nearest, np.where(crash, closing_speed, 0.0))


LOWER, KNOT = 1 / 75, 0.04
LAW = IndependentLaw(
    "toy",
    {"slow": 3, "fast": 2},
    PiecewiseMixture([0.8, 0.2], [BoundedExponential(100.0, LOWER, KNOT), BoundedExponential(45.0, KNOT)]),
    {
        name: PiecewiseMixture(
            [0.95, 0.05], [BoundedExponential(10.0, 0.0, knot), BoundedExponential(rate, knot)]
        )
        for name, knot, rate in (("slow", 0.15, 20.0), ("fast", 0.1, 8.0))
    },
    {"slow": Empirical(np.linspace(5, 15, 50)), "fast": Empirical(np.linspace(15, 25, 50))},
)
PROBLEM = Problem(CUT_IN, Corner(), law=LAW)


def exact(law=LAW):
    """P of a crash: the product of two tails in each segment, from the definition of the pieces."""
    range_share = (math.exp(-100 * (0.03 - LOWER)) - math.exp(-100 * (KNOT - LOWER))) / -math.expm1(
        -100 * (KNOT - LOWER)
    )
    by_range = 0.8 * range_share + 0.2
    by_ttc = {"slow": 0.05 * math.exp(-20 * 0.25), "fast": 0.05 * math.exp(-8 * 0.3)}
    return by_range * sum(share * by_ttc[name] for name, share in law.shares.items())


def estimates(name, problem=PROBLEM, stopping=STOPPING, runs=RUNS):
    method = METHODS[name].configured(CONFIG)
    return [method.estimate(problem, stopping, np.random.default_rng((5, run))) for run in range(runs)]


def fits(found, probability):
    """Whether as many 80 % intervals hold a value as honest ones do in 999 of 1000 cases."""
    return sum(estimate.covers(probability) for estimate in found) >= binom.ppf(1e-3, len(found), 0.8)


@pytest.mark.parametrize("name", METHODS)
def test_every_method_describes_itself(name):
    method = METHODS[name]
    assert issubclass(method, Method)
    assert method.name == name
    assert method.style.keys() == {"color", "linestyle", "marker"}
    assert re.fullmatch("#[0-9a-f]{6}", method.style["color"])
    assert set(method.sections) <= set(CONFIG)
    read = method.configured({section: CONFIG[section] for section in method.sections})
    assert vars(read) == vars(method.configured(CONFIG))  # it reads no other section
    plan = {section: CONFIG[section] for section in method.plan}
    assert method.replicates(plan) == method.replicates(CONFIG) >= 0
    assert method.stopping(plan) == method.stopping(CONFIG)
    streams = {method.stream(scope, replicate) for scope in ("all", "slow") for replicate in (0, 1)}
    assert len(streams) == 4


def test_methods_can_be_told_apart():
    for key in ("color", "marker"):
        assert len({method.style[key] for method in METHODS.values()}) == len(METHODS)
    streams = {method.stream("all", 0) for method in METHODS.values()}
    assert len(streams) == len(METHODS)


@pytest.mark.parametrize("name", METHODS)
def test_every_method_covers_a_known_probability(name):
    truth, found = exact(), estimates(name)
    assert 5e-4 < truth < 5e-3
    assert fits(found, truth)
    assert not fits(found, 2 * truth)
    assert not fits(found, truth / 2)
    for estimate in found:
        check_shape(name, estimate)


def test_a_dishonest_method_would_be_noticed():
    """One forgets most of its interval, one the segments' shares, one the likelihood ratios."""
    single = METHODS["single"].configured(CONFIG)
    truth, honest = exact(), estimates("single", runs=30)
    assert fits(honest, truth)
    narrow = [
        dataclasses.replace(
            estimate,
            low=estimate.probability - (estimate.probability - estimate.low) / 4,
            high=estimate.probability + (estimate.high - estimate.probability) / 4,
        )
        for estimate in honest
    ]
    assert not fits(narrow, truth)
    other_shares = dataclasses.replace(LAW, counts={"slow": 1, "fast": 9})
    assert not fits(estimates("single", dataclasses.replace(PROBLEM, law=other_shares)), truth)
    found = {name: single.search(PROBLEM, name, np.random.default_rng(1)).proposal for name in LAW.strata}
    forgetful = [
        estimate_from_weights(
            (draw_weights(PROBLEM, found, np.random.default_rng(run), 3000) > 0).astype(float),
            STOPPING.alpha,
            converged=True,
        )
        for run in range(RUNS)
    ]
    assert not fits(forgetful, truth)


def check_shape(name, estimate):
    assert isinstance(estimate, Estimate)
    assert 0 <= estimate.low <= estimate.probability <= estimate.high <= 1
    assert estimate.alpha == STOPPING.alpha
    assert estimate.simulations == estimate.learning + estimate.estimating <= STOPPING.maximum_simulations
    assert 0 < estimate.events <= estimate.simulations
    assert set(estimate.tables) >= set(METHODS[name].tables)
    assert estimate.converged
    assert (estimate.high - estimate.low) / 2 <= STOPPING.beta * estimate.probability * (1 + 1e-9)
    assert estimate.learning >= 0
    if issubclass(METHODS[name], CrossEntropyMethod):
        assert 0 < estimate.learning < estimate.simulations
    row = estimate.row()
    assert all(np.isscalar(value) for value in row.values())
    assert pd.DataFrame([row]).shape == (1, len(row))


@pytest.mark.parametrize("name", METHODS)
def test_one_stratum_is_estimated_alone(name):
    alone = PROBLEM.only("fast")
    found = estimates(name, alone, runs=2)
    assert all(abs(math.log(estimate.probability / exact(alone.law))) < 0.5 for estimate in found)
    assert sum(estimate.covers(exact(alone.law)) for estimate in found) >= 1


@pytest.mark.parametrize("name", METHODS)
def test_the_generator_alone_decides(name):
    method, stopping = (
        METHODS[name].configured(CONFIG),
        dataclasses.replace(STOPPING, beta=0.5, minimum_events=20),
    )
    one, two, other = (
        method.estimate(PROBLEM, stopping, np.random.default_rng(seed)).row() for seed in (1, 1, 2)
    )
    assert one == two
    assert one != other


@pytest.mark.parametrize("name", METHODS)
def test_a_method_that_may_not_go_on_gives_what_it_has(name):
    """The search is not cut short, because half an f* is none; what is made after it is."""
    method = METHODS[name].configured(CONFIG)
    learning = method.estimate(PROBLEM, STOPPING, np.random.default_rng(1)).learning
    stopping = dataclasses.replace(STOPPING, beta=1e-3, maximum_simulations=learning + 200)
    estimate = method.estimate(PROBLEM, stopping, np.random.default_rng(1))
    assert not estimate.converged
    assert estimate.learning == learning
    assert estimate.simulations == stopping.maximum_simulations
    assert 0 <= estimate.low <= estimate.probability <= estimate.high <= 1


def test_crude_monte_carlo_needs_normal_scores_alone():
    system = SystemProblem(lambda z: (z[:, 0] + z[:, 1] > 2 * math.sqrt(2), None), 2)
    truth = 0.5 * math.erfc(2 / math.sqrt(2))
    found = estimates("crude", system, runs=40)
    assert fits(found, truth)
    assert not fits(found, 1.5 * truth)
    assert all(estimate.learning == 0 and estimate.converged for estimate in found)


def test_an_estimate_as_a_row():
    tables = {"course": pd.DataFrame({"x": [1]})}
    estimate = Estimate(1e-6, 8e-7, 1.2e-6, 0.2, 300, 4000, 170, True, {"largest_weight_share": 0.1}, tables)
    assert estimate.row() == {
        "probability": 1e-6,
        "ci_low": 8e-7,
        "ci_high": 1.2e-6,
        "learning": 300,
        "estimating": 4000,
        "events": 170,
        "converged": True,
        "largest_weight_share": 0.1,
    }
    assert [*estimate.row()][-1] == "largest_weight_share"
    assert estimate.simulations == 4300
    assert all(map(estimate.covers, (8e-7, 1e-6, 1.2e-6)))
    assert not any(map(estimate.covers, (7.9e-7, 1.3e-6)))
    plain = Estimate(0.0, 0.0, 1.0, 0.2, 0, 10, 0, False)
    assert (plain.diagnostics, plain.tables) == ({}, {})
    assert "largest_weight_share" not in plain.row()


def test_the_stopping_rule_of_the_configuration():
    section = CONFIG["importance_sampling"]
    stopping = configured_stopping(section)
    for name, value in vars(stopping).items():
        assert value == ({"anytime": False} | section)[name]
    with pytest.raises(KeyError):
        configured_stopping({"alpha": 0.2})
