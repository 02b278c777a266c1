"""Figures and verdicts of a study in which nothing crashes, or an estimate exceeds 1."""

import math

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.publishing.figures.dot_chart import draw_intervals
from accelerated_evaluation.publishing.figures.estimates import (
    fig12_crash_probability,
    fig13_relative_half_width,
)
from accelerated_evaluation.publishing.figures.exact import fig15_sensitivity, fig17_severity

METHODS = ("piecewise", "single")


def texts(drawn):
    return [text.get_text() for axes in drawn.axes for text in axes.texts]


@pytest.fixture
def nothing():
    """Estimates and courses without an event."""
    rows = [{"method": method, "scope": "all", "replicate": 0} for method in METHODS]
    estimates = pd.DataFrame(rows).assign(
        simulations=200,
        probability=0.0,
        ci_low=0.0,
        ci_high=0.01,
        relative_half_width=np.inf,
        converged=False,
    )
    course = pd.concat(
        pd.DataFrame(rows).assign(simulations=n, probability=0.0, variance=0.0, relative_half_width=np.inf)
        for n in (100, 200)
    )
    return estimates, course


def test_figures_of_estimates_say_that_nothing_crashes(nothing, tmp_path):
    exact = pd.DataFrame({"segment": ["all"], "probability": [0.0]})
    drawn, data = fig12_crash_probability(*nothing, exact, 0.2, "data")
    drawn.savefig(tmp_path / "12.png")
    assert texts(drawn) == ["no crash"] * 2
    assert not data.loc[data["kind"] == "course", "probability"].any()
    drawn, _ = fig13_relative_half_width(*nothing, "all", 0.2, "data")
    drawn.savefig(tmp_path / "13.png")
    assert texts(drawn) == ["no crash"]


def test_figures_of_the_truth_say_that_nothing_crashes(tmp_path):
    exact = pd.DataFrame({"segment": ["all"], "probability": [0.0], "standard_error": [0.0]})
    tried = pd.DataFrame({"choice": ["model", "model"], "value": ["a", "b"], "probability": [0.0, math.nan]})
    drawn, _ = fig15_sensitivity(tried.assign(standard_error=0.0), exact, "data")
    drawn.savefig(tmp_path / "15.png")
    assert "no crash" in texts(drawn)
    rows = [("all", "crash", 0.0), ("all", "impact_speed", 0.0), ("all", "min_range", 1.0)]
    severity = pd.DataFrame(rows, columns=["segment", "quantity", "threshold"])
    severity = severity.assign(probability=0.0, to_crash=math.nan, per_million_km=math.nan)
    drawn, _ = fig17_severity(severity, "data")
    drawn.savefig(tmp_path / "17.png")
    assert "no crash" in texts(drawn)


def test_an_estimate_above_one_is_drawn():
    _, axes = plt.subplots()
    draw_intervals(axes, pd.DataFrame({"probability": [1.04], "ci_low": [0.99], "ci_high": [1.0]}), [0])
