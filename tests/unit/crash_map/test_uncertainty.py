"""Resampling, bootstrap refits, and the budget of the uncertainty."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import map_crashes
from accelerated_evaluation.crash_map.sensitivity import Levels, Refit
from accelerated_evaluation.crash_map.uncertainty import (
    INVERSE_TTC_KNOTS,
    bootstrap_probabilities,
    probabilities_of_choices,
    resampled_rows,
    uncertainty_budget,
)
from accelerated_evaluation.laws.paper.piecewise import PieceFamily
from accelerated_evaluation.vehicles import AccAeb
from builders import coarse_grid

CAP = 23.49  # [m/s]
EXPONENTIAL = PieceFamily("bounded exponential")
PIECES = EXPONENTIAL, PieceFamily("bounded normal", 2), EXPONENTIAL
LEVELS = Levels((0.8,), 0.95, *PIECES)


@pytest.fixture(scope="module")
def crash_map():
    return map_crashes(
        AccAeb(),
        coarse_grid(speeds=(5, 15, 8), ranges=(75, 40), closing=(CAP, 120), refinement=6),
        [],
        np.random.default_rng(1),
    )


def table(rows, repeats=1):
    generator = np.random.default_rng(1)
    drawn = pd.DataFrame(
        {
            "lead_speed": generator.uniform(5, 15, rows),
            "inverse_range": 1 / 75 + generator.exponential(0.012, rows),
            "inverse_ttc": generator.exponential(0.05, rows),
            "segment": "5-15",
        }
    )
    return drawn.loc[drawn.index.repeat(repeats)].reset_index(drop=True)


def test_runs_stay_whole():
    starts = np.array([0, 3, 4, 6])
    runs = [[0, 1, 2], [3], [4, 5], [6, 7, 8, 9]]
    generator = np.random.default_rng(1)
    for _ in range(20):
        rows = resampled_rows(starts, 10, generator).tolist()
        taken = 0
        while rows:
            run = next(run for run in runs if run[0] == rows[0])
            assert rows[: len(run)] == run
            rows, taken = rows[len(run) :], taken + 1
        assert taken == len(runs)


def test_every_row_is_drawn_equally_often():
    generator = np.random.default_rng(3)
    counts = sum(np.bincount(resampled_rows(np.arange(10), 10, generator), minlength=10) for _ in range(4000))
    assert np.all(np.abs(counts / 4000 - 1) < 4 * np.sqrt(1 / 4000))


def test_bootstrap_spreads_as_the_data_say(crash_map):
    data = table(3000)
    values = bootstrap_probabilities(
        crash_map, data, LEVELS, np.random.default_rng(4), closing_speed_max=CAP, replicates=60
    )
    base = Refit.by(crash_map, CAP).probability(data, LEVELS).probability
    assert values.min() < base < values.max()
    assert 0.1 < np.std(np.log(values)) < 3


def test_repeating_every_row_widens_nothing(crash_map):
    # Runs are the units: with every row twice the same draws give the same models.
    once, twice = (
        bootstrap_probabilities(
            crash_map,
            table(3000, repeats),
            LEVELS,
            np.random.default_rng(5),
            closing_speed_max=CAP,
            replicates=30,
        )
        for repeats in (1, 2)
    )
    # The knots move by less than one row's distance.
    assert np.std(np.log(twice)) == pytest.approx(np.std(np.log(once)), rel=0.1)


def test_same_generator_same_bootstrap(crash_map):
    one, two = (
        bootstrap_probabilities(
            crash_map,
            table(1000),
            LEVELS,
            np.random.default_rng(6),
            closing_speed_max=CAP,
            replicates=5,
        )
        for _ in range(2)
    )
    np.testing.assert_array_equal(one, two)


def test_choices_are_a_product(crash_map):
    values = probabilities_of_choices(
        crash_map, table(2000), [LEVELS, Levels((0.7, 0.9), 0.95, *PIECES)], [0.9, 0.95], CAP
    )
    assert values.shape == (4,)
    assert values[1] == Refit.by(crash_map, CAP).probability(table(2000), LEVELS).probability


def test_budget_of_normal_parts():
    generator = np.random.default_rng(7)
    z = 1.2815515655446004
    bootstrap = 1e-6 * (1 + 0.1 * generator.standard_normal(4000))
    choices = 1e-6 * (1 + 0.2 * np.array([-1.0, 1.0]))
    budget = uncertainty_budget(
        1e-6, bootstrap, choices, (1e-6 * (1 - 0.05 * z), 1e-6 * (1 + 0.05 * z)), alpha=0.2
    )
    shares = budget.set_index("source")["variance_share"]
    assert shares.drop("together").sum() == pytest.approx(1)
    # 0.05^2 : 0.1^2 : 0.2^2, the second with a relative error of sqrt(2 / 4000).
    expected = np.array([0.0025, 0.01, 0.04]) / 0.0525
    np.testing.assert_allclose(shares.drop("together"), expected, rtol=4 * np.sqrt(2 / 4000))
    together = budget.set_index("source").loc["together"]
    assert together["standard_deviation"] == pytest.approx(1e-6 * np.sqrt(0.0525), rel=0.03)
    assert together["ci_low"] < budget["ci_low"][:3].max()
    assert together["ci_high"] > budget["ci_high"][:2].max()


def test_the_caption_of_the_budget_names_the_knots():
    caption = (Path(__file__).parents[3] / "workflow" / "report" / "uncertainty.rst").read_text()
    *first, last = map(str, INVERSE_TTC_KNOTS)
    assert f"quantiles {', '.join(first)} and {last}" in caption
