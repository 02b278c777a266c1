"""Figures of a study of another scenario: labels with units, scales that show all values."""

import numpy as np
import pandas as pd
from accelerated_evaluation.publishing.figures.answer import fig25_vehicles
from accelerated_evaluation.publishing.figures.extrapolation import fig37_extrapolation
from accelerated_evaluation.publishing.figures.surrogate import fig35_scenario_methods
from accelerated_evaluation.publishing.tables.laws import vehicles_digest
from accelerated_evaluation.publishing.tables.methods import contradicted, methods_table
from accelerated_evaluation.scenarios.left_turn import LEFT_TURN
from accelerated_evaluation.scenarios.pedestrian import PEDESTRIAN
from scipy.special import ndtri

SOURCE = "made up"
EXTRAPOLATION = pd.DataFrame({"part": ["all", "recorded", "near", "far"], "share": [1.0, 0.26, 0.68, 0.06]})


def drawn_crashes(scenario, extrapolation=EXTRAPOLATION):
    x = np.random.default_rng(1).uniform(*scenario.limits.T, size=(30, 3))
    points = pd.DataFrame(x, columns=scenario.names)
    return fig37_extrapolation(extrapolation, points.assign(part="near"), points, scenario, SOURCE)


def methods(converged=(True, True, False), probability=(0.02, 0.021, 0.0001)):
    return pd.DataFrame(
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
            "events": 50,
            "exact": np.nan,
            "exact_error": np.nan,
        }
    )


def drawn_methods(*given, **named):
    return fig35_scenario_methods(methods(*given, **named), 0.2, SOURCE)


def test_a_speed_without_a_sign_is_drawn_as_the_laws_treat_it():
    drawn, points = drawn_crashes(PEDESTRIAN)
    assert points["pedestrian_speed_mps"].min() >= 0
    assert points["records"].sum() == 30
    (axes,) = drawn.axes
    assert axes.get_xlabel() == "|pedestrian speed| [m/s]"
    assert (axes.get_xscale(), axes.get_yscale()) == ("asinh", "linear")
    assert [label.get_text() for label in axes.get_xticklabels()][:3] == ["0", "0.1", "1"]
    assert len(axes.get_xticks(minor=True)) > 8
    shown = [text.get_text() for text in drawn.legends[0].get_texts()]
    assert "68 % farther away than most records are" in shown
    (axes,) = drawn_crashes(LEFT_TURN)[0].axes
    assert axes.get_ylabel() == "distance to conflict [m]"


def test_an_answer_without_crashes_has_a_figure_of_its_records():
    drawn, _ = drawn_crashes(LEFT_TURN, pd.DataFrame(columns=["part"]))
    assert not drawn.legends
    assert drawn.axes[0].get_title(loc="left") == "grey: records"


def test_vehicles_of_a_scenario_without_references_have_no_ratio():
    vehicles = pd.DataFrame({"vehicle": ["under test", "b"], "resolved": True, "probability": [0.02, 0.01]})
    ends = {
        "low95": 0.5,
        "low80": 0.7,
        "low50": 0.9,
        "median": 1.0,
        "high50": 1.1,
        "high80": 1.3,
        "high95": 1.5,
    }
    vehicles = vehicles.assign(**{name: vehicles["probability"] * factor for name, factor in ends.items()})
    vehicles = vehicles.assign(recorded=np.nan, expected=np.nan)
    drawn, _ = fig25_vehicles(vehicles, LEFT_TURN, SOURCE)
    assert len(drawn.axes) == 1
    assert "probability of an encounter" in drawn.axes[0].get_xlabel()
    shown = vehicles_digest(vehicles.assign(contradicted_by_counts=[False, True]))
    assert [*shown] == ["vehicle", "median", "80 %"]
    assert [*shown["vehicle"]] == ["car under test", "b (contradicted by counts)"]


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


def test_a_converged_estimate_far_from_the_others_is_contradicted():
    """The third one is far from the two others, which agree; before it converges it claims nothing."""
    assert not contradicted(methods(), 0.2).any()
    wrong = methods(converged=True)
    assert contradicted(wrong, 0.2).tolist() == [False, False, True]
    assert contradicted(wrong.assign(exact=1e-4, exact_error=0.01), 0.2).tolist() == [True, True, False]
    apart = wrong.assign(law=["a", "b", "c"])  # estimates under other laws say nothing
    assert not contradicted(apart, 0.2).any()
    assert methods_table(wrong, 0.2)["contradicted"].tolist() == [0, 0, 1]
    drawn, table = fig35_scenario_methods(wrong, 0.2, SOURCE)
    assert "contradicted" in [text.get_text() for text in drawn.legends[0].get_texts()]
    assert table["contradicted"].sum() == 1


def test_few_estimates_within_their_errors_are_seldom_contradicted():
    """Of estimates with the errors that their intervals state, four errors are exceeded by almost none."""
    generator, error, size = np.random.default_rng(7), 0.15, 400
    logs = error * generator.standard_normal(size)
    rows = pd.DataFrame({"law": "a", "event": "crash", "probability": 1e-5 * np.exp(logs), "converged": True})
    reach = np.exp(ndtri(0.9) * error)
    rows = rows.assign(ci_low=rows["probability"] / reach, ci_high=rows["probability"] * reach)
    rows = rows.assign(exact=np.nan, exact_error=np.nan)
    assert contradicted(rows, 0.2).sum() <= 1  # expected 0.03
    too_short = rows.assign(ci_low=rows["probability"] / 1.05, ci_high=rows["probability"] * 1.05)
    assert contradicted(too_short, 0.2).mean() > 0.2
