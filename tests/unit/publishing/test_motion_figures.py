"""The figure of lead motion, and the last row of the budget of the answer."""

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.answer.consequences.lead_motion import COLUMNS, MOTION
from accelerated_evaluation.publishing.figures.lead_motion import GROUPS, fig34_lead_motion
from accelerated_evaluation.publishing.tables.laws import answer_budget_table

NONE = np.nan
MOVING = pd.DataFrame(
    [
        ("under test", "closing", 0.4, 3e-6, 3e-6, 4e-6, 2e-7, 4.4e-6, 1.3, 0.05, 1.1),
        ("under test", "opening", 0.6, NONE, 0.0, 0.0, 0.0, 2e-4, NONE, NONE, NONE),
        ("under test", "all", 1.0, NONE, 1e-6, 2e-6, 2e-7, 1e-4, 1.3, 0.05, 1.1),
        ("late", "closing", 0.4, 3e-4, 3e-4, 4e-3, 2e-4, 4.4e-3, 13.0, 0.5, 3.0),
        ("late", "opening", 0.6, NONE, 0.0, 5e-5, 1e-5, 7e-5, NONE, NONE, NONE),
    ],
    columns=[column for column in COLUMNS if column != "constant_error"],
)
BUDGET = pd.DataFrame(
    {
        "source": ["data", "choice of law", "sampling", "together"],
        "factor": [1.5, 1.4, 1.1, 1.9],
        "variance_share": [0.5, 0.4, 0.1, 1.0],
    }
)


def test_the_figure_has_both_kinds_of_cut_ins_and_the_limits(tmp_path):
    drawn, data = fig34_lead_motion(MOVING, "made up")
    drawn.savefig(tmp_path / "34.png")
    assert data["gap"].tolist() == ["closing", "closing", "opening", "opening"]
    labels = [label.get_text() for label in drawn.axes[0].get_yticklabels()]
    assert set(GROUPS.values()) <= set(labels)
    assert sorted(each.get_text() for each in drawn.axes[0].texts) == ["× constant", "×1.3", "×13"]
    (limit,) = (line for line in drawn.axes[0].lines if line.get_marker() == "<")
    assert limit.get_xdata().tolist() == [2e-4]


def test_the_budget_keeps_its_rows_and_gets_one_more():
    found = answer_budget_table(BUDGET, MOVING)
    pd.testing.assert_frame_equal(found.iloc[:4][list(BUDGET)], BUDGET)
    assert found["source"].iloc[-1] == MOTION
    assert found["effect"].tolist()[-1] == 1.3
    assert 1 < found["factor"].iloc[-1] < 1.3
    share = (np.log(found["factor"].iloc[-1]) / np.log(1.9)) ** 2
    assert found["variance_share"].iloc[-1] == pytest.approx(share)
    for without in (MOVING[MOVING["vehicle"] == "late"], MOVING.iloc[:0]):
        pd.testing.assert_frame_equal(answer_budget_table(BUDGET, without), BUDGET)
