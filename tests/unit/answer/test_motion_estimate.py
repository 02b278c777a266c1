"""Crash probabilities with lead motion, against quadratures that do not use the estimator."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import map_crashes
from accelerated_evaluation.answer.consequences import moving_problem as module
from accelerated_evaluation.answer.consequences import opening_cut_ins as rounds
from accelerated_evaluation.answer.consequences.lead_motion import (
    MOTION,
    mirrored,
    motion_budget,
    motion_table,
)
from accelerated_evaluation.answer.consequences.moving_problem import Means, MovingProblem, moving_problems
from accelerated_evaluation.laws.motion import RAREST, STATES, STEP, draw_wide_inputs
from accelerated_evaluation.laws.motion.ngsim import Ngsim
from accelerated_evaluation.laws.smooth.conditional import SpeedLaw, range_grid, speed_grid
from accelerated_evaluation.laws.smooth.family import DistinctRecords
from accelerated_evaluation.laws.smooth.smooth_hazard import SmoothHazard
from accelerated_evaluation.vehicles.protocol import Outcomes
from builders import coarse_grid

TIME, MEAN, HARDEST, SHAPE = 2.0, 1.5, 4.0, 2.0  # [s], [m/s], [m/s^2]
SPEEDS = np.linspace(20.0, 34.9, 300)  # [m/s]: no lead vehicle stops within 2 s


@dataclass(frozen=True)
class Brakes:
    """A lead vehicle that brakes from the start, with a deceleration of HARDEST times its only input."""

    inputs = 1

    def lead_speeds(self, encounters, inputs):
        return np.maximum(encounters[0][:, None] - HARDEST * inputs * STEP * np.arange(STATES), 0.0)


class Coasts:
    """A host that keeps its speed for 2 s, and crashes if the range is gone by then.

    Given traits, a part of the drivers brakes at once and never crashes.
    """

    def __init__(self, careful=0.0):
        self.careful = careful

    def simulate(self, lead_speed, range_, closing_speed):
        return self._ended(range_, closing_speed * TIME)

    def simulate_moving(self, lead_speed, range_, closing_speed, lead_speeds):
        until = round(TIME / STEP)
        travelled = STEP * (lead_speeds[:, : until + 1].sum(axis=1) - lead_speeds[:, [0, until]].mean(axis=1))
        return self._ended(range_, (lead_speed + closing_speed) * TIME - travelled)

    def _ended(self, range_, approach):
        left = np.asarray(range_) - approach
        crash = left <= 0
        return Outcomes(crash, np.minimum(left, range_), np.where(crash, 0.01, 1.0), 1.0 * crash)


class Drivers(Coasts):
    """The same, but three drivers of four brake at once."""

    def draw_inner(self, size, generator):
        return (generator.random((size, 1)) < 0.25) * 1.0

    def inner_weights(self, inner, draws, generator):
        return np.ones((draws, len(inner)))

    def simulate_given(self, lead_speed, range_, closing_speed, inner):
        return super().simulate(lead_speed, np.where(inner[:, 0], range_, 1e6), closing_speed)

    def simulate_moving_given(self, lead_speed, range_, closing_speed, lead_speeds, inner):
        far = np.where(inner[:, 0], range_, 1e6)
        return super().simulate_moving(lead_speed, far, closing_speed, lead_speeds)


def constant_hazard(grid, rate):
    return SmoothHazard(grid, np.full(grid.tensor.shape, np.log(rate)))


@pytest.fixture(scope="module")
def records():
    range_ = 75 * np.linspace(0.05, 1, SPEEDS.size) ** (1 / SHAPE)
    return DistinctRecords(SPEEDS, range_, np.linspace(0.1, 6, SPEEDS.size))


@pytest.fixture(scope="module")
def opening():
    return DistinctRecords(SPEEDS, np.linspace(3, 30, SPEEDS.size), -np.linspace(0, 2, SPEEDS.size))


def problem(records, vehicle, seed=1):
    """A problem with P(C > c) = exp(-c / MEAN) and P(R < r) = (r / 75)^SHAPE."""
    grid = coarse_grid(speeds=(20.0, 34.91, 5), ranges=(75, 40), closing=(45.0, 200))
    crash_map = map_crashes(vehicle, grid, [], np.random.default_rng(seed))
    law = SpeedLaw(constant_hazard(speed_grid(), 1 / MEAN))
    return MovingProblem(vehicle, crash_map, records, constant_hazard(range_grid(), SHAPE), law)


def by_quadrature(places=None, weights=1.0):
    """P(C 2 s + HARDEST u (2 s)^2 / 2 >= R) by Gauss-Legendre rules in u and, unless given, R."""
    nodes, rule = (0.5 * each for each in np.polynomial.legendre.leggauss(400))
    if places is None:
        places, weights = 75 * (nodes + 0.5) ** (1 / SHAPE), rule
    needed = np.maximum(places[:, None] - HARDEST * (nodes + 0.5) * TIME**2 / 2, 0) / TIME
    return float(np.sum(weights * (np.exp(-needed / MEAN) @ rule)))


def truth_of(crash_map):
    """The same for the ranges of the lines of a map, each with its density over the density of lines."""
    share, width = 1 / (75 * crash_map.inverse_range), np.repeat(-np.diff(crash_map.cells.root), 2)
    density = SHAPE * share ** (SHAPE - 1) * 2 * np.sqrt(share) * width
    low, high = crash_map.cells.lead_speed.T
    shares = np.mean((low[:, None] <= SPEEDS) & (high[:, None] > SPEEDS), axis=1)
    return by_quadrature(1 / crash_map.inverse_range, np.repeat(shares / 2, 2) * density)


def by_quadrature_opening(recorded):
    """The share of motions in which the range is gone in 2 s, averaged over the recorded cut-ins."""
    least = (recorded.range_ - recorded.closing_speed * TIME) / (HARDEST * TIME**2 / 2)
    return float(np.clip(1 - least, 0, 1).mean())


@pytest.fixture(autouse=True, scope="module")
def fewer_draws():
    names, fewer = ((module, "PLACES"), (rounds, "ROUND"), (rounds, "PLAIN")), (400, 1000, 20_000)
    before = [getattr(*name) for name in names]
    for name, number in zip(names, fewer, strict=True):
        setattr(*name, number)
    yield
    for name, number in zip(names, before, strict=True):
        setattr(*name, number)


@pytest.fixture(scope="module")
def asked(records):
    return problem(records, Coasts())


@pytest.fixture(scope="module")
def replicates(asked):
    return [asked.closing(Brakes(), np.random.default_rng([2, seed])) for seed in range(60)]


def test_the_lines_of_the_map_have_the_probability(asked):
    assert truth_of(asked.crash_map) == pytest.approx(by_quadrature(), rel=0.03)


def mean_and_reach(found):
    """The mean of independent estimates, and its standard error."""
    return np.mean([each.moved for each in found]), np.sqrt(
        np.mean([each.errors[1] ** 2 for each in found]) / len(found)
    )


def test_the_estimate_is_exact_on_average(asked, replicates):
    truth = truth_of(asked.crash_map)
    mean, reach = mean_and_reach(replicates)
    assert reach < 0.015 * truth
    assert abs(mean - truth) < 3.5 * reach


def test_the_standard_error_is_the_spread_of_the_estimates(asked, replicates):
    spread = np.std([each.moved for each in replicates], ddof=1)
    assert mean_and_reach(replicates)[1] * np.sqrt(60) == pytest.approx(spread, rel=0.35)
    factors = np.array([each.factor() for each in replicates])
    assert np.sqrt(np.mean(factors[:, 1] ** 2)) == pytest.approx(factors[:, 0].std(ddof=1), rel=0.35)
    truth = truth_of(asked.crash_map)
    covered = [abs(each.moved - truth) < 1.645 * each.errors[1] for each in replicates]
    assert np.mean(covered) > 0.78


def test_estimates_of_several_laws_of_motion_are_those_of_each(asked):
    laws = [Ngsim(scale) for scale in (0.5, 1.0, 2.0)]
    together = asked.closing_with(laws, np.random.default_rng(12), 200)
    for law, found in zip(laws, together, strict=True):
        (alone,) = asked.closing_with([law], np.random.default_rng(12), 200)
        assert (found.still, found.moved, found.limit) == (alone.still, alone.moved, alone.limit)
        np.testing.assert_array_equal(found.covariance, alone.covariance)
    assert together[0].still == together[2].still
    assert together[0].moved < together[2].moved


def test_an_estimator_without_the_tail_of_the_closing_speed_is_noticed(asked, monkeypatch):
    monkeypatch.setattr(module, "STRATA", 2)
    monkeypatch.setattr(module.np, "inf", 1.0)
    mean, reach = mean_and_reach(
        [asked.closing(Brakes(), np.random.default_rng([3, seed])) for seed in range(20)]
    )
    assert abs(mean - truth_of(asked.crash_map)) > 5 * reach


def test_an_estimator_without_the_weights_of_the_motions_is_noticed(asked, opening, monkeypatch):
    monkeypatch.setattr(rounds, "wide_density", lambda inputs: np.ones(len(inputs)))
    mean, reach = mean_and_reach(
        [asked.opening(opening, Brakes(), np.random.default_rng([3, k])) for k in range(30)]
    )
    assert abs(mean - by_quadrature_opening(opening)) > 5 * reach


def test_drivers_keep_their_inner_variables(records, opening):
    asked = problem(records, Drivers())
    mean, _ = mean_and_reach([asked.closing(Brakes(), np.random.default_rng([4, seed])) for seed in range(8)])
    # The lines have drawn drivers: about 1300 lines with a quarter of the drivers.
    assert mean == pytest.approx(by_quadrature() / 4, rel=0.15)
    found = asked.opening(opening, Brakes(), np.random.default_rng(5))
    assert abs(found.moved - by_quadrature_opening(opening) / 4) < 3.5 * found.errors[1]


def test_opening_cut_ins_against_their_exact_shares(asked, opening):
    found = [asked.opening(opening, Brakes(), np.random.default_rng([6, seed])) for seed in range(10)]
    mean, reach = mean_and_reach(found)
    truth = by_quadrature_opening(opening)
    assert 0 < truth < 0.1
    assert reach < 0.02 * truth
    assert abs(mean - truth) < 3.5 * reach
    assert found[0].still == 0
    assert all(each.moved < each.limit < truth + 5 * each.errors[1] for each in found)


def test_mirrored_records_open_and_drive_forwards(records):
    slow = replace(records, lead_speed=np.full(SPEEDS.size, 2.0))
    assert mirrored(slow).closing_speed.tolist() == np.maximum(-records.closing_speed, -2.0).tolist()


def test_no_crash_has_a_limit_and_no_estimate(records):
    """The limit is that of the 20,000 cut-ins that are drawn without preference, in which none crashed."""
    never = replace(records, range_=np.full(SPEEDS.size, 60.0), closing_speed=np.zeros(SPEEDS.size))
    found = problem(records, Coasts()).opening(never, Brakes(), np.random.default_rng(7))
    assert np.isnan(found.moved)
    assert found.errors[1] == 0
    assert found.limit == pytest.approx(3 / 20_000)
    assert np.isnan(found.factor()[0])


def test_few_crashes_have_a_limit_and_no_estimate():
    """Four crashes among 1000 cut-ins are too few, five are not; the limit covers a crash that was missed."""
    few, enough = (np.array([np.zeros(1000), np.arange(1000) < count]) * 1.0 for count in (4, 5))
    found = Means.of(few, 2.0)
    assert np.isnan(found.moved)
    assert found.limit == pytest.approx((4 + 3 * 2) / 1000)
    assert Means.of(enough, 2.0).moved == pytest.approx(0.005)
    together = Means.of(enough, 2.0).together(found, 0.5)
    assert np.isnan(together.moved)  # a limit never enters a sum
    assert together.limit == pytest.approx(0.5 * (Means.of(enough, 2.0).limit + found.limit))


def rare_cut_ins(opening):
    return replace(opening, range_=np.linspace(7.6, 30, SPEEDS.size), closing_speed=np.zeros(SPEEDS.size))


@pytest.mark.parametrize("hardest", [1.0, 0.97])
def test_rare_crashes_are_estimated_without_bias(records, opening, hardest):
    """The mean of 60 replicates is exact, and their spread is the claimed error, also where rounds adapt."""
    rare = rare_cut_ins(opening)
    rare = replace(rare, range_=rare.range_ / hardest)
    asked, truth = problem(records, Coasts()), by_quadrature_opening(rare)
    found = [asked.opening(rare, Brakes(), np.random.default_rng([10, seed])) for seed in range(60)]
    mean, reach = mean_and_reach(found)
    assert 0 < truth < 1e-3
    assert reach < 0.05 * truth
    assert abs(mean - truth) < 3.5 * reach
    spread = np.std([each.moved for each in found])
    assert 0.6 < np.mean([each.errors[1] for each in found]) / spread < 1.6


def test_rounds_that_forget_how_they_were_concentrated_are_noticed(records, opening, monkeypatch):
    rare = rare_cut_ins(opening)
    monkeypatch.setattr(
        rounds.Concentrated, "density", lambda own, row, inputs: own.first.density(row, inputs)
    )
    asked, truth = problem(records, Coasts()), by_quadrature_opening(rare)
    mean, reach = mean_and_reach(
        [asked.opening(rare, Brakes(), np.random.default_rng([10, seed])) for seed in range(10)]
    )
    assert abs(mean - truth) > 5 * reach


def test_all_cut_ins_are_the_mean_of_both_kinds():
    closing = Means(0.2, 0.4, np.diag([1.0, 4.0]), 5.0)
    opening = Means(0.0, 0.1, np.diag([0.0, 1.0]), 2.0)
    found = closing.together(opening, 0.25)
    assert (found.still, found.moved, found.limit) == pytest.approx((0.15, 0.325, 4.25))
    assert found.errors[1] ** 2 == pytest.approx(0.75**2 * 4 + 0.25**2)


def test_wide_draws_have_the_moments_of_the_uniform_law():
    @dataclass(frozen=True)
    class Three:
        inputs = 3

    inputs, weights = draw_wide_inputs(Three(), 200_000, np.random.default_rng(8))
    for value in (np.ones(len(weights)), inputs[:, 0], inputs[:, 2] ** 2, (inputs[:, 1] < 3e-4) * 1e3):
        expected = (1.0, 0.5, 1 / 3, 0.3)
        close = min(expected, key=lambda each: abs(each - np.mean(weights * value)))
        assert abs(np.mean(weights * value) - close) < 4 * np.std(weights * value) / np.sqrt(len(weights))
    assert (inputs[:, 1] < 3e-4).mean() > 20 * 3e-4
    assert weights.max() <= 2
    assert RAREST < 3e-4


def test_the_line_of_the_budget_is_the_variance_over_the_scale():
    """For a factor whose logarithm is a parabola of the scale, against a sum over scales."""
    slope, bend, error = 0.5, 0.3, 0.02
    logs = slope * np.linspace(0, 1, 100_001) + bend * np.linspace(0, 1, 100_001) ** 2
    whole, half = np.exp(logs[-1]), np.exp(logs[50_000])
    row = {"vehicle": "car", "gap": "closing", "factor": whole, "factor_error": error * whole}
    moving = pd.DataFrame([row | {"factor_half": half}, row | {"gap": "all", "factor_half": 9.0}])
    found = motion_budget(moving, "car", np.exp(2.0))
    assert found["source"].tolist() == [MOTION]
    variance = logs.var() + error**2
    np.testing.assert_allclose(found["factor"], np.exp(np.sqrt(variance)), rtol=1e-4)
    np.testing.assert_allclose(found["variance_share"], variance / 4, rtol=1e-4)
    assert found["effect"].tolist() == [whole]
    assert motion_budget(moving, "another car", np.exp(2.0)).empty
    assert motion_budget(moving.assign(factor=np.nan), "car", np.exp(2.0)).empty


def study_of(records, asked, draws=500):
    """Return what the estimate of lead motion reads of a study of laws: one law in all draws."""
    family = SimpleNamespace(ranges=asked.ranges, law=lambda member: asked.law)
    smooth = SimpleNamespace(records=records, family=family, speeds=lambda name: asked.law)
    return SimpleNamespace(smooth=smooth, heaviest=None, weights=np.ones((draws, 1)))


def test_the_table_has_the_recorded_opening_cut_ins_or_mirrored_ones(records, asked, opening):
    """Opening cut-ins count with their recorded share; vehicles without lead motion are left out."""
    study = study_of(records, asked)

    class Still:
        def simulate(self, *encounters):
            return Coasts().simulate(*encounters)

    vehicles, maps = {"car": Coasts(), "still": Still()}, {"car": asked.crash_map, "still": asked.crash_map}
    shares = {}
    for kind, recorded in {
        "own": opening,
        "few": opening.only(np.arange(29)),
        "none": opening.only(np.arange(0)),
    }.items():
        problems = moving_problems(vehicles, maps, study)
        table = motion_table(problems, recorded, np.random.default_rng(9)).set_index("gap")
        assert set(table["vehicle"]) == {"car"}
        shares[kind] = table.loc["opening", "cut_ins"]
        both = shares[kind] * table.loc["opening", "moving"]
        both += (1 - shares[kind]) * table.loc["closing", "moving"]
        assert table.loc["all", "moving"] == pytest.approx(both, nan_ok=True)
        factors = table.loc["closing", ["factor", "factor_error", "factor_half"]].astype(float)
        assert np.isfinite(factors).all()
        if kind == "own":
            stronger = [Ngsim(scale) for scale in (1.0, 2.0, 3.0)]
            other = motion_table(problems, recorded, np.random.default_rng(9), Ngsim(), stronger)
            other = other.set_index("gap")
            assert other.loc["closing", "moving"] == table.loc["closing", "moving"]
            assert np.isnan(other.loc["closing", "factor_half"])
            assert other.loc["closing", "factor_error"] > 2 * factors["factor_error"]
    assert shares == {"own": 0.5, "few": pytest.approx(229_889 / 403_581), "none": shares["few"]}


@pytest.mark.parametrize("draws", [500, 250, 100])
def test_simulations_are_in_proportion_to_the_draws_of_the_law(records, asked, opening, draws):
    """The estimates stay right, which they would not if a number of simulations counted elsewhere, too."""
    simulated = []

    class Counted(Coasts):
        def simulate(self, lead_speed, range_, closing_speed):
            simulated.append(np.size(range_))
            return super().simulate(lead_speed, range_, closing_speed)

    study = study_of(records, asked, draws)
    of_study = moving_problems({"car": Counted()}, {"car": asked.crash_map}, study)["car"]
    closing = of_study.closing(Brakes(), np.random.default_rng([3, draws]))
    assert sum(simulated) == module.PLACES * module.STRATA * draws / 500
    assert closing.moved == pytest.approx(truth_of(asked.crash_map), abs=4 * closing.errors[1])
    simulated.clear()
    opens = of_study.opening(opening, Brakes(), np.random.default_rng([4, draws]))
    made, left = divmod(sum(simulated), rounds.ROUND * draws // 500)
    assert left == 0
    assert rounds.LEAST <= made <= rounds.MOST
    assert opens.moved == pytest.approx(by_quadrature_opening(opening), abs=4 * opens.errors[1])


def test_a_map_that_misses_crashes_of_the_records_gives_no_exact_probability(records, asked, opening):
    """The map of the car is also used for one that crashes in every tenth record in addition."""
    study = study_of(records, asked)

    class Stripes(Coasts):
        def simulate(self, lead_speed, range_, closing_speed):
            in_stripe = np.isin(lead_speed, SPEEDS[::10])
            return super().simulate(lead_speed, np.where(in_stripe, 1e-3, range_), closing_speed + 0.1)

    vehicles = {"car": Coasts(), "stripes": Stripes()}
    maps = dict.fromkeys(vehicles, asked.crash_map)
    problems = moving_problems(vehicles, maps, study)
    table = motion_table(problems, opening, np.random.default_rng(9)).set_index(["vehicle", "gap"])
    exact = asked.closing(Brakes(), np.random.default_rng(9)).still
    assert table.loc[("car", "closing"), "exact"] == pytest.approx(exact, rel=0.3)
    assert np.isnan(table.loc[("stripes", "closing"), "exact"])
    assert table.loc[("stripes", "closing"), "constant"] > 0
