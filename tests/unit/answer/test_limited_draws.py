"""Draws of a law within a limit: shares, densities and slices in closed form, and all ways to an answer."""

from dataclasses import replace

import accelerated_evaluation as ae
import numpy as np
import pytest
from accelerated_evaluation.answer.settings import limits_of
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.laws.limited import POINTS, Limit, LimitedDraws, Where, limits_in_words
from accelerated_evaluation.scenarios.left_turn import LEFT_TURN
from normal_law import left_turn_law
from scipy.stats import truncnorm

FAR = left_turn_law((14, 7, 100), (5, 3, 10))
TURNING = Limit(("turning_speed_mps",), (1,), 9.0)
CLOSE = [left_turn_law((mean, 7, 20), (5, 3, 10)) for mean in (12, 16)]
HOST = Limit(("sdv_speed_mps",), (0,), 15.0)
NARROW = Limit(("lead_speed", "closing_speed"), (0, 2), 22.0)


def normal(mean, deviation, low, high):
    """Return a normal distribution that is truncated to an interval."""
    return truncnorm((low - mean) / deviation, (high - mean) / deviation, mean, deviation)


def two():
    """Return draws of two laws of left turns that differ in the speed of the vehicle."""
    parts = [ae.OneLaw(law, name) for law, name in zip(CLOSE, ("slow", "fast"), strict=True)]
    return ae.DrawnLaws(parts, left_turn_law((14, 7, 20), (6, 3, 10)))


@pytest.mark.parametrize("condition", [TURNING, Where(lambda x: x[:, 1] >= 9)])
def test_a_draw_within_a_condition_is_the_conditional_distribution(condition):
    generator = np.random.default_rng(1)
    found = LimitedDraws.given(ae.OneLaw(FAR), condition, generator)
    whole = normal(7, 3, 0, 60)
    inside = normal(7, 3, 0, 9) if condition is TURNING else normal(7, 3, 9, 60)
    share = whole.cdf(9) if condition is TURNING else whole.sf(9)
    assert found.shares[0] == pytest.approx(share, abs=4 * np.sqrt(share * (1 - share) / POINTS))
    x = found.draw_from_mean(20_000, generator)
    assert condition.holds(x).all()
    assert x[:, 1].mean() == pytest.approx(inside.mean(), abs=4 * inside.std() / np.sqrt(len(x)))
    at = np.array([[14.0, 8.0, 100.0], [14.0, 10.0, 100.0]])
    expected = np.where(condition.holds(at), FAR.log_density(at) - np.log(found.shares[0]), -np.inf)
    assert found.log_densities(at)[0] == pytest.approx(expected)


def test_the_draws_are_weighted_by_the_distribution_that_is_drawn_from():
    """The mean weight of each draw is 1, also if its points come together; without the shares it is not."""
    generator = np.random.default_rng(2)
    whole = two()
    found = LimitedDraws.given(whole, HOST, generator)
    exact = [normal(mean, 5, 0, 35).cdf(15) for mean in (12, 16)]
    assert found.shares == pytest.approx(exact, abs=0.04)
    found = LimitedDraws.of_shares(whole, HOST, np.array(exact))
    x = found.draw_from_mean(40_000, generator)
    ratios = np.exp(found.log_ratios_to_mean(x))
    assert ratios.mean(axis=1) == pytest.approx([1, 1], abs=0.006)
    assert abs(np.exp(whole.log_ratios_to_mean(x)).mean(axis=1) - 1).max() > 0.1


def test_all_ways_to_an_answer_agree_within_a_limit():
    """Scan and few runs agree with simulations within the limit; those of the whole law do not."""
    generator = np.random.default_rng(3)
    whole, problem = two(), ae.Problem("left_turn", "acc_aeb")
    limited = LimitedDraws.given(whole, HOST, generator)
    simulated, unlimited = (
        ae.evaluate(problem, draws, ae.Simulations(100_000), generator=5).posterior
        for draws in (limited, whole)
    )
    few = ae.FewRuns(ae.Stopping(minimum_events=1, maximum_simulations=100))
    for way in (ae.Scan(4096, 50), few):
        found = ae.evaluate(problem, limited, way, generator=4).posterior
        errors = np.hypot(found.errors, simulated.errors)
        assert (abs(np.log(found.probabilities / simulated.probabilities)) < 4 * errors).all()
    assert (np.log(unlimited.probabilities / simulated.probabilities) > 4 * unlimited.errors).all()


def test_a_limit_of_the_scanned_variable_cuts_its_intervals():
    limit = Limit(("distance_to_conflict_m",), (2,), 100.0)
    draws = LimitedDraws.of_shares(ae.OneLaw(FAR), limit, np.array([0.5]))
    x, exact = np.array([[14.0, 7.0, 0.0]]), normal(100, 10, 0, 150)
    others = FAR.log_slice(2, x, np.zeros(1), np.full(1, 150.0))[0]
    for low, high in ((90, 95), (95, 120), (110, 120)):
        (found,) = draws.log_slices(2, x, np.full(1, float(low)), np.full(1, float(high)))
        expected = np.exp(others) * (exact.cdf(min(high, 100)) - exact.cdf(min(low, 100))) / 0.5
        assert np.exp(found) == pytest.approx([expected], rel=1e-6)


@pytest.fixture(scope="module")
def cut_ins():
    """Return records, a law of them and a coarse map of the car under test."""
    config = ae.load(given={"data": {"sample": 2000, "spmd": {"outlier_rows": []}}})
    records = ae.read_records(config)
    draws = ae.as_draws(ae.fit_paper_law("two_pieces", records, config))
    limits = {"lead_speed_min": 5, "lead_speed_max": 35, "range_max": 75}
    cells = {"lead_speed_cells": 20, "range_cells": 40, "refinement": 8}
    grid = ae.Grid(**limits, **cells, closing_speed_max=60, closing_speed_points=120)
    event = ae.Event.at_most("min_ttc", 1.0)
    return records, draws, ae.Map(ae.map_crashes("acc_aeb", grid, [event], 1), records), event


def weighted(records, draws, event, limit, generator, size=200_000):
    """Return the probabilities of an event and their errors by plain importance sampling, (K,) each."""
    lead = generator.choice(records.x[:, 0], size)
    range_, closing = 75 * np.exp(-8 * generator.random(size)), 45 * generator.random(size) ** 2
    x = np.column_stack([lead, range_, closing])
    density = 1 / (8 * range_) / (2 * np.sqrt(45 * np.maximum(closing, 1e-12)))
    weights = np.exp(draws.log_densities(x)) / density
    inside = np.ones(size, bool) if limit is None else limit.holds(x)
    happened = inside & event.happens(ae.load_vehicle("acc_aeb").simulate(*x.T))
    share = (weights * inside).mean(axis=1)
    found = (weights * happened).mean(axis=1) / share
    residual = weights * (happened - found[:, None] * inside) / share[:, None]
    return found, residual.std(axis=1) / np.sqrt(size)


def test_the_map_within_a_limit_equals_plain_importance_sampling(cut_ins):
    records, draws, way, event = cut_ins
    problem, generator = ae.Problem("cut_in", "acc_aeb", event), np.random.default_rng(6)
    limited = LimitedDraws.given(draws, NARROW, generator)
    own, whole = (ae.evaluate(problem, each, way, generator=7).posterior for each in (limited, draws))
    found, error = weighted(records, limited.whole, event, NARROW, generator)
    of_share = np.sqrt((1 - limited.shares) / limited.shares / POINTS)  # relative
    error = np.hypot(error, 2 * of_share * found)
    assert (abs(own.probabilities - found) < 4 * error).all()
    assert (abs(whole.probabilities - found) > 4 * error).any()
    assert (own.probabilities * limited.shares <= whole.probabilities * (1 + 1e-9)).all()


def test_lines_of_a_map_end_at_the_limit(cut_ins):
    records, draws, way, event = cut_ins
    limited = LimitedDraws.of_shares(draws, NARROW, np.ones(1))
    whole = CrashLines.of(way.crash_map, records.x[:, 0], event, draws.support)
    cut = limited.within(whole)
    assert NARROW.holds(cut.inside[cut.end > cut.start]).all()
    assert not NARROW.holds(whole.inside).all()
    kept = whole.places.lead_speed[whole.row] + whole.end <= NARROW.maximum
    assert np.array_equal(cut.end[kept], whole.end[kept])
    assert np.array_equal(limited.holds(records.x), records.x[:, 0] + records.x[:, 2] <= NARROW.maximum)


def test_a_law_file_keeps_the_limit(tmp_path):
    limited = LimitedDraws.given(two(), HOST, np.random.default_rng(1)).subset(np.array([1, 0]))
    ae.write_law(tmp_path / "law.json", limited.law)
    read = ae.read_law(tmp_path / "law.json")
    x = np.array([[14.0, 8.0, 100.0], [16.0, 8.0, 100.0]])
    assert read.log_densities(x) == pytest.approx(limited.log_densities(x))
    assert read.shares == pytest.approx(limited.shares)
    assert read.digest == limited.digest
    (words,) = limits_in_words(read)
    assert "sdv_speed_mps at most 15" in words


@pytest.mark.parametrize(
    ("limits", "host", "seen"),
    [
        ({"speed": 3}, None, "speed of at most 3 in toy"),
        ({}, 30.0, "a largest speed of at most 30"),
    ],
)
def test_limits_of_unknown_variables_are_refused(limits, host, seen):
    config = {"vehicle": {"host_speed_max": host}, "scenario": {"limits": limits}}
    toy = replace(LEFT_TURN, name="toy", host_speed=())  # without a speed of the vehicle
    with pytest.raises(ae.InputError, match=seen):
        limits_of(toy, config)


def test_limits_are_sums_of_variables():
    config = {"vehicle": {"host_speed_max": 40.0}, "scenario": {"limits": {"range": 60.0}}}
    range_, host = limits_of(ae.CUT_IN, config, 38.0)
    assert host == Limit(("lead_speed", "closing_speed"), (0, 2), 38.0)
    assert range_ == Limit(("range",), (1,), 60.0)
    assert limits_of(LEFT_TURN, {**config, "scenario": {"limits": {}}})[0] == Limit(
        ("sdv_speed_mps",), (0,), 40.0
    )


def test_hardly_any_encounter_within_a_limit_is_refused():
    with pytest.raises(ae.InputError, match="expected a share of at least"):
        LimitedDraws.given(ae.OneLaw(FAR), Limit(("turning_speed_mps",), (1,), 0.1), np.random.default_rng(1))
