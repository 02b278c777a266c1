"""Tables in notebooks: no index, headers in words, no column of one value, no cut cell, not all rows."""

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.publishing.tables.display import (
    LONG,
    SHOWN,
    as_html,
    presented,
    reproducible_value,
)

LENGTHY = "none, an end of the 80 % interval of 200,000 simulations is closer to the paper's number than ours"


def frame(rows):
    return pd.DataFrame(
        {"vehicle": ["cc_human", "mine"] * rows, "ours_low": range(2 * rows), "data": "made up"}
    )


def test_a_short_table_has_no_index_and_no_column_that_repeats_one_value():
    html = as_html(frame(2))
    assert "<p>In every row, <em>data</em> is made up.</p>" in html
    both = as_html(frame(2).assign(study="mine"))
    assert "<p>In every row, <em>data</em> is made up and <em>study</em> is mine.</p>" in both
    assert "<th>ours, from</th>" in html
    assert html.count("<th>") == 2
    assert html.count("careful human (UN R157)") == html.count("<td>mine</td>") == 2


def test_no_cell_is_cut_and_nothing_is_html():
    html = as_html(pd.DataFrame({"spread": [LENGTHY, "<b>"], "within": [True, np.bool_(False)]}))
    assert LENGTHY in html
    assert "&lt;b&gt;" in html
    assert [word in html for word in ("<td>yes</td>", "<td>no</td>", "True")] == [True, True, False]


@pytest.mark.parametrize(("rows", "shown"), [(LONG, LONG), (LONG + 1, SHOWN)])
def test_of_a_long_table_the_first_rows_are_shown_and_the_place_of_the_others_is_named(rows, shown):
    html = as_html(pd.DataFrame({"number": range(rows)}), "They are in numbers.csv.")
    assert [f"<td>{number}</td>" in html for number in range(rows)] == [row < shown for row in range(rows)]
    assert (f"<p>These are {SHOWN} of {rows} rows. They are in numbers.csv.</p>" in html) == (shown < rows)


def test_an_index_with_a_meaning_is_a_column():
    table = pd.DataFrame({"share": [0.1, 0.9]}, index=["slow", "fast"])
    assert presented(table).iloc[:, 0].tolist() == ["slow", "fast"]
    named = table.set_axis(pd.RangeIndex(1, 3, name="iteration"))
    assert presented(named).columns.tolist() == ["iteration", "share"]
    assert presented(table.set_axis([5, 7])).columns.tolist() == ["share"]
    nested = pd.DataFrame(
        {"f": [1, 2]}, index=pd.MultiIndex.from_tuples([("5-15", "R⁻¹"), ("15-25", "TTC⁻¹")])
    )
    assert presented(nested).to_numpy().tolist() == [["5-15", "R⁻¹", 1], ["15-25", "TTC⁻¹", 2]]
    two = pd.DataFrame({("single", "share"): [1, 2], ("piecewise", "share"): [3, 4]})
    assert as_html(two).count("<th") > 2


@pytest.mark.parametrize("value", [1 / 8e6 * 3, 0.1234565, 79 / 2e6 * 0.9375, 2 / 3, 1 - 1e-16, 1e-300])
def test_the_last_digits_of_a_processor_change_nothing(value):
    rounded = reproducible_value(value)
    assert {reproducible_value(value * (1 + k * 1e-13)) for k in (-1, 1)} == {rounded}
    assert rounded == pytest.approx(value, rel=5.1e-6)
