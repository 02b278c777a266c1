"""Figures and table of the surrogate-guided sampler: what they show is what the result tables say."""

import math

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.publishing.figures import surrogate as surrogate_figures
from accelerated_evaluation.publishing.figures.style import style_of
from accelerated_evaluation.publishing.tables.methods import PHASES, side_by_side, surrogate_table

FIGURES = ("fig19_surrogate_runs", "fig20_methods")
SHARES = {"5-15": 0.4, "15-25": 0.6}
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


@pytest.fixture
def runs():
    """100 simulations a replicate: 20 to search, 50 to learn, 30 of the estimate, 60 of them in 5-15."""
    rows = [
        (scope, replicate, run, phase, run / 50, run / 20, "5-15" if run <= 60 else "15-25", run % 10 == 0)
        for scope in ("all", "5-15")
        for replicate in range(3)
        for run, phase in enumerate(20 * ["search"] + 50 * ["learn"] + 30 * ["estimate"], 1)
    ]
    names = ["scope", "replicate", "run", "phase", "z_range", "z_closing_speed", "segment", "event"]
    return pd.DataFrame(rows, columns=names)


@pytest.fixture
def draw(replicates, runs, exact):
    arguments = {
        "fig19_surrogate_runs": (runs, exact, SHARES, "made up"),
        "fig20_methods": (replicates, exact, "made up"),
    }
    return lambda name: getattr(surrogate_figures, name)(*arguments[name])


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


def test_a_replicate_without_crash_has_a_row_and_a_figure(replicates, runs, exact):
    is_ours = replicates["method"] == "surrogate"
    none = {"probability": 0.0, "ci_low": 0.0, "ci_high": 1.0, "learning": 100, "estimating": 0}
    replicates.loc[is_ours, list(none)] = [*none.values()]
    nothing = runs.assign(phase="search", event=False)
    figure, data = surrogate_figures.fig20_methods(replicates, exact, "made up")
    assert data.loc[data["method"] == "surrogate", "estimating"].tolist() == [0, 0, 0]
    assert figure.axes[1].get_xlim()[1] < 3
    figure, data = surrogate_figures.fig19_surrogate_runs(nothing, exact, SHARES, "made up")
    assert data.loc[data["quantity"] == "of the estimate", "share"].tolist() == [0, 0]
    assert figure.axes[0].get_xlim() == figure.axes[1].get_xlim()


def test_every_simulation_of_one_replicate_is_drawn_by_phase_and_outcome(draw):
    figure, data = draw("fig19_surrogate_runs")
    lines = {line.get_label(): len(line.get_xdata()) for line in figure.axes[0].get_lines()}
    assert lines == {
        "search, no crash": 18,
        "search, crash": 2,
        "learn, no crash": 45,
        "learn, crash": 5,
        "estimate, no crash": 27,
        "estimate, crash": 3,
    }
    low, high = figure.axes[1].get_ylim()
    assert (low, high) == pytest.approx((30 / 20 - 0.5, 100 / 20 + 0.5))
    share = data.dropna(subset="share").set_index(["quantity", "segment"])["share"]
    assert share["lane changes", "5-15"] == 0.4
    assert share["simulations", "5-15"] == pytest.approx(0.6)
    assert share["of the estimate", "5-15"] == 0
    assert share["crashes", "5-15"] == pytest.approx(0.8 / 1.4)


def test_every_phase_has_a_look_of_its_own_and_every_method_too():
    assert tuple(surrogate_figures.PHASE_LOOKS) == PHASES
    methods = {name: style_of(name) for name in ("single", "piecewise", "heuristic", "crude", "surrogate")}
    for looks in (surrogate_figures.PHASE_LOOKS, methods):
        assert len({look["marker"] for look in looks.values()}) == len(looks)


def test_cost_and_estimate_of_every_replicate_are_drawn_side_by_side(draw):
    figure, data = draw("fig20_methods")
    left, right = figure.axes
    assert data["method"].unique().tolist() == ["single", "piecewise", "heuristic", "surrogate"]
    assert data["to_exact"].tolist() == pytest.approx(4 * [0.9, 1.0, 1.3])
    drawn = {line.get_fillstyle(): line.get_xdata().tolist() for line in left.get_lines()[-2:]}
    assert drawn == {"none": [30, 30, 30], "full": [100, 100, 100]}
    bars = [tuple(segment[:, 0]) for lines in right.collections for segment in lines.get_segments()]
    assert bars[-1] == pytest.approx((1.3 * 0.8, 1.3 * 1.2))
    assert math.isclose(right.get_lines()[-1].get_xdata()[0], 1)
