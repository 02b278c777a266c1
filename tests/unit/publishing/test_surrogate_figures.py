"""Figures and table of the surrogate-guided sampler: what they show is what the result tables say."""

import math

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.publishing.figures import surrogate as surrogate_figures
from accelerated_evaluation.publishing.tables.methods import side_by_side, surrogate_table

LEARNING = {"all": (23000, 35000, 23000), "5-15": (3000, 5000, 3000)}  # of the paper's methods, by replicate


@pytest.fixture
def exact():
    return pd.DataFrame({"segment": ["5-15", "15-25", "all"], "probability": [2e-6, 1e-6, 1.4e-6]})


@pytest.fixture
def replicates():
    """Return three replicates of each method and scope, at 0.9, 1 and 1.3 times 1.4e-6."""
    rows = [
        (scope, method, replicate, 1.4e-6 * ratio, 1.12e-6 * ratio, 1.68e-6 * ratio, *spent, 20, True)
        for scope, learning in LEARNING.items()
        for method in ("single", "piecewise", "heuristic", "surrogate")
        for replicate, ratio in enumerate((0.9, 1.0, 1.3))
        for spent in [(70, 30) if method == "surrogate" else (learning[replicate], 100)]
    ]
    names = ["scope", "method", "replicate", "probability", "ci_low", "ci_high", "learning", "estimating"]
    table = pd.DataFrame(rows, columns=[*names, "events", "converged"])
    unseen = np.where(table["method"] == "surrogate", 1e-8 * (1 + table["replicate"]), np.nan)
    return table.assign(together=table["learning"] + table["estimating"], unseen_mode=unseen)


def test_one_scope_is_shown_as_the_replicates_have_it(replicates):
    table = side_by_side(replicates, "all").set_index("method")
    assert table.loc["piecewise", "learning"].tolist() == [23000, 35000, 23000]
    assert table.loc["piecewise", "together"].tolist() == [23100, 35100, 23100]
    assert table.loc["surrogate", ["learning", "estimating", "together"]].to_numpy().tolist() == 3 * [
        [70, 30, 100]
    ]
    alone = side_by_side(replicates, "5-15").set_index("method")
    assert alone.loc["single", "learning"].tolist() == [3000, 5000, 3000]


def test_the_table_judges_by_the_exact_probability_of_its_scope(replicates, exact):
    table = surrogate_table(replicates, exact).set_index(["scope", "method"])
    assert len(table) == 8
    whole, alone = table.loc[("all", "surrogate")], table.loc[("5-15", "surrogate")]
    assert whole["to_exact"] == pytest.approx(3.2 / 3)
    # 0.8 and 1.2 times the estimate: only 1.3 * 0.8 = 1.04 lies above the truth.
    assert whole["holding"] == 2
    assert alone["to_exact"] == pytest.approx(0.7 * 3.2 / 3)
    assert alone["holding"] == 1
    assert whole["together"] == 100
    assert whole["unseen_mode"] == pytest.approx(3e-8)
    assert np.isnan(table.loc[("all", "single"), "unseen_mode"])


def test_a_replicate_without_crash_has_a_row_and_a_figure(replicates, exact):
    is_ours = replicates["method"] == "surrogate"
    none = {"probability": 0.0, "ci_low": 0.0, "ci_high": 1.0, "learning": 100, "estimating": 0}
    replicates.loc[is_ours, list(none)] = [*none.values()]
    figure, data = surrogate_figures.fig20_methods(replicates, exact, "made up")
    assert data.loc[data["method"] == "surrogate", "estimating"].tolist() == [0, 0, 0]
    assert figure.axes[1].get_xlim()[1] < 3


def test_cost_and_estimate_of_every_replicate_are_drawn_side_by_side(replicates, exact):
    figure, data = surrogate_figures.fig20_methods(replicates, exact, "made up")
    left, right = figure.axes
    assert data["method"].unique().tolist() == ["single", "piecewise", "heuristic", "surrogate"]
    assert data["to_exact"].tolist() == pytest.approx(4 * [0.9, 1.0, 1.3])
    drawn = {line.get_fillstyle(): line.get_xdata().tolist() for line in left.get_lines()[-2:]}
    assert drawn == {"none": [30, 30, 30], "full": [100, 100, 100]}
    bars = [tuple(segment[:, 0]) for lines in right.collections for segment in lines.get_segments()]
    assert bars[-1] == pytest.approx((1.3 * 0.8, 1.3 * 1.2))
    assert math.isclose(right.get_lines()[-1].get_xdata()[0], 1)
