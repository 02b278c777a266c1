"""The checks of all figures find each defect, and the figures of a slow vehicle have none."""

from pathlib import Path

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.publishing.figures.answer import fig23_answer
from accelerated_evaluation.publishing.figures.style import paper_style, save_figure
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.vehicles.replay import write_trace
from figure_checks import defects
from matplotlib import pyplot as plt

EVENTS = ["crash", "impact speed above 5 m/s"]
ANSWER = pd.DataFrame({"event": EVENTS, "median": [4e-6, 1e-6], "probability": [5e-6, 2e-6]})
ANSWER = ANSWER.assign(low50=3e-7, high50=6e-6, low80=2e-7, high80=9e-6, low95=1e-7, high95=2e-5)
ESTIMATE = pd.DataFrame({"probability": [4.5e-6], "ci_low": [4e-6], "ci_high": [5e-6]})


def spoil_font(axes):
    axes.set_xlabel("speed", fontsize=5)


def spoil_overlap(axes):
    axes.text(0.5, 0.5, "one")
    axes.text(0.51, 0.5, "two")


def spoil_edge(axes):
    axes.text(1.2, 0.5, "far outside", transform=axes.transAxes, in_layout=False)


def spoil_grey(axes):
    axes.plot([0, 1], [1, 0], color="#1b7837", label="green")


def spoil_legend(axes):
    axes.figure.legend(*axes.get_legend_handles_labels(), loc="center")


def spoil_width(axes):
    axes.figure.set_size_inches(9, 2)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (spoil_font, "'speed' has 5 pt"),
        (spoil_overlap, "'one' overlaps 'two'"),
        (spoil_edge, "'far outside' leaves the figure"),
        (spoil_grey, "'red' looks like 'green' in grey"),
        (spoil_legend, "the legend covers a panel"),
        (spoil_width, "wider than two columns, so that it is printed smaller"),
    ],
)
def test_each_defect_is_found_alone(spoil, words):
    with paper_style():
        drawn, axes = plt.subplots()
        axes.plot([0, 1], [0, 1], color="#b2182b", label="red")
    assert defects(drawn) == []
    spoil(axes)
    assert defects(drawn) == [words]


def test_the_answer_for_a_slow_vehicle_has_a_row_for_its_simulations_alone():
    drawn, data = fig23_answer(ANSWER, CUT_IN, "made up", sampled_estimate=ESTIMATE)
    assert defects(drawn) == []
    assert data["event"].tolist()[:2] == EVENTS
    assert data["low80"].tolist() == [2e-7, 2e-7, 4e-6]


@pytest.mark.parametrize(("value", "rows"), [(np.nan, 0), (0.0, 2)])
def test_an_answer_without_any_crash_is_drawn(value, rows):
    unknown = ANSWER.assign(**dict.fromkeys(ANSWER.columns[1:], value))
    drawn, data = fig23_answer(unknown, CUT_IN, "made up")
    assert defects(drawn) == []
    assert len(data) == rows


USERS = {
    "text.usetex": True,
    "font.size": 20,
    "axes.facecolor": "black",
    "savefig.facecolor": "red",
    "savefig.bbox": "tight",
    "axes.xmargin": 0.4,
    "lines.linestyle": "--",
    "axes.formatter.use_locale": True,
}


def drawn_in(folder, settings):
    """Return the files of a figure, and of a replay, that a user with such settings draws."""
    with mpl.rc_context(settings):
        with paper_style():
            figure, axes = plt.subplots()
            axes.semilogy([1, 2, 3], [1e-7, 1e-6, 5e-6], label="a_b")
            axes.legend()
        save_figure(figure, pd.DataFrame({"x": [1]}), folder, "fig")
        trace = pd.DataFrame({"time_s": [0.0, 0.1, 0.2], "range": [3.0, 2.5, 2.1]})
        write_trace(trace, folder / "table.csv", folder / "replay.svg", "a_b & c")
        assert mpl.rcParams["font.size"] == settings.get("font.size", mpl.rcParams["font.size"])
    return {path.name: path.read_bytes() for path in Path(folder).iterdir()}


def test_figures_are_the_same_whatever_the_matplotlibrc_of_the_user(tmp_path):
    folders = [tmp_path / name for name in ("plain", "users")]
    for folder in folders:
        folder.mkdir()
    plain, users = (drawn_in(*each) for each in zip(folders, ({}, USERS), strict=True))
    assert len(plain) == 6
    assert plain == users
