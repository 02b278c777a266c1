"""Figures of the estimates: what they draw is what the tables say."""

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.publishing.figures.estimates import (
    fig12_crash_probability,
    fig13_relative_half_width,
)

ALL = ("single", "piecewise", "heuristic")
EXACT = pd.DataFrame({"segment": ["5-15", "all"], "probability": [2e-6, 9e-7]})
STEPS = np.arange(100, 1001, 100)


@pytest.fixture
def course():
    parts = [
        pd.DataFrame(
            {
                "scope": scope,
                "method": method,
                "replicate": replicate,
                "simulations": STEPS,
                "probability": 1e-6 * (1 + 0.1 * replicate),
                "relative_half_width": np.where(STEPS == 100, np.inf, 5 * (1 + rank) / np.sqrt(STEPS)),
            }
        )
        for scope in ("all", "5-15")
        for rank, method in enumerate(ALL)
        for replicate in (0, 1)
    ]
    return pd.concat(parts, ignore_index=True)


@pytest.fixture
def estimates(course):
    ends = course[course["simulations"] == 700].drop(columns="relative_half_width")
    return ends.assign(
        relative_half_width=0.19, ci_low=8e-7, ci_high=1.2e-6, converged=ends["replicate"] == 0
    ).reset_index(drop=True)


def test_estimates_come_with_their_intervals(estimates, course):
    _, data = fig12_crash_probability(estimates, course, EXACT, 0.2, "made up")
    assert data.columns.tolist() == [
        *("kind", "method", "replicate", "simulations", "probability", "ci_low", "ci_high")
    ]
    rows = data[(data["kind"] == "course") & (data["method"] == "single") & (data["replicate"] == 1)]
    assert rows["simulations"].tolist() == STEPS.tolist()
    # Half-width 5 / sqrt(400) of 1.1e-6; with an infinite one there is no interval to draw.
    at = rows[rows["simulations"] == 400].iloc[0]
    assert at[["ci_low", "ci_high"]].tolist() == pytest.approx([1.1e-6 * 0.75, 1.1e-6 * 1.25])
    assert rows[["ci_low", "ci_high"]].iloc[0].isna().all()


def test_only_all_segments_and_two_methods_are_in_figure_12(estimates, course):
    course.loc[course["scope"] == "5-15", "probability"] = 9.0
    _, data = fig12_crash_probability(estimates, course, EXACT, 0.2, "made up")
    assert data["probability"].max() < 1e-5
    assert data["method"].dropna().unique().tolist() == ["piecewise", "single"]
    paper = data[data["kind"] == "paper"]
    assert paper["probability"].tolist() == [7.4e-7]
    assert data.loc[data["kind"] == "exact", "probability"].tolist() == [9e-7]


def test_markers_are_where_replicates_converge(estimates, course):
    for figure, data in (
        fig12_crash_probability(estimates, course, EXACT, 0.2, "made up"),
        fig13_relative_half_width(estimates, course, "5-15", 0.2, "made up"),
    ):
        ends = data[data["kind"] == "converged"]
        assert ends["replicate"].tolist() == [0] * data["method"].nunique()
        places = figure.axes[-1] if "relative_half_width" in data else figure.axes[0]
        markers = [line for line in places.get_lines() if line.get_marker() == "o"]
        assert {int(x) for line in markers for x in line.get_xdata()} == {700}


def test_half_widths_are_those_of_the_segment_alone(estimates, course):
    course.loc[course["scope"] == "all", "relative_half_width"] = 9.0
    _, data = fig13_relative_half_width(estimates, course, "5-15", 0.15, "made up")
    assert data.columns.tolist() == ["kind", "method", "replicate", "simulations", "relative_half_width"]
    assert data["method"].dropna().unique().tolist() == list(ALL)
    assert data["relative_half_width"].max() < 9
    assert data.loc[data["kind"] == "beta", "relative_half_width"].tolist() == [0.15]


def test_the_replicate_in_front_is_the_median_one(course):
    ends = pd.DataFrame({"method": "single", "scope": "5-15", "replicate": [0, 1], "simulations": [300, 200]})
    third = ends.iloc[:1].assign(replicate=2, simulations=900)
    ends = pd.concat([ends, third]).assign(probability=1e-6, relative_half_width=0.2, converged=True)
    three = pd.concat([course, course[course["replicate"] == 0].assign(replicate=2)])
    course = three[three["method"] == "single"]
    figure, _ = fig13_relative_half_width(ends.assign(ci_low=0, ci_high=1), course, "5-15", 0.2, "made up")
    large = [line.get_xdata() for line in figure.axes[1].get_lines() if line.get_markersize() == 6]
    assert [x for xs in large for x in xs] == [300]
