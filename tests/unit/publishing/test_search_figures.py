"""Figures of the search: what they draw is what the trace says, and they can be read in grey."""

import math

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.laws.distributions import BoundedExponential, Empirical, PiecewiseMixture
from accelerated_evaluation.laws.paper.models import IndependentLaw
from accelerated_evaluation.publishing.figures import flow as flow_figures
from accelerated_evaluation.publishing.figures import searches as search_figures
from accelerated_evaluation.publishing.figures.flow import FLOW_ARROWS, flow_boxes
from accelerated_evaluation.publishing.figures.style import save_figure
from accelerated_evaluation.study.configuration import load

SETTINGS = load()["cross_entropy"]
KNOT = 0.2
ITERATIONS = 5


@pytest.fixture
def model():
    pieces = BoundedExponential(3.0, 0.0, KNOT), BoundedExponential(20.0, KNOT, math.inf)
    law = PiecewiseMixture((0.9, 0.1), pieces)
    return IndependentLaw("made up", {"5-15": 10}, law, {"5-15": law}, {"5-15": Empirical([10.0])})


@pytest.fixture
def trace():
    rows = []
    for method, segment, seed in [
        (m, s, k) for m in ("single", "piecewise") for s in ("5-15", "x") for k in (0, 1)
    ]:
        for step in range(ITERATIONS):
            threshold = math.nan if step == 0 else max(4.0 - 2 * step + seed, 0.0)
            row = {"method": method, "segment": segment, "seed": seed, "iteration": step + 1}
            row |= {
                "threshold_ttc_s": threshold,
                "threshold_range_m": 0.1 * threshold,
                "events": 100.0 + seed,
            }
            for variable in ("inverse_range", "inverse_ttc"):
                weight = 0.9 - 0.2 * step + 0.01 * seed * step
                row |= {f"{variable}_weight_1": weight, f"{variable}_weight_2": 1 - weight}
                row |= {
                    f"{variable}_theta_1": 2.0 * step,
                    f"{variable}_theta_2": 4.0 * step + seed * (step > 0),
                }
                row |= {f"{variable}_from_1": 0.0, f"{variable}_from_2": KNOT}
            rows.append(row)
    return pd.DataFrame(rows)


def figures(trace, model):
    return {
        "fig03": flow_figures.fig03_cross_entropy_flow(SETTINGS),
        "fig08": search_figures.fig08_thresholds(trace, "5-15", "made up"),
        "fig09": search_figures.fig09_inverse_range_parameters(trace, "5-15", "made up"),
        "fig10": search_figures.fig10_inverse_ttc_parameters(trace, "5-15", "made up"),
        "fig11": search_figures.fig11_inverse_ttc_density(trace, model, "5-15", "made up"),
    }


def test_flow_reaches_every_step_and_ends():
    boxes = flow_boxes(SETTINGS)
    reached, waiting = set(), ["start"]
    while waiting:
        name = waiting.pop()
        if name not in reached:
            reached.add(name)
            waiting += [arrow.end for arrow in FLOW_ARROWS if arrow.start == name]
    assert reached == set(boxes)
    for name, box in boxes.items():
        answers = [arrow.answer for arrow in FLOW_ARROWS if arrow.start == name]
        expected = ["no", "yes"] if box.question else [] if name == "end" else [""]
        assert sorted(answers) == expected


def test_flow_shows_the_settings_that_the_search_runs_with():
    changed = SETTINGS | {
        "sample_size": 4321,
        "minimum_events": 77,
        "event_quantile": 0.25,
        "crash_iterations": 9,
    }
    texts = " ".join(box.text for box in flow_boxes(changed).values())
    for shown in ("N = 4,321", "77\ncrashes", "the 0.25 quantile", "event 9 times"):
        assert shown in texts
        assert shown not in " ".join(box.text for box in flow_boxes(SETTINGS).values())


def test_flow_texts_fit_their_boxes_and_boxes_do_not_overlap():
    figure, _ = flow_figures.fig03_cross_entropy_flow(SETTINGS)
    figure.draw_without_rendering()
    (axes,) = figure.axes
    texts = {text.get_text(): text for text in axes.texts}
    inside = axes.transData.inverted()
    boxes = list(flow_boxes(SETTINGS).values())
    for box in boxes:
        extent = texts[box.text].get_window_extent().transformed(inside)
        room = (
            (extent.width / box.width + extent.height / box.height)
            if box.question
            else extent.width / box.width
        )
        # A rectangle fits into a rhombus if its shares of the diagonals sum to at most one; its lines are
        # shorter towards top and bottom, which leaves a little over.
        assert room <= (1.15 if box.question else 1)
        assert extent.height <= box.height
    for number, one in enumerate(boxes):
        for two in boxes[number + 1 :]:
            apart_x = abs(one.x - two.x) >= (one.width + two.width) / 2
            apart_y = abs(one.y - two.y) >= (one.height + two.height) / 2
            assert apart_x or apart_y


def test_thresholds_are_those_of_the_piecewise_search_in_the_segment(trace):
    figure, data = search_figures.fig08_thresholds(trace, "5-15", "made up")
    assert len(data) == 2 * ITERATIONS
    first = data[data["seed"] == 0]
    assert math.isnan(first["threshold_ttc_s"].iloc[0])
    assert first["threshold_ttc_s"].tolist()[1:] == [2.0, 0.0, 0.0, 0.0]
    np.testing.assert_allclose(data["threshold_range_m"], 0.1 * data["threshold_ttc_s"])
    drawn = figure.axes[0].get_lines()[0]
    np.testing.assert_array_equal(drawn.get_ydata(), first["threshold_ttc_s"])
    # The x axis begins at iteration 1, which has no event, as in figures 9 and 10.
    assert drawn.get_xdata()[0] == 1


@pytest.mark.parametrize(("number", "unit"), [("09", "m"), ("10", "s")])
def test_parameters_are_tidy_and_complete(trace, model, number, unit):
    _, data = figures(trace, model)[f"fig{number}"]
    assert data.columns.tolist() == [
        "seed",
        "iteration",
        "piece",
        f"from_per_{unit}",
        "weight",
        f"theta_{unit}",
    ]
    assert len(data) == 2 * ITERATIONS * 2
    np.testing.assert_allclose(data.groupby(["seed", "iteration"])["weight"].sum(), 1)
    last = data[(data["seed"] == 0) & (data["iteration"] == ITERATIONS) & (data["piece"] == 2)].iloc[0]
    assert last["weight"] == pytest.approx(0.9)
    assert last[f"theta_{unit}"] == 16.0
    assert last[f"from_per_{unit}"] == KNOT


def test_densities_are_rebuilt_from_the_trace(trace, model):
    _, data = search_figures.fig11_inverse_ttc_density(trace, model, "5-15", "made up")
    law = model.inverse_ttc["5-15"]
    assert data["iteration"].unique().tolist() == [1, 2, 3, 5]
    start = data[data["iteration"] == 1]
    np.testing.assert_allclose(start["density_s"], np.exp(law.logpdf(start["inverse_ttc_per_s"])), rtol=1e-12)
    end = data[data["iteration"] == ITERATIONS]
    x = end["inverse_ttc_per_s"].to_numpy()
    # Weights 0.1 and 0.9; tilts 8 and 16 leave rates of -5 and 4, both in closed form.
    body = 0.1 * 5 * np.exp(5 * x) / np.expm1(5 * KNOT)
    tail = 0.9 * 4 * np.exp(-4 * (x - KNOT))
    np.testing.assert_allclose(end["density_s"], np.where(x < KNOT, body, tail), rtol=1e-9)
    # The axis ends where 2 % of f* lie beyond.
    assert x[-1] == pytest.approx(KNOT + math.log(0.9 / 0.02) / 4, rel=1e-6)


def test_a_crash_from_the_first_iteration_on_is_drawn(trace, tmp_path):
    at_once = trace.assign(**{name: trace[name] * 0 for name in ("threshold_ttc_s", "threshold_range_m")})
    drawn, data = search_figures.fig08_thresholds(at_once, "5-15", "data")
    save_figure(drawn, data, tmp_path, "fig08")
    assert not data["threshold_ttc_s"].any()
