"""Severity against a car of known impact speeds, and the variation of weights against sampled ones."""

import mpmath
import numpy as np
import pytest
from accelerated_evaluation import CUT_IN, Problem, map_crashes
from accelerated_evaluation.crash_map.exact import ALL, exact_probabilities
from accelerated_evaluation.crash_map.exact_variance import exact_variation, tail_decay, variation_table
from accelerated_evaluation.crash_map.severity import impact_speed_table, severity_table
from accelerated_evaluation.laws import Factors
from accelerated_evaluation.laws.distributions import BoundedExponential, BoundedNormal, PiecewiseMixture
from accelerated_evaluation.methods.importance_sampling import Sample
from accelerated_evaluation.vehicles.protocol import CRASH, events_of
from wall_car import GRID, LOWER, RANGE_LAWS, TTC_LAWS, WallCar, integral, law_of


def test_variation_is_that_of_the_weights():
    laws = RANGE_LAWS["pieces"], TTC_LAWS["pieces"]
    car, law = WallCar(hole=(99, 99)), law_of(*laws, cap=60.0)
    crash_map = map_crashes(car, GRID, [], np.random.default_rng(1))
    proposal = Factors(
        PiecewiseMixture(
            [0.9, 0.1], [BoundedExponential(60.0, LOWER, 0.0374), BoundedExponential(45.0, 0.0374)]
        ),
        PiecewiseMixture([0.1, 0.9], [TTC_LAWS["pieces"].components[0], BoundedExponential(15.0, 0.166)]),
    )
    exact = exact_variation(crash_map, law, {"5-15": proposal})
    weights = Sample.of(
        Problem(CUT_IN, car, law=law), "5-15", proposal, np.random.default_rng(2), 1_000_000
    ).weight
    assert exact["5-15"] == exact[ALL]
    # The relative error of a sample's variance is about sqrt((kurtosis - 1) / n).
    kurtosis = np.mean((weights - weights.mean()) ** 4) / weights.var() ** 2
    ratio = exact[ALL][0] ** 2 / (weights.var() / weights.mean() ** 2)
    assert abs(ratio - 1) < 4 * np.sqrt((kurtosis - 1) / 1e6) + 0.01


def test_variation_of_f_itself_is_that_of_crude_monte_carlo():
    laws = RANGE_LAWS["exponential"], TTC_LAWS["exponential"]
    crash_map = map_crashes(WallCar(), GRID, [], np.random.default_rng(1))
    found = exact_probabilities(crash_map, law_of(*laws))[ALL].probability
    variation = exact_variation(crash_map, law_of(*laws), {"5-15": Factors(*laws)})[ALL][0]
    assert variation == pytest.approx(np.sqrt(1 / found - 1), rel=5e-3)


def test_variation_without_end_is_infinite_and_trimming_ends_it():
    laws = RANGE_LAWS["exponential"], TTC_LAWS["exponential"]
    crash_map = map_crashes(WallCar(), GRID, [], np.random.default_rng(1))
    # Crashes have R^-1 of rate 50 + 21 * 12 under f, so f^2 / f* rises from a rate of 352 of f* on.
    light = {"5-15": Factors(BoundedExponential(400.0, LOWER), TTC_LAWS["exponential"])}
    table = variation_table(crash_map, law_of(*laws), {("light", 0): light})
    assert np.all(table["variation"] > 1e3 * table["variation_trimmed"])
    assert table["decay"].tolist() == pytest.approx([8.0, 8.0])
    steep = {"5-15": Factors(RANGE_LAWS["exponential"], BoundedExponential(43.0))}
    assert exact_variation(crash_map, law_of(*laws), steep)[ALL] == (np.inf,)


def test_the_decay_of_a_tail_decides_on_the_variance():
    """The integral of f^2 / f* is 1 / (a (2 - a)) for exponentials of rates 1 and a < 2."""
    f = BoundedExponential(5.0, 0.2)
    for ratio in (0.5, 1.0, 1.9, 2.1):
        assert tail_decay(f, BoundedExponential(5.0 * ratio, 0.2)) == pytest.approx(ratio)
    pieces = PiecewiseMixture([0.9, 0.1], [BoundedExponential(9.0, 0.0, 0.2), f])
    assert tail_decay(pieces, pieces.accelerated([3.0, 1.0], [0.1, 0.9])) == pytest.approx(0.8)
    assert tail_decay(pieces, BoundedExponential(11.0)) == pytest.approx(2.2)
    normal = BoundedNormal(0.1, 0.0)
    assert tail_decay(normal, normal.tilt(20.0)) == pytest.approx(1, abs=0.1)


def test_severity_of_a_known_car():
    car, laws = WallCar(hole=(99, 99)), (RANGE_LAWS["exponential"], TTC_LAWS["exponential"])
    events = [CRASH, *events_of(CUT_IN, {"impact_speed": list(range(0, 41)), "min_range": [1.0]})]
    crash_map = map_crashes(car, GRID, events, np.random.default_rng(1))
    table = severity_table(crash_map, law_of(*laws), 2000, distance=1000.0)
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
        WallCar(first=99), GRID, [CRASH, CUT_IN.event("impact_speed", 5.0)], np.random.default_rng(1)
    )
    table = severity_table(crash_map, law_of(RANGE_LAWS["exponential"], TTC_LAWS["exponential"]), 2000)
    assert (table["probability"] == 0).all()
    assert table["per_million_km"].isna().all()
    assert impact_speed_table(table).empty
