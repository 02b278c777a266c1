"""Longer searches: they continue the shorter ones, and their parameters change as computed by hand."""

import math

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import CUT_IN, Problem, map_crashes
from accelerated_evaluation.crash_map.exact_variance import exact_variation
from accelerated_evaluation.methods import METHODS, Stopping
from accelerated_evaluation.methods.cross_entropy import repeated
from accelerated_evaluation.methods.cross_entropy.repeated import parameter_change, repeated_searches
from toy_segment import SETTINGS
from wall_car import GRID, RANGE_LAWS, TTC_LAWS, WallCar, law_of


def test_the_change_is_that_of_the_piece_with_the_largest_weight_at_the_crash():
    trace = pd.DataFrame(
        {
            "threshold_ttc_s": [math.nan, 2.0, 0.0, 0.0, 0.0],
            "inverse_ttc_weight_1": [0.9, 0.1, 0.1, 0.1, 0.1],
            "inverse_ttc_weight_2": [0.1, 0.9, 0.9, 0.9, 0.9],
            "inverse_ttc_theta_1": [0.0, 9.0, 1.0, 5.0, 7.0],
            "inverse_ttc_theta_2": [0.0, 99.0, 10.0, 11.0, 9.9],
            "inverse_range_rate": [9.0, 8.0, 4.0, 2.0, 3.0],
        }
    )
    assert parameter_change(trace, "inverse_ttc") == pytest.approx((0.1 + 0.1) / 2)
    assert parameter_change(trace, "inverse_range") == pytest.approx((0.5 + 0.5) / 2)
    assert math.isnan(parameter_change(trace[:3], "inverse_ttc"))


def test_longer_searches_continue_the_shorter_ones(monkeypatch):
    monkeypatch.setattr(repeated, "SEEDS", range(2))
    monkeypatch.setattr(repeated, "CRASH_UPDATES", (2, 3))
    problem = Problem(CUT_IN, WallCar(hole=(99, 99)), law=law_of(RANGE_LAWS["pieces"], TTC_LAWS["pieces"]))
    crash_map = map_crashes(problem.vehicle, GRID, [], np.random.default_rng(1))
    methods = [METHODS[name].configured(SETTINGS) for name in ("single", "piecewise")]
    stopping = Stopping(SETTINGS["importance_sampling"]["alpha"], SETTINGS["importance_sampling"]["beta"])
    arguments = methods, stopping, problem, "5-15", crash_map, lambda _, seed: np.random.default_rng(seed)
    table = repeated_searches(*arguments)
    few, more = (table[table["crash_updates"] == updates].set_index(["method", "seed"]) for updates in (2, 3))
    assert ((more["simulations"] - few["simulations"]) % 1000 == 0).all()
    assert (more["simulations"] > few["simulations"]).all()
    assert table["needed"].between(20, 100_000).all()
    assert (few["needed"] != more["needed"]).all()
    pd.testing.assert_frame_equal(table, repeated_searches(*arguments))
    variation = exact_variation(
        crash_map, problem.law, {"5-15": problem.law.strata["5-15"].factors}, ignored_shares=(1e-3,)
    )
    crude = (1.2815515655446004 / 0.2 * variation["5-15"][0]) ** 2
    assert (table["needed"] < crude / 10).all()
