"""The page of the book with the figures that modules of the user register."""

import matplotlib.pyplot as plt
import pandas as pd
import pytest
from accelerated_evaluation.publishing.book.site import Parts
from accelerated_evaluation.publishing.published import FIGURES
from accelerated_evaluation.publishing.study import Study
from conftest import ROOT


@pytest.fixture
def parts(tmp_path, monkeypatch):
    def mine_7(answer: pd.DataFrame) -> None:
        """Mine.

        Its second paragraph has 2 * 3 words.
        """

    monkeypatch.setitem(FIGURES._members, "mine_7", mine_7)
    (tmp_path / "contents.json").write_text('["laws/answer.csv"]')
    drawn, _ = plt.subplots()
    drawn.savefig(tmp_path / "mine_7.png")
    return Parts(Study(tmp_path, tmp_path), [], {}, [], ROOT, added=["mine_7"])


def test_the_docstring_is_the_caption(parts):
    text = parts.figure("mine_7")
    assert "**mine_7.** Mine." in text
    assert r"2 \* 3 words" in text
    assert "rule: `draw_mine_7`" in text
    assert "(test_added_figures.py, line " in text
    assert "`laws/answer.csv`" in text
