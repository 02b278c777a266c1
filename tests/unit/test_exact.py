"""Exact probabilities against closed forms, importance sampling, and the benchmark's reference."""

import json
from dataclasses import dataclass, replace
from pathlib import Path

import mpmath
import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.distributions import (
    BoundedExponential,
    BoundedNormal,
    Empirical,
    Mixture,
    Pareto,
    PiecewiseMixture,
)
from accelerated_evaluation.distributions.lane_change_model import LaneChangeModel
from accelerated_evaluation.errors import InputError
from accelerated_evaluation.estimation.crash_map import Grid, Intervals
from accelerated_evaluation.estimation.exact import (
    ALL,
    exact_probabilities,
    exact_table,
    interval_probability,
)
from accelerated_evaluation.estimation.exact_variance import exact_variation, variation_table
from accelerated_evaluation.estimation.mapping import map_crashes
from accelerated_evaluation.estimation.severity import events_from, impact_speed_table, severity_table
from accelerated_evaluation.sampling.cut_in import CutIn, Proposal
from accelerated_evaluation.vehicles import AccAeb, Outcomes

BENCHMARK = Path(__file__).resolve().parents[2] / ".." / "shared/data/benchmark/segment_5_15.json"
SPMD = Path(__file__).resolve().parents[2] / ".." / "shared/data/spmd/lane_changes.mat"
GRID = Grid(
    lead_speed_min=5,
    lead_speed_max=15,
    range_max=75,
    lead_speed_cells=8,
    range_cells=40,
    refinement=4,
    closing_speed_max=60,
    closing_speed_points=160,
)
LOWER = 1 / 75
RANGE_LAWS = {
    "exponential": BoundedExponential(50.0, LOWER),
    "pieces": PiecewiseMixture(
        [0.8, 0.2], [BoundedExponential(107.0, LOWER, 0.0374), BoundedExponential(42.7, 0.0374)]
    ),
    "pareto": Pareto(1.73, LOWER),
}
TTC_LAWS = {
    "exponential": BoundedExponential(21.0),
    "pieces": PiecewiseMixture(
        [0.95, 0.05],
        [
            Mixture([0.3, 0.7], [BoundedNormal(0.04, 0.0, 0.166), BoundedNormal(0.09, 0.0, 0.166)]),
            BoundedExponential(21.0, 0.166),
        ],
    ),
}


@dataclass
class WallCar:
    """Crashes from ``first`` m/s of closing speed on, but not in the hole."""

    first: float = 12.0
    hole: tuple[float, float] = (12.5, 12.8)

    def simulate(self, lead_speed, range_, closing_speed):
        crash = (closing_speed >= self.first) & ~(
            (closing_speed >= self.hole[0]) & (closing_speed < self.hole[1])
        )
        gap = np.where(crash, 0.0, np.minimum(range_, np.maximum(self.first - closing_speed, 0.01)))
        return Outcomes(crash, gap, range_ / closing_speed, np.where(crash, closing_speed, 0.0))


def encounters(speeds=None):
    speeds = np.random.default_rng(3).uniform(5, 15, 2000) if speeds is None else speeds
    return pd.DataFrame({"lead_speed": speeds, "segment": "5-15"})


def model(range_law, ttc_law):
    return LaneChangeModel("test", {"5-15": 1}, range_law, {"5-15": ttc_law})


def integral(range_law, ttc_law, edges):
    """P of closing speeds in [edges[0], edges[1]) or from edges[2] on, by adaptive quadrature over R^-1."""

    def log_tail(speed, x):
        return float(ttc_law.logsf(speed * x))

    def integrand(x):
        x = float(x)
        terms = np.exp(log_tail(edges[0], x)) - np.exp(log_tail(edges[1], x)) + np.exp(log_tail(edges[2], x))
        return terms * np.exp(float(range_law.logpdf(x)))

    bounds = sorted({LOWER, 0.0374, *(0.166 / edge for edge in edges), 0.1, 0.3, 1.0, 3.0})
    return float(mpmath.quad(integrand, [b for b in bounds if b >= LOWER]))


def probability(car, range_law, ttc_law, grid=GRID, seed=1):
    crash_map = map_crashes(car, grid, [], np.random.default_rng(seed))
    return exact_probabilities(crash_map, model(range_law, ttc_law), encounters())[ALL]


@pytest.mark.parametrize("law", TTC_LAWS.values(), ids=TTC_LAWS.keys())
def test_interval_probability_keeps_its_digits_in_the_tail(law):
    start = np.array([0.0, 0.1, 0.2, 5.0, 20.0])
    for width in (1e-6, 0.05, np.inf):
        exact = law.sf(start) - law.sf(start + width)
        far = start > 0.166
        if width == 1e-6:
            density = np.exp(law.logpdf(start + width / 2)) * width
            np.testing.assert_allclose(interval_probability(law, start, start + width), density, rtol=1e-6)
        else:
            values = interval_probability(law, start, start + width)
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
    found = exact_probabilities(blind_map, model(*laws), encounters())[ALL]
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
    told = np.sqrt(np.mean([value.standard_error**2 for value in found]))
    # The standard deviation of 40 normal values has a relative error of 1 / sqrt(78): 4 of them.
    assert abs(spread / told - 1) < 4 / np.sqrt(78)


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
    capped = probability(car, *laws, replace(GRID, closing_speed_max=12.1))
    assert capped.probability == pytest.approx(integral(*laws, (12.0, 99.0, 99.0)), rel=5e-3)
    assert probability(car, *laws, replace(GRID, closing_speed_max=11.9)).probability == 0


def test_agrees_with_importance_sampling():
    laws = RANGE_LAWS["pieces"], TTC_LAWS["pieces"]
    table, grid = encounters(), replace(GRID, closing_speed_max=23.49, lead_speed_cells=20, range_cells=60)
    crash_map = map_crashes(
        AccAeb(), grid, events_from({"min_ttc": [1.0], "min_range": [2.0]}), np.random.default_rng(1)
    )
    found = exact_probabilities(crash_map, model(*laws), table)[ALL]
    problem = CutIn(Empirical(table["lead_speed"]), Proposal(*laws), AccAeb(), 23.49)
    sample = problem.sample(
        Proposal(laws[0], BoundedExponential(8.0, 0.5)), np.random.default_rng(2), 400_000
    )
    weights = sample.crash_weight
    error = np.hypot(weights.std() / np.sqrt(weights.size), found.standard_error)
    assert abs(weights.mean() - found.probability) < 4 * error
    assert error / found.probability < 0.02
    crude = problem.sample(Proposal(*laws), np.random.default_rng(4), 1_000_000).outcomes
    events = list(crash_map.events)[1:]
    for event in events:
        value = exact_probabilities(crash_map, model(*laws), table, event)[ALL]
        mean = event.happens(crude).mean()
        assert abs(mean - value.probability) < 4 * np.hypot(np.sqrt(mean / 1e6), value.standard_error)


def test_all_is_the_mean_of_the_segments():
    rng = np.random.default_rng(5)
    table = pd.DataFrame({"lead_speed": rng.uniform(5, 15, 3000)})
    table["segment"] = np.where(table["lead_speed"] < 10, "slow", "fast")
    laws = {"slow": BoundedExponential(21.0), "fast": BoundedExponential(30.0)}
    two = LaneChangeModel("two", {"slow": 1000, "fast": 3000}, RANGE_LAWS["exponential"], laws)
    crash_map = map_crashes(AccAeb(), replace(GRID, closing_speed_max=23.49), [], np.random.default_rng(1))
    found = exact_probabilities(crash_map, two, table)
    mean = 0.25 * found["slow"].probability + 0.75 * found["fast"].probability
    assert found[ALL].probability == pytest.approx(mean, rel=1e-12)
    listed = exact_table({"full": crash_map}, {"two": two}, table)
    assert list(listed["segment"]) == ["slow", "fast", ALL]


@pytest.mark.parametrize(
    ("speeds", "law", "where"),
    [
        (np.array([4.9, 6.0]), RANGE_LAWS["exponential"], "v_L"),
        (np.array([6.0, 15.0]), RANGE_LAWS["exponential"], "v_L"),
        (np.array([6.0, 7.0]), BoundedExponential(50.0, 0.01), "R"),
    ],
)
def test_models_beyond_the_map_are_refused(speeds, law, where):
    crash_map = map_crashes(WallCar(), replace(GRID, refinement=1), [], np.random.default_rng(1))
    with pytest.raises(InputError, match=where):
        exact_probabilities(crash_map, model(law, TTC_LAWS["exponential"]), encounters(speeds))


def test_variation_is_that_of_the_weights():
    laws = RANGE_LAWS["pieces"], TTC_LAWS["pieces"]
    table, car = encounters(), WallCar(hole=(99, 99))
    crash_map = map_crashes(car, GRID, [], np.random.default_rng(1))
    proposal = Proposal(
        PiecewiseMixture(
            [0.9, 0.1], [BoundedExponential(60.0, LOWER, 0.0374), BoundedExponential(45.0, 0.0374)]
        ),
        PiecewiseMixture([0.1, 0.9], [TTC_LAWS["pieces"].components[0], BoundedExponential(15.0, 0.166)]),
    )
    exact = exact_variation(crash_map, model(*laws), {"5-15": proposal}, table)
    problem = CutIn(Empirical(table["lead_speed"]), Proposal(*laws), car, 60.0)
    weights = problem.sample(proposal, np.random.default_rng(2), 1_000_000).crash_weight
    assert exact["5-15"] == exact[ALL]
    # The relative error of a sample's variance is about sqrt((kurtosis - 1) / n).
    kurtosis = np.mean((weights - weights.mean()) ** 4) / weights.var() ** 2
    ratio = exact[ALL][0] ** 2 / (weights.var() / weights.mean() ** 2)
    assert abs(ratio - 1) < 4 * np.sqrt((kurtosis - 1) / 1e6) + 0.01


def test_variation_of_f_itself_is_that_of_crude_monte_carlo():
    laws = RANGE_LAWS["exponential"], TTC_LAWS["exponential"]
    crash_map = map_crashes(WallCar(), GRID, [], np.random.default_rng(1))
    found = exact_probabilities(crash_map, model(*laws), encounters())[ALL].probability
    variation = exact_variation(crash_map, model(*laws), {"5-15": Proposal(*laws)}, encounters())[ALL][0]
    assert variation == pytest.approx(np.sqrt(1 / found - 1), rel=5e-3)


def test_variation_without_end_is_infinite_and_trimming_ends_it():
    laws = RANGE_LAWS["exponential"], TTC_LAWS["exponential"]
    crash_map = map_crashes(WallCar(), GRID, [], np.random.default_rng(1))
    # Crashes have R^-1 of rate 50 + 21 * 12 under f, so f^2 / f* rises from a rate of 352 of f* on.
    light = {"5-15": Proposal(BoundedExponential(400.0, LOWER), TTC_LAWS["exponential"])}
    table = variation_table(crash_map, model(*laws), {("light", 0): light}, encounters())
    assert np.all(table["variation"] > 1e3 * table["variation_trimmed"])
    steep = {"5-15": Proposal(RANGE_LAWS["exponential"], BoundedExponential(43.0))}
    assert exact_variation(crash_map, model(*laws), steep, encounters())[ALL] == (np.inf,)


def test_severity_of_a_known_car():
    car, laws = WallCar(hole=(99, 99)), (RANGE_LAWS["exponential"], TTC_LAWS["exponential"])
    events = events_from({"impact_speed": list(range(0, 41)), "min_range": [1.0]})
    crash_map = map_crashes(car, GRID, events, np.random.default_rng(1))
    table = severity_table(crash_map, model(*laws), encounters(), distance=1000.0)
    table = table[table["segment"] == ALL].set_index(["quantity", "threshold"])
    above = integral(*laws, (20.0, 99.0, 99.0)) / integral(*laws, (12.0, 99.0, 99.0))
    assert table.loc[("impact_speed", 20.0), "to_crash"] == pytest.approx(above, rel=5e-3)
    crash = table.loc[("crash", 0.0)]
    assert crash["per_million_km"] == pytest.approx(crash["probability"] * 2000 / 1000 * 1e6)
    # Given R^-1 = x the impact speed is 12 + an exponential of rate 21 x.
    rate, lower = 50.0, LOWER
    density = lambda x: rate * np.exp(-rate * (x - lower) - 21 * 12 * x)  # noqa: E731
    mean = 12 + float(
        mpmath.quad(lambda x: density(float(x)) / (21 * float(x)), [lower, 0.1, 1])
        / mpmath.quad(lambda x: density(float(x)), [lower, 0.1, 1])
    )
    summary = impact_speed_table(table.reset_index()).iloc[0]
    assert summary["mean_m_s"] == pytest.approx(mean, rel=1e-2)
    assert summary["q10_m_s"] < summary["q50_m_s"] < summary["q90_m_s"]


def test_severity_without_crashes_or_distance_is_empty():
    crash_map = map_crashes(
        WallCar(first=99), GRID, events_from({"impact_speed": [5]}), np.random.default_rng(1)
    )
    table = severity_table(crash_map, model(RANGE_LAWS["exponential"], TTC_LAWS["exponential"]), encounters())
    assert (table["probability"] == 0).all()
    assert table["per_million_km"].isna().all()
    assert impact_speed_table(table).empty


def piece(content):
    upper = content["upper"] or np.inf
    if "rate" in content:
        return BoundedExponential(content["rate"], content["lower"], upper)
    normals = [BoundedNormal(sd, content["lower"], upper) for sd in content["standard_deviations"]]
    return Mixture(content["mixture_weights"], normals)


def test_benchmark():
    if not (BENCHMARK.is_file() and SPMD.is_file()):
        pytest.skip("needs the benchmark problem and the lane changes of ../shared")
    from scipy.io import loadmat

    content = json.loads(BENCHMARK.read_text())
    laws = [
        PiecewiseMixture([p["weight"] for p in content[name]["pieces"]], map(piece, content[name]["pieces"]))
        for name in ("inverse_range", "inverse_ttc")
    ]
    speeds = loadmat(SPMD)["mixture_data"][:, 0]
    grid = replace(
        GRID,
        lead_speed_cells=20,
        range_cells=100,
        refinement=16,
        closing_speed_max=23.49,
        closing_speed_points=240,
    )
    crash_map = map_crashes(AccAeb(), grid, [], np.random.default_rng(1))
    found = exact_probabilities(crash_map, model(*laws), encounters(speeds[(speeds >= 5) & (speeds < 15)]))[
        ALL
    ]
    assert found.standard_error < 1.5e-3 * content["reference_probability"]
    error = np.hypot(found.standard_error, content["reference_standard_error"])
    assert abs(found.probability - content["reference_probability"]) < 4 * error
