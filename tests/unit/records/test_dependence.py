"""Methods and exact values before a law with dependence: all must find what quadrature finds."""

import math
from dataclasses import replace

import numpy as np
import pytest
from accelerated_evaluation import CUT_IN, Problem, Stopping, map_crashes
from accelerated_evaluation.crash_map.exact import ALL, exact_probabilities
from accelerated_evaluation.crash_map.exact_variance import exact_variation
from accelerated_evaluation.laws import Factors
from accelerated_evaluation.laws.distributions import BoundedExponential
from accelerated_evaluation.methods import METHODS
from accelerated_evaluation.methods.cross_entropy.method import CrossEntropyMethod
from accelerated_evaluation.methods.importance_sampling import Sample
from accelerated_evaluation.study.configuration import load
from dependent_law import PIECES, UNIT, crash_probability, dependent_law
from wall_car import GRID, WallCar

CAR = WallCar()
EDGES = CAR.first, *CAR.hole
LAW = dependent_law()
IN_PIECES = dependent_law(Factors(PIECES, PIECES))  # the same law
CONFIG = load()
PAPERS = [name for name, method in METHODS.items() if issubclass(method, CrossEntropyMethod)]
STEP = {"truncation_shift": {"inverse_range": 0.2, "inverse_ttc": 1.0}}  # of the scores


def truths(edges=EDGES):
    found = {name: crash_probability(stratum, edges) for name, stratum in LAW.strata.items()}
    return found | {ALL: sum(share * found[name] for name, share in LAW.shares.items())}


def configured(method):
    return METHODS[method].configured(CONFIG | {"cross_entropy": CONFIG["cross_entropy"] | STEP})


@pytest.fixture(scope="module")
def crash_map():
    return map_crashes(CAR, replace(GRID, lead_speed_cells=16), [], np.random.default_rng(1))


def test_crude_monte_carlo_finds_the_probability():
    size = 400_000
    happened, _ = Problem(CUT_IN, CAR, law=LAW).evaluate(np.random.default_rng(1).standard_normal((size, 3)))
    truth = truths()[ALL]
    error = math.sqrt(truth / size)
    assert 1e-4 < truth < 1e-2
    assert abs(happened.mean() - truth) < 4 * error
    assert abs(happened.mean() - truths((11.0, 12.5, 12.8))[ALL]) > 4 * error  # crashes from 11 m/s on


@pytest.mark.parametrize("method", PAPERS)
@pytest.mark.parametrize("stratum", LAW.strata)
def test_the_search_finds_the_probability_of_each_stratum(method, stratum):
    problem, truth, size = Problem(CUT_IN, CAR, law=LAW), truths()[stratum], 20_000
    found = configured(method).search(problem, stratum, np.random.default_rng(1))
    sample = Sample.of(problem, stratum, found.proposal, np.random.default_rng(2), size)
    error = sample.weight.std() / math.sqrt(size)
    assert sample.happened.mean() > 0.05
    assert sample.happened.mean() > 20 * truth
    assert abs(sample.weight.mean() - truth) < 4 * error
    assert error < 0.05 * truth


@pytest.mark.parametrize(
    "f_star",
    [
        Factors(UNIT, UNIT),
        Factors(BoundedExponential(1.7), BoundedExponential(0.2)),
        Factors(PIECES.accelerated((-1.0, 0.3), (0.3, 0.7)), PIECES.accelerated((1.5, 0.8), (0.2, 0.8))),
    ],
    ids=["f", "single", "piecewise"],
)
@pytest.mark.parametrize("stratum", LAW.strata)
def test_likelihood_ratios_average_to_one(f_star, stratum):
    """The Jacobian of the map from scores to cut-ins cancels, in whatever variables the ratio is taken."""
    size = 20_000
    log_ratio = Sample.of(
        Problem(CUT_IN, CAR, law=LAW), stratum, f_star, np.random.default_rng(3), size
    ).log_ratio
    ratio = np.exp(log_ratio)
    assert ratio.mean() == pytest.approx(1, abs=4 * ratio.std() / math.sqrt(size) + 1e-14)
    assert ratio.std() < 10
    if f_star != Factors(UNIT, UNIT):
        half = np.exp(0.5 * log_ratio)  # a wrong ratio
        assert abs(half.mean() - 1) > 4 * half.std() / math.sqrt(size)


@pytest.mark.parametrize("method", PAPERS)
def test_estimates_of_all_strata_cover(method):
    stopping = Stopping(alpha=0.01, beta=0.1, minimum_events=200, maximum_simulations=200_000)
    estimate = configured(method).estimate(Problem(CUT_IN, CAR, law=LAW), stopping, np.random.default_rng(4))
    assert estimate.converged
    assert estimate.covers(truths()[ALL])
    assert not estimate.covers(1.5 * truths()[ALL])


def test_exact_probabilities_are_those_of_quadrature(crash_map):
    found, truth = exact_probabilities(crash_map, LAW), truths()
    for name, value in found.items():
        # Beside the random error that of cells of finite width, in which all factors vary.
        assert abs(value.probability / truth[name] - 1) < 4 * value.standard_error / truth[name] + 3e-3
        assert value.standard_error < 1e-2 * truth[name]
    in_pieces = exact_probabilities(crash_map, IN_PIECES)[ALL].probability
    assert in_pieces == pytest.approx(found[ALL].probability, rel=1e-9)
    without_hole = truths((12.0, 99.0, 99.0))[ALL]
    assert abs(found[ALL].probability / without_hole - 1) > 3e-2


def test_a_cap_gathers_all_beyond_it(crash_map):
    """At 12.1 m/s the car crashes, so that all that is faster than 12 m/s does."""
    truth = truths((12.0, 99.0, 99.0))
    for name, value in exact_probabilities(crash_map, dependent_law(cap=12.1)).items():
        assert abs(value.probability / truth[name] - 1) < 4 * value.standard_error / truth[name] + 3e-3
    capped = Problem(CUT_IN, CAR, law=dependent_law(cap=12.1))
    happened, _ = capped.evaluate(np.random.default_rng(6).standard_normal((400_000, 3)))
    assert abs(happened.mean() - truth[ALL]) < 4 * math.sqrt(truth[ALL] / 400_000)


@pytest.mark.parametrize("stratum", LAW.strata)
def test_exact_probabilities_of_one_stratum_are_those_among_all(crash_map, stratum):
    alone = exact_probabilities(crash_map, LAW.only(stratum))
    assert alone[ALL] == alone[stratum] == exact_probabilities(crash_map, LAW)[stratum]


def test_exact_variation_is_that_of_the_weights(crash_map):
    f_star = Factors(BoundedExponential(1.4), BoundedExponential(0.15))
    exact = exact_variation(crash_map, LAW, dict.fromkeys(LAW.strata, f_star))
    for k, name in enumerate(LAW.strata):
        weight = Sample.of(
            Problem(CUT_IN, CAR, law=LAW), name, f_star, np.random.default_rng(k), 400_000
        ).weight
        kurtosis = np.mean((weight - weight.mean()) ** 4) / weight.var() ** 2
        ratio = exact[name][0] ** 2 / (weight.var() / weight.mean() ** 2)
        # The relative error of a sample's variance is about sqrt((kurtosis - 1) / n).
        assert abs(ratio - 1) < 4 * math.sqrt((kurtosis - 1) / 400_000) + 0.02
        crude = exact_variation(crash_map, LAW, dict.fromkeys(LAW.strata, LAW.strata[name].factors))
        assert crude[name][0] == pytest.approx(math.sqrt(1 / truths()[name] - 1), rel=1e-2)
        assert crude[name][0] > 3 * exact[name][0]
