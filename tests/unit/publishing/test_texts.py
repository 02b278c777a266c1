"""Texts of a user in figures, tables and notebooks: shown as they are, and never taken for more."""

import xml.etree.ElementTree as ElementTree

import matplotlib.pyplot as plt
import pandas as pd
import pytest
from accelerated_evaluation.publishing.figures.style import note_source, paper_style, save_figure
from accelerated_evaluation.publishing.tables.display import as_markdown, save_table

NASTY = "costs $5 | \"a\" & 'b' <script>alert(1)</script> --> _x_ *y* `z` [l](javascript:1) \\ R&amp;D"


@pytest.mark.parametrize("text", ["costs $5", "$a_{b$", NASTY])
def test_figures_show_any_source(tmp_path, text):
    with paper_style():
        drawn, axes = plt.subplots()
        axes.plot([1, 2])
        note_source(drawn, text)
    save_figure(drawn, pd.DataFrame({"x": [1]}), tmp_path, "fig")
    words = "".join(ElementTree.parse(tmp_path / "fig.svg").getroot().itertext())
    assert text.replace("$", r"\$").split()[-1].replace("\\$", "$") in words


def test_markdown_tables_keep_their_cells_and_no_tag(tmp_path):
    save_table(pd.DataFrame({"a": ["x < 3 m/s", NASTY], "b": [1, 2]}), tmp_path, "t")
    lines = (tmp_path / "t.md").read_text().splitlines()
    assert [line.count("|") for line in lines] == [3] * 4
    assert "<script" not in lines[3]
    assert "x < 3 m/s" in lines[2]  # left alone, as it is no tag
    assert pd.read_csv(tmp_path / "t.csv")["a"].tolist() == ["x < 3 m/s", NASTY]


def test_markdown_of_what_is_harmless_is_the_text_itself():
    for text in ("two_pieces", "v_L outside [5, 35) m/s", "R&D", "a < b > c", 7, None):
        if text != "R&D":
            assert as_markdown(text) == text
    for mark in ("<script", "$", "|", "](", "`", "*"):
        assert mark not in as_markdown(NASTY)


def test_published_numbers_have_the_digits_that_reproduce(tmp_path):
    table = pd.DataFrame(
        {
            "exact": [1 / 3, 7.4e-7 / 3, 1e300 / 7, float("nan")],
            "whole": [1.0, 20.0, 1e6, -0.0],
            "mixed": [1 / 3, "text", 7, None],
            "count": pd.array([12_345_678_901, 1, 2, None], dtype="Int64"),
            "huge": [2**62 + 1, 1, 2, 3],
        }
    )
    elsewhere = table.assign(exact=table["exact"] * (1 + 1e-15))
    for name, content in (("here", table), ("there", elsewhere)):
        save_table(content, tmp_path, name)
    written = (tmp_path / "here.csv").read_text()
    assert written == (tmp_path / "there.csv").read_text()
    assert written.splitlines()[1] == f"0.333333,1.0,0.333333,12345678901,{2**62 + 1}"
    assert written.splitlines()[4] == ",-0.0,,,3"
    assert table["exact"][0] == 1 / 3  # what is shown and kept is not rounded
