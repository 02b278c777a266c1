"""Figures of a study of another scenario: labels with units, scales that show all values."""

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.publishing.figures import scenario as figures
from accelerated_evaluation.scenarios.left_turn import LEFT_TURN
from accelerated_evaluation.scenarios.pedestrian import PEDESTRIAN

SOURCE = "made up"


def drawn_records(scenario):
    x = np.random.default_rng(1).uniform(*scenario.limits.T, size=(30, 3))
    x[0, 1] = 0  # which a purely logarithmic axis would hide
    points = pd.DataFrame(x, columns=scenario.names)
    runs = points.assign(event=points.index % 2 == 0)
    return figures.fig01_scenario_records(points, runs, scenario, SOURCE)


def drawn_answer(factor=1.0):
    row = {"event": "crash", "encounters": "all encounters", "median": 0.02}
    row |= {"low50": 0.018, "high50": 0.022, "low80": 0.016, "high80": 0.024, "low95": 0.01, "high95": 0.03}
    numbers = [name for name in row if name not in ("event", "encounters")]
    table = pd.DataFrame([row, row])
    table.loc[1, numbers] = table.loc[1, numbers].astype(float) * factor
    return figures.fig02_scenario_answer(table, SOURCE)


def drawn_methods(converged=(True, True, False), probability=(0.02, 0.021, 0.0001)):
    table = pd.DataFrame(
        {
            "law": "heaviest",
            "event": "crash",
            "method": ["crude", "normal_mixture", "surrogate"],
            "replicate": 0,
            "probability": probability,
            "ci_low": [0.018, 0.019, 0.00009],
            "ci_high": [0.022, 0.023, 0.00011],
            "learning": [0, 1000, 100],
            "estimating": [5000, 1500, 50],
            "converged": converged,
        }
    )
    return figures.fig03_scenario_methods(table, 0.2, SOURCE)


def test_a_speed_without_a_sign_is_drawn_as_the_laws_treat_it():
    drawn, points = drawn_records(PEDESTRIAN)
    assert points["pedestrian_speed_mps"].min() == 0
    assert drawn.axes[0].get_ylabel().startswith("|pedestrian speed| [m/s]\n(linear below 0.")
    assert [axes.get_xlabel() for axes in drawn.axes[:2]] == ["vehicle speed [m/s]"] * 2
    assert drawn.axes[0].get_yscale() == drawn.axes[2].get_xscale() == "symlog"
    assert drawn.axes[0].get_xscale() == "linear"
    drawn, points = drawn_records(LEFT_TURN)
    assert drawn.axes[0].get_ylabel().startswith("turning speed [m/s]\n(linear below 0.")


@pytest.mark.parametrize(("factor", "scale"), [(1, "linear"), (0.01, "log")])
def test_probabilities_of_several_decades_have_a_logarithmic_axis(factor, scale):
    drawn, _ = drawn_answer(factor)
    assert drawn.axes[0].get_xscale() == scale


def test_estimates_that_have_not_converged_or_have_no_event_are_marked():
    def labels(drawn):
        return [text.get_text() for text in drawn.legends[0].get_texts()]

    drawn, table = drawn_methods()
    assert labels(drawn)[:2] == ["converged", "not converged"]
    assert labels(drawn)[2].startswith("crude Monte Carlo")
    names = [label.get_text() for label in drawn.axes[0].get_yticklabels()]
    assert names == ["crude,\n5,000 runs", "normal mixture,\n2,500 runs", "surrogate,\n150 runs"]
    assert table["converged"].tolist() == [True, True, False]
    assert "not converged" not in labels(drawn_methods((True, True, True))[0])
    drawn, _ = drawn_methods(probability=(0.0, 0.021, 0.0001))
    assert "no event: upper limit" in labels(drawn)
    (arrow,) = (
        line for line in drawn.axes[0].get_lines() if line.get_marker() == "<" and len(line.get_xdata())
    )
    assert arrow.get_xdata().tolist() == [0.022]
