"""Figures and tables of the exact probability: what they show is what the result tables say."""

import math

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.publishing.figures import exact as truth_figures
from accelerated_evaluation.publishing.figures.style import style_of
from accelerated_evaluation.publishing.tables.exact import needed_simulations, share_of_one_run
from scipy.special import ndtri

PAPER = (7.0e-7, 7.8e-7)


@pytest.fixture
def exact():
    return pd.DataFrame(
        {"segment": ["5-15", "all"], "probability": [2e-6, 9e-7], "standard_error": [2e-9, 4e-10]}
    )


@pytest.fixture
def estimates():
    rows = [
        (scope, method, replicate, 1000 + replicate, p, 0.8 * p, 1.2 * p)
        for scope in ("all", "5-15")
        for method in ("single", "piecewise", "heuristic")
        for replicate, p in enumerate((8e-7, 9.5e-7))
    ]
    columns = ["scope", "method", "replicate", "simulations", "probability", "ci_low", "ci_high"]
    return pd.DataFrame(rows, columns=columns)


@pytest.fixture
def crude():
    return pd.DataFrame(
        {
            "segment": ["5-15", "all"],
            "simulations": [3e7, 6e7],
            "probability": [1.6e-6, 7.7e-7],
            "ci_low": [1.3e-6, 6.3e-7],
            "ci_high": [1.9e-6, 9.3e-7],
        }
    )


@pytest.fixture
def sensitivity():
    return pd.DataFrame(
        {
            "choice": ["model", "model", "knot of TTC^-1", "segments of v_L", "closing-speed cap [m/s]"],
            "value": ["two_pieces", "single", "0.99", "5 20 35", "18"],
            "probability": [9e-7, 9e-6, 4e-6, 5e-7, 9e-10],
            "standard_error": [4e-10] * 5,
        }
    )


@pytest.fixture
def uncertainty():
    return pd.DataFrame(
        {
            "source": ["sampling", "data", "choice of model", "together"],
            "probability": [7.4e-7, 9e-7, 1.1e-6, 1e-6],
            "standard_deviation": [3e-8, 2e-7, 4e-7, 4.5e-7],
            "ci_low": [7e-7, 7e-7, 6e-7, 5e-7],
            "ci_high": [7.8e-7, 1.1e-6, 1.6e-6, 1.7e-6],
            "variance_share": [0.01, 0.19, 0.8, 1.0],
        }
    )


@pytest.fixture
def bootstrap():
    return pd.DataFrame({"replicate": [0, 1], "probability": [8e-7, 1.2e-6]})


@pytest.fixture
def severity():
    events = [("crash", 0.0, 1.0), ("impact_speed", 0.0, 0.9), ("impact_speed", 5.0, 0.2)]
    events += [("impact_speed", 20.0, 1e-9), ("min_range", 0.5, 1.5), ("min_ttc", 1.0, 50.0)]
    rows = [
        (segment, quantity, threshold, ratio * p, ratio, 1e5 * ratio * p)
        for quantity, threshold, ratio in events
        for segment, p in (("5-15", 2e-6), ("all", 9e-7))
    ]
    columns = ["segment", "quantity", "threshold", "probability", "to_crash", "per_million_km"]
    return pd.DataFrame(rows, columns=columns)


@pytest.fixture
def draw(estimates, exact, crude, sensitivity, uncertainty, bootstrap, severity):
    arguments = {
        "fig14_estimates_against_truth": (estimates, exact, PAPER, 0.2, "made up", crude),
        "fig15_sensitivity": (sensitivity, exact, "made up"),
        "fig16_uncertainty": (uncertainty, bootstrap, exact, "made up"),
        "fig17_severity": (severity, "made up"),
    }
    return lambda name: getattr(truth_figures, name)(*arguments[name])


def drawn(axes, marker="o"):
    """Return the abscissae of all dots in a panel."""
    return [float(x) for line in axes.get_lines() if line.get_marker() == marker for x in line.get_xdata()]


def bars(axes):
    """Return the ends of all horizontal intervals in a panel."""
    return [tuple(segment[:, 0]) for lines in axes.collections for segment in lines.get_segments()]


def test_estimates_of_all_segments_are_drawn_with_their_intervals(draw):
    figure, data = draw("fig14_estimates_against_truth")
    assert data["kind"].tolist() == ["exact", "paper"] + 7 * ["estimate"]
    assert data["method"].dropna().tolist() == [
        *(m for m in ("single", "piecewise", "heuristic") for _ in range(2)),
        "crude",
    ]
    axes = figure.axes[0]
    assert drawn(axes, style_of("single")["marker"]) == [8e-7, 9.5e-7]
    assert drawn(axes, style_of("crude")["marker"]) == [7.7e-7]
    expected = [PAPER, *3 * [(0.8 * p, 1.2 * p) for p in (8e-7, 9.5e-7)], (6.3e-7, 9.3e-7)]
    assert np.sort(bars(axes), axis=0) == pytest.approx(np.sort(expected, axis=0))
    reach = -ndtri(0.1) * 4e-10
    assert data.loc[0, ["ci_low", "ci_high"]].tolist() == pytest.approx([9e-7 - reach, 9e-7 + reach])


def test_without_crude_monte_carlo_and_without_crashes_there_is_a_figure(estimates, exact):
    estimates = estimates.assign(probability=0.0, ci_low=0.0, ci_high=1.0)
    figure, data = truth_figures.fig14_estimates_against_truth(estimates, exact, PAPER, 0.2, "made up")
    assert "crude" not in data["method"].tolist()
    # The interval [0, 1] of an estimate without crashes does not squeeze all others into a line.
    assert figure.axes[0].get_xlim()[1] < 2e-6


@pytest.mark.parametrize("name", ["fig14_estimates_against_truth", "fig16_uncertainty"])
def test_where_the_truth_is_zero_the_figure_says_that_nothing_crashes(draw, exact, name):
    def texts():
        figure, _ = draw(name)
        return [text.get_text() for text in figure.axes[0].texts]

    assert "no crash" not in texts()
    exact["probability"] = 0.0
    assert "no crash" in texts()


def test_choices_are_drawn_beside_the_study(draw, sensitivity):
    figure, data = draw("fig15_sensitivity")
    axes, caps = figure.axes  # the caps would squeeze the others
    assert drawn(axes) == sensitivity["probability"].tolist()[:4]
    assert drawn(caps) == [9e-10]
    assert data["ratio"].tolist() == pytest.approx([1, 1, 10, 4.0 / 0.9, 5 / 9, 1e-3])
    labels = [label.get_text() for label in axes.get_yticklabels()]
    assert labels[:4] == ["two pieces", "single", "0.99", "5–20–35"]
    assert labels[4:] == ["model", "knot of $TTC^{-1}$", "segments of $v_L$ [m/s]"]


def test_the_budget_is_drawn_with_every_refit(draw, uncertainty, bootstrap):
    figure, data = draw("fig16_uncertainty")
    axes = figure.axes[0]
    assert drawn(axes, "|") == bootstrap["probability"].tolist()
    assert drawn(axes) == uncertainty["probability"].tolist()
    assert np.array(bars(axes)) == pytest.approx(uncertainty[["ci_low", "ci_high"]].to_numpy())
    assert [text.get_text() for text in axes.texts] == ["1.0 %", "19.0 %", "80.0 %", "100.0 %", "variance"]
    assert data["kind"].value_counts().to_dict() == {"budget": 4, "refit": 2, "exact": 1}


def test_severity_is_drawn_by_segment_and_near_misses_over_all(draw):
    figure, data = draw("fig17_severity")
    top, bottom = figure.axes
    assert {line.get_label(): line.get_ydata().tolist() for line in top.get_lines()} == {
        "all segments": [0.9, 0.2],
        "5–15 m/s": [0.9, 0.2],
    }
    assert drawn(bottom) == pytest.approx([9e-7, 1.35e-6, 4.5e-5])
    assert set(data.loc[data["panel"] == "b", "segment"]) == {"all"}


def test_simulations_follow_from_the_variation(exact):
    variation = pd.DataFrame(
        {
            "method": ["single", "single", "single", "piecewise"],
            "segment": ["all", "all", "5-15", "all"],
            "variation": [10.0, 20.0, 99.0, math.inf],
            "variation_trimmed": [10.0, 20.0, 99.0, 5.0],
            "decay": [1.9, 2.1, 1.0, 1.0],
        }
    )
    table = needed_simulations(variation, exact, 0.2, 0.2).set_index(["scope", "method"])
    unit = 25 * ndtri(0.1) ** 2
    assert table.loc["all", "simulations"].to_dict() == pytest.approx(
        {"single": 250 * unit, "piecewise": 25 * unit, "crude": unit * (1 / 9e-7 - 1)}
    )
    assert table.loc[("5-15", "single"), "simulations"] == pytest.approx(99**2 * unit)
    assert table.loc["all", "infinite"].to_dict() == {"single": 1, "piecewise": 0, "crude": 0}
    assert table.loc["all", "hidden"].to_dict() == {"single": 0, "piecewise": 1, "crude": 0}
    assert table.loc[("all", "single"), "decay"] == 2.1
    assert table["paper_simulations"].dropna().to_dict() == {
        ("all", "single"): 12320,
        ("all", "piecewise"): 7840,
        ("all", "crude"): 5.5e7,
    }
    never = needed_simulations(variation, exact.assign(probability=0.0), 0.2, 0.2)
    assert "crude" not in never["method"].tolist()


def test_one_converged_run_has_more_of_the_variance_than_many():
    budget = {"source": ["sampling", "data", "choice of model"], "standard_deviation": [0.0, 3.0, 4.0]}
    uncertainty = pd.DataFrame(budget).assign(probability=[1.0, 10.0, 10.0])
    error = (0.2 / 1.2815515655446004) ** 2
    assert share_of_one_run(uncertainty, 0.2, 0.2) == pytest.approx(error / (error + 0.25))
