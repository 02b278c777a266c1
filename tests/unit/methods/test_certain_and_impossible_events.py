"""Vehicles that never crash, always, or hardly ever: methods and their judges end with bounds and numbers."""

import dataclasses
import math

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import CUT_IN, Stopping, map_crashes
from accelerated_evaluation.crash_map.sensitivity import Levels, study_sensitivity
from accelerated_evaluation.crash_map.severity import impact_speed_table, severity_table
from accelerated_evaluation.crash_map.uncertainty import bootstrap_probabilities, uncertainty_budget
from accelerated_evaluation.laws.paper.piecewise import EXPONENTIAL
from accelerated_evaluation.methods import METHODS
from accelerated_evaluation.methods.coverage import coverage_of_replicates, coverage_replicates
from accelerated_evaluation.methods.cross_entropy.search import Proposals
from accelerated_evaluation.vehicles import Outcomes
from accelerated_evaluation.vehicles.protocol import CRASH, events_of
from builders import coarse_grid
from toy_segment import CONFIG, PAPERS, SETTINGS, F, before

RULE = Stopping(minimum_events=100, maximum_simulations=3000)


@dataclasses.dataclass(frozen=True)
class From:
    """Crashes from a TTC^-1 on: 0 always, infinity never."""

    inverse_ttc: float

    def simulate(self, lead_speed, range_, closing_speed):
        crash = closing_speed / range_ >= self.inverse_ttc
        zero = np.zeros(range_.size)
        return Outcomes(
            crash,
            np.where(crash, 0.0, range_),
            np.where(crash, 1e-3, range_ / np.maximum(closing_speed, 1e-9)),
            np.where(crash, closing_speed, zero),
        )


@dataclasses.dataclass(frozen=True)
class Blind(From):
    """As From, but neither its distance nor its time to collision ever says anything."""

    inverse_ttc: float = math.inf

    def simulate(self, lead_speed, range_, closing_speed):
        outcomes = super().simulate(lead_speed, range_, closing_speed)
        nothing = np.full(range_.size, np.inf)
        return dataclasses.replace(outcomes, min_range=nothing, min_ttc=nothing)


def method_of(name):
    sections = {
        "cross_entropy": CONFIG | {"sample_size": 300},
        "importance_sampling": SETTINGS["importance_sampling"] | {"simulations": 1500},
    }
    return METHODS[name].configured(SETTINGS | sections)


@pytest.mark.parametrize("name", PAPERS)
@pytest.mark.parametrize("vehicle", [From(math.inf), Blind(), From(0.0), From(0.005), From(2.6)])
def test_searches_estimates_and_coverage_of_extreme_vehicles(name, vehicle):
    problem, method = before(vehicle), method_of(name)
    truth = float(F.second.sf(vehicle.inverse_ttc))
    search = method.search(problem, "all", np.random.default_rng(1))
    assert bool(search.unfinished) == (truth == 0)
    proposals = Proposals.of({"all": search})
    estimate = method.estimate(problem, RULE, np.random.default_rng(2), proposals)
    assert estimate.low <= min(estimate.probability, 1) <= estimate.high <= 1  # a mean weight may exceed 1
    if truth == 0:
        assert estimate.probability == estimate.low == 0 < estimate.high
        assert not estimate.converged
    else:
        assert estimate.probability == pytest.approx(truth, rel=0.6)
    replicates = coverage_replicates(
        name,
        problem,
        [proposals.factors],
        truth,
        lambda *_: np.random.default_rng(3),
        RULE,
        {"pilot": 500, "replicates": 2},
    )
    table = coverage_of_replicates(replicates, truth)
    assert len(table) == 4
    assert table["bias"].isna().all() == (truth == 0)


def test_a_search_that_uses_up_all_simulations_leaves_nothing_known():
    estimate = method_of("piecewise").estimate(
        before(From(0.05)), Stopping(maximum_simulations=10), np.random.default_rng(1)
    )
    assert estimate.learning >= 10
    assert (estimate.estimating, estimate.events, estimate.converged) == (0, 0, False)
    assert math.isnan(estimate.probability)
    assert (estimate.low, estimate.high) == (0, 1)


def test_the_surrogate_without_an_event_and_with_events_alone():
    def estimate(vehicle):
        sampler = METHODS["surrogate"](batch_size=10)
        return sampler.estimate(before(vehicle), Stopping(maximum_simulations=60), np.random.default_rng(1))

    never, always = estimate(From(math.inf)), estimate(From(0.0))
    assert (never.probability, always.probability) == (0, 1)
    assert never.low == 0 < never.high < 1
    assert 0 < always.low < always.high == 1


@pytest.mark.parametrize("probability", [0.0, 5e-324, 1e-25, 1e-12, 0.5, 1.0, 1 + 1e-12])
def test_crude_monte_carlo_of_any_probability(probability):
    rows = coverage_replicates(
        "crude",
        None,
        [],
        probability,
        lambda *_: np.random.default_rng(1),
        Stopping(minimum_events=100),
        {"replicates": 20},
    )
    assert (rows["simulations"] > 0).all()
    table = coverage_of_replicates(rows, probability).set_index("stopping")
    if 1e-15 < probability < 1:
        assert table.loc["sequential_gamma", "bias"] == pytest.approx(0, abs=0.15)
        assert table.loc["fixed", "simulations_mean"] == pytest.approx(
            41.06 / probability * (1 - probability), rel=0.03
        )
        assert (rows["events"] / (rows["simulations"] * probability)).between(0.3, 3).all()
    else:
        assert np.isfinite(table["coverage80"]).all()


@pytest.fixture(scope="module", params=[0.0, math.inf, 0.05], ids=["always", "never", "below the knot"])
def mapped(request):
    grid = coarse_grid(speeds=(19, 21, 4), ranges=(75, 8), closing=(30, 60))
    events = [CRASH, *events_of(CUT_IN, {"impact_speed": [0], "min_range": [1], "min_ttc": [1]})]
    return map_crashes(From(request.param), grid, events, np.random.default_rng(1))


def recorded(size=300):
    generator = np.random.default_rng(5)
    rows = {
        name: law.rvs(generator, size)
        for name, law in zip(("inverse_range", "inverse_ttc"), vars(F).values(), strict=True)
    }
    return pd.DataFrame({"lead_speed": np.full(size, 20.0), **rows, "segment": "19-21"})


def test_ground_truth_of_extreme_vehicles(mapped):
    law, rows = before(From(0.0)).law, recorded()
    severity = severity_table(mapped, law, 100)
    assert severity["probability"].between(0, 1).all()
    assert impact_speed_table(severity).empty  # one threshold is no distribution
    settings = {
        "inverse_ttc_knots": [0.9, 0.999],
        "inverse_range_knots": [0.8],
        "lead_speed_edges": [[19, 21], [19, 20.5, 21], [30, 40]],
        "outlier_rows": [],
    }
    with pytest.warns(UserWarning, match=r"segments of v_L, 30 40: no refit, because .* rows outside"):
        table = study_sensitivity(mapped, {"two_pieces": law}, "two_pieces", rows, settings)
    failed = table["probability"].isna()
    assert table.loc[failed, "value"].tolist() == ["19 20.5 21", "30 40"]
    refits = bootstrap_probabilities(
        mapped,
        rows,
        Levels.of(law),
        np.random.default_rng(1),
        closing_speed_max=30,
        replicates=4,
    )
    assert np.isfinite(refits).all()
    truth = severity["probability"].iloc[0]
    budget = uncertainty_budget(truth, refits, table.loc[~failed, "probability"], (1e-7, 2e-7), alpha=0.2)
    assert budget["variance_share"].isna().any() == (truth == 0)


def test_refits_that_fail_are_told_and_do_not_end_the_bootstrap(mapped):
    rows = recorded(60)
    rows["inverse_ttc"] = np.where(np.arange(60) < 54, 0.05, np.linspace(0.06, 0.2, 60))
    with pytest.warns(UserWarning, match=r"bootstrap, refit \d+: no refit, because"):
        refits = bootstrap_probabilities(
            mapped,
            rows,
            dataclasses.replace(Levels.of(before(From(0.0)).law), body=EXPONENTIAL),
            np.random.default_rng(1),
            closing_speed_max=30,
            replicates=300,
        )
    assert 0 < np.isnan(refits).sum() < 300
    budget = uncertainty_budget(0.5, refits, [0.4, 0.5], (1e-7, 2e-7), alpha=0.2)
    assert budget.notna().all(axis=None)


@pytest.mark.parametrize("batch_size", [1, 5])
@pytest.mark.parametrize(("inverse_ttc", "probability"), [(0.0, 1.0), (np.inf, 0.0)])
def test_events_that_always_or_never_happen(batch_size, inverse_ttc, probability):
    """OpenTURNS issues 1405 and 1592: subset sampling fails for a probability of 1, or never ends."""
    sampler = METHODS["surrogate"](batch_size=batch_size)
    found = sampler.estimate(
        before(From(inverse_ttc)), Stopping(maximum_simulations=40), np.random.default_rng(1)
    )
    assert found.probability == probability
    assert found.low <= probability <= found.high
    assert found.low < found.high
    assert found.simulations <= 40


class Fenced(From):
    """A car that ends the run outside of the domain of its law."""

    def simulate(self, lead_speed, range_, closing_speed):
        inside = (
            (lead_speed == 20) & (range_ > 0) & (range_ <= 75) & (closing_speed >= 0) & (closing_speed <= 24)
        )
        if not inside.all():
            raise ValueError("outside of the domain")
        return super().simulate(lead_speed, range_, closing_speed)


@pytest.mark.parametrize("batch_size", [1, 5])
def test_no_input_outside_of_the_law_is_simulated(batch_size):
    """OpenTURNS issue 1405: importance sampling around a design point passes negative counts to the model."""
    sampler, problem = METHODS["surrogate"](batch_size=batch_size), before(Fenced(0.5), cap=24.0)
    found = sampler.estimate(problem, Stopping(maximum_simulations=80), np.random.default_rng(2))
    assert found.events > 0
