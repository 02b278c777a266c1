"""Exact probabilities against closed forms, importance sampling, and the benchmark's reference."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import CUT_IN, InputError, Problem, map_crashes
from accelerated_evaluation.crash_map.exact import ALL, capped_intervals, exact_probabilities, exact_table
from accelerated_evaluation.crash_map.intervals import Intervals
from accelerated_evaluation.laws import Factors
from accelerated_evaluation.laws.distributions import (
    BoundedExponential,
    BoundedNormal,
    Empirical,
    Mixture,
    PiecewiseMixture,
)
from accelerated_evaluation.laws.paper.models import IndependentLaw
from accelerated_evaluation.methods.importance_sampling import Sample
from accelerated_evaluation.vehicles import AccAeb, Outcomes
from accelerated_evaluation.vehicles.protocol import CRASH, events_of
from wall_car import GRID, RANGE_LAWS, TTC_LAWS, WallCar, integral, law_of

RECORDS = Path(__file__).resolve().parents[3] / "data" / "spmd" / "cut_ins.parquet"


def probability(car, range_law, ttc_law, grid=GRID, seed=1, cap=np.inf):
    crash_map = map_crashes(car, grid, [], np.random.default_rng(seed))
    return exact_probabilities(crash_map, law_of(range_law, ttc_law, cap=cap))[ALL]


@pytest.mark.parametrize("law", TTC_LAWS.values(), ids=TTC_LAWS.keys())
def test_interval_probability_keeps_its_digits_in_the_tail(law):
    start = np.array([0.0, 0.1, 0.2, 5.0, 20.0])
    for width in (1e-6, 0.05, np.inf):
        exact = law.sf(start) - law.sf(start + width)
        far = start > 0.166
        if width == 1e-6:
            density = np.exp(law.logpdf(start + width / 2)) * width
            np.testing.assert_allclose(law.interval_probability(start, start + width), density, rtol=1e-6)
        else:
            values = law.interval_probability(start, start + width)
            np.testing.assert_allclose(values[~far], exact[~far], rtol=1e-9)
            np.testing.assert_allclose(values[far], exact[far], rtol=1e-9, atol=0)


@pytest.mark.parametrize("ttc", TTC_LAWS)
@pytest.mark.parametrize("range_", RANGE_LAWS)
def test_probability_equals_the_integral(range_, ttc):
    car = WallCar()
    found = probability(car, RANGE_LAWS[range_], TTC_LAWS[ttc])
    exact = integral(RANGE_LAWS[range_], TTC_LAWS[ttc], (car.first, *car.hole))
    # Beside the random error that of cells of finite width, in which both factors vary.
    assert abs(found.probability / exact - 1) < 4 * found.standard_error / exact + 2e-3
    assert found.standard_error / exact < 1e-2


def test_blindness_to_holes_would_be_noticed():
    car = WallCar()
    laws = RANGE_LAWS["pieces"], TTC_LAWS["pieces"]
    exact = integral(*laws, (car.first, *car.hole))
    crash_map = map_crashes(car, GRID, [], np.random.default_rng(1))
    crash = crash_map.events[next(iter(crash_map.events))]
    keep = crash.end < np.inf
    blind = Intervals(crash.line[keep], crash.start[keep], np.full(keep.sum(), np.inf))
    blind_map = replace(crash_map, events={next(iter(crash_map.events)): blind})
    found = exact_probabilities(blind_map, law_of(*laws))[ALL]
    assert abs(found.probability / exact - 1) > 4 * found.standard_error / exact + 2e-3


def test_errors_fall_under_refinement():
    laws = RANGE_LAWS["pieces"], TTC_LAWS["pieces"]
    exact = integral(*laws, (12.0, 12.5, 12.8))
    coarse, fine = (
        np.array([probability(WallCar(), *laws, GRID.refined(factor), seed).probability for seed in range(4)])
        for factor in (0.25, 1.0)
    )
    error = [np.sqrt(np.mean((values / exact - 1) ** 2)) for values in (coarse, fine)]
    assert error[1] < error[0] / 4


def test_standard_error_is_the_spread_over_generators():
    laws, grid = (RANGE_LAWS["exponential"], TTC_LAWS["exponential"]), replace(GRID, refinement=1)
    found = [probability(WallCar(), *laws, grid, seed) for seed in range(40)]
    spread = np.std([value.probability for value in found], ddof=1)
    reported = np.sqrt(np.mean([value.standard_error**2 for value in found]))
    # The standard deviation of 40 normal values has a relative error of 1 / sqrt(78): 4 of them.
    assert abs(spread / reported - 1) < 4 / np.sqrt(78)


def test_shortest_ranges_do_not_fake_crashes():
    # Half a millimetre: a scan that began too fast would find crashes from no closing speed on.
    class TtcCar(WallCar):
        def simulate(self, lead_speed, range_, closing_speed):
            crash = closing_speed > 2 * range_
            return Outcomes(
                crash,
                np.where(crash, 0.0, range_ / 2),
                range_ / closing_speed,
                np.where(crash, closing_speed, 0.0),
            )

    for seed in range(5):
        grid = replace(GRID.refined(0.25), closing_speed_max=200)
        crash_map = map_crashes(TtcCar(), grid, [], np.random.default_rng(seed))
        assert 1.9 < crash_map.smallest_inverse_ttc() < 2.1


def test_cap_gathers_all_beyond_it():
    car = WallCar(first=12.0, hole=(99, 99))
    laws = RANGE_LAWS["exponential"], TTC_LAWS["exponential"]
    exact = integral(*laws, (12.0, 99.0, 99.0))
    by_the_map = probability(car, *laws, replace(GRID, closing_speed_max=12.1))
    assert by_the_map.probability == pytest.approx(exact, rel=5e-3)
    assert probability(car, *laws, cap=12.1).probability == pytest.approx(exact, rel=5e-3)
    assert probability(car, *laws, replace(GRID, closing_speed_max=11.9)).probability == 0
    assert probability(car, *laws, cap=11.9).probability == 0


@pytest.mark.parametrize("ttc", TTC_LAWS)
def test_a_cap_of_the_law_equals_a_map_that_ends_there(ttc):
    """The hole from 12.5 m/s lies above the cap, at which the car crashes: it must not be seen any more."""
    laws = RANGE_LAWS["pieces"], TTC_LAWS[ttc]
    law = law_of(*laws, cap=12.1)
    high, low = (
        map_crashes(WallCar(), replace(GRID, closing_speed_max=top), [], np.random.default_rng(1))
        for top in (60.0, 12.1)
    )
    found, same = exact_probabilities(high, law)[ALL], exact_probabilities(low, law)[ALL]
    error = np.hypot(found.standard_error, same.standard_error)
    assert abs(found.probability - same.probability) < 4 * error + 2e-3 * same.probability
    exact = integral(*laws, (12.0, 99.0, 99.0))
    assert abs(found.probability / exact - 1) < 4 * found.standard_error / exact + 2e-3
    uncapped = exact_probabilities(high, replace(law, closing_speed_max=np.inf))[ALL]
    assert abs(uncapped.probability - same.probability) > 20 * error + 2e-3 * same.probability


def test_capped_intervals_by_hand():
    """On line 0 [2, 5) and [7, top]; on line 1 [6, 6.5): each cap cuts another one of them."""
    crash_map = map_crashes(WallCar(), GRID.refined(0.25), [], np.random.default_rng(1))
    ends = np.array([2.0, 7.0, 6.0]), np.array([5.0, np.inf, 6.5])
    crash_map = replace(crash_map, events={CRASH: Intervals(np.array([0, 0, 1]), *ends)})
    for cap, expected in {
        1.0: [],
        2.0: [(0, 2, np.inf)],  # all faster ones are simulated at 2 m/s, where the crash begins
        5.0: [(0, 2, 5)],
        6.0: [(0, 2, 5), (1, 6, np.inf)],
        6.5: [(0, 2, 5), (1, 6, 6.5)],
        7.0: [(0, 2, 5), (0, 7, np.inf), (1, 6, 6.5)],
        60.0: [(0, 2, 5), (0, 7, np.inf), (1, 6, 6.5)],
        np.inf: [(0, 2, 5), (0, 7, np.inf), (1, 6, 6.5)],
    }.items():
        assert list(zip(*capped_intervals(crash_map, CRASH, cap), strict=True)) == expected, cap


def test_a_cap_above_the_top_of_the_map_is_refused():
    crash_map = map_crashes(WallCar(), GRID.refined(0.25), [], np.random.default_rng(1))
    laws = RANGE_LAWS["exponential"], TTC_LAWS["exponential"]
    with pytest.raises(
        InputError, match=r"closing speed of the law: seen up to the cap of 60\.1 m/s.* 60 m/s"
    ):
        exact_probabilities(crash_map, law_of(*laws, cap=60.1))
    assert exact_probabilities(crash_map, law_of(*laws, cap=60.0))[ALL].probability > 0


def test_agrees_with_importance_sampling():
    laws = RANGE_LAWS["pieces"], TTC_LAWS["pieces"]
    grid, law = replace(GRID, closing_speed_max=23.49, lead_speed_cells=20, range_cells=60), law_of(*laws)
    capped = replace(law, closing_speed_max=23.49)
    events = [CRASH, *events_of(CUT_IN, {"min_ttc": [1.0], "min_range": [2.0]})]
    crash_map = map_crashes(AccAeb(), grid, events, np.random.default_rng(1))
    found = exact_probabilities(crash_map, capped)[ALL]
    assert exact_probabilities(crash_map, law)[ALL] == found  # the map ends at the cap
    problem = Problem(CUT_IN, AccAeb(), law=capped)
    proposal = Factors(laws[0], BoundedExponential(8.0, 0.5))
    weights = Sample.of(problem, "5-15", proposal, np.random.default_rng(2), 400_000).weight
    error = np.hypot(weights.std() / np.sqrt(weights.size), found.standard_error)
    assert abs(weights.mean() - found.probability) < 4 * error
    assert error / found.probability < 0.02
    crude = Sample.of(problem, "5-15", Factors(*laws), np.random.default_rng(4), 1_000_000).outcomes
    events = list(crash_map.events)[1:]
    for event in events:
        value = exact_probabilities(crash_map, capped, event)[ALL]
        mean = event.happens(crude).mean()
        assert abs(mean - value.probability) < 4 * np.hypot(np.sqrt(mean / 1e6), value.standard_error)


def test_all_is_the_mean_of_the_segments():
    drawn = np.random.default_rng(5).uniform(5, 15, 3000)
    speeds = {"slow": Empirical(drawn[drawn < 10]), "fast": Empirical(drawn[drawn >= 10])}
    laws = {"slow": BoundedExponential(21.0), "fast": BoundedExponential(30.0)}
    two = IndependentLaw("two", {"slow": 1000, "fast": 3000}, RANGE_LAWS["exponential"], laws, speeds)
    crash_map = map_crashes(AccAeb(), replace(GRID, closing_speed_max=23.49), [], np.random.default_rng(1))
    found = exact_probabilities(crash_map, two)
    mean = 0.25 * found["slow"].probability + 0.75 * found["fast"].probability
    assert found[ALL].probability == pytest.approx(mean, rel=1e-12)
    listed = exact_table({"full": crash_map}, {"two": two})
    assert list(listed["segment"]) == ["slow", "fast", ALL]


@pytest.mark.parametrize(
    ("speeds", "law", "where"),
    [
        (np.array([4.9, 6.0]), RANGE_LAWS["exponential"], "v_L"),
        (np.array([6.0, 15.0]), RANGE_LAWS["exponential"], "v_L"),
        (np.array([6.0, 7.0]), BoundedExponential(50.0, 0.01), "range of the law: seen up to 100 m"),
    ],
)
def test_models_beyond_the_map_are_refused(speeds, law, where):
    crash_map = map_crashes(WallCar(), replace(GRID, refinement=1), [], np.random.default_rng(1))
    with pytest.raises(InputError, match=where):
        exact_probabilities(crash_map, law_of(law, TTC_LAWS["exponential"], Empirical(speeds)))


def piece(content):
    upper = content["upper"] or np.inf
    if "rate" in content:
        return BoundedExponential(content["rate"], content["lower"], upper)
    normals = [BoundedNormal(sd, content["lower"], upper) for sd in content["standard_deviations"]]
    return Mixture(content["mixture_weights"], normals)


def test_benchmark(stored):
    content = stored("benchmark_problem.json")
    laws = [
        PiecewiseMixture([p["weight"] for p in content[name]["pieces"]], map(piece, content[name]["pieces"]))
        for name in ("inverse_range", "inverse_ttc")
    ]
    speeds = pd.read_parquet(RECORDS)["lead_speed"].to_numpy()
    grid = replace(
        GRID,
        lead_speed_cells=20,
        range_cells=100,
        refinement=16,
        closing_speed_max=23.49,
        closing_speed_points=240,
    )
    crash_map = map_crashes(AccAeb(), grid, [], np.random.default_rng(1))
    law = law_of(*laws, Empirical(speeds[(speeds >= 5) & (speeds < 15)]), cap=23.49)
    found = exact_probabilities(crash_map, law)[ALL]
    assert found.standard_error < 1.5e-3 * content["reference_probability"]
    error = np.hypot(found.standard_error, content["reference_standard_error"])
    assert abs(found.probability - content["reference_probability"]) < 4 * error
