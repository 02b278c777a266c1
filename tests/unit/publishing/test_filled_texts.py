"""Placeholders in the texts of notebooks: what they insert, and how they fail."""

import math

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.base.errors import StudyError
from accelerated_evaluation.publishing.texts import fill


@pytest.mark.parametrize(
    ("placeholder", "written"),
    [
        ("x | number", "1,235"),
        ("x | number(1)", "1,234.6"),
        ("x | number(1, '+')", "+1,234.6"),
        ("share | percent", "12\N{NO-BREAK SPACE}%"),
        ("share | percent(1, '+')", "+12.3\N{NO-BREAK SPACE}%"),
        ("-share | percent(1)", "-12.3\N{NO-BREAK SPACE}%"),
        ("tiny | readable(2)", "7.4\N{NO-BREAK SPACE}×\N{NO-BREAK SPACE}10⁻⁷"),
        ("table['a', 'b'] | number", "3"),
        ("table.max()", "3"),
        ("np_count", "7"),
        ("missing | number(2)", "–"),
        ("missing | percent", "–"),
        ("infinite | number", "∞"),
        # A share is all or nothing only if it is.
        ("1.0 | of_draws", "every draw"),
        ("0.0 | of_draws", "no draw"),
        (
            "0.9996 | of_draws",
            "more\N{NO-BREAK SPACE}than\N{NO-BREAK SPACE}99\N{NO-BREAK SPACE}% of the draws",
        ),
        (
            "0.0004 | of_draws",
            "less\N{NO-BREAK SPACE}than\N{NO-BREAK SPACE}1\N{NO-BREAK SPACE}% of the draws",
        ),
        ("0.25 | of_draws", "25\N{NO-BREAK SPACE}% of the draws"),
        ("0.99996 | percent", "more\N{NO-BREAK SPACE}than\N{NO-BREAK SPACE}99\N{NO-BREAK SPACE}%"),
        ("0.00004 | percent(2)", "less\N{NO-BREAK SPACE}than\N{NO-BREAK SPACE}0.01\N{NO-BREAK SPACE}%"),
        ("1.0 | percent", "100\N{NO-BREAK SPACE}%"),
        ("0.0 | percent(1)", "0.0\N{NO-BREAK SPACE}%"),
        ("0.004 | percent(0, '+')", "+0\N{NO-BREAK SPACE}%"),  # a change, and no share
    ],
)
def test_numbers_keep_their_format(placeholder, written):
    names = {
        "x": 1234.56,
        "share": 0.1234,
        "tiny": 7.4e-7,
        "table": pd.Series({("a", "b"): 3}),
        "np_count": np.int64(7),
        "missing": math.nan,
        "infinite": math.inf,
    }
    assert fill(f"a {{{{ {placeholder} }}}} b", names) == f"a {written} b"


def test_conditions_and_lists_leave_no_empty_lines():
    text = "{% for name, n in runs.items() %}\n- {{ name }}: {{ n }}\n{% else %}\nnone\n{% endfor %}\n"
    assert fill(text, {"runs": {"a": 1, "b": 2}}) == "- a: 1\n- b: 2\n"
    assert fill(text, {"runs": {}}) == "none\n"


def test_formulas_and_percent_signs_are_left_alone():
    text = r"$\frac{z^2_{\alpha/2}}{\beta^{2}}$, a 95 % interval, $100(1-\alpha)\,\%$, {a} and 80 %}"
    assert fill(text, {}) == text


def test_texts_of_a_user_are_shown_as_they_are():
    filled = fill("{{ data }} {{ headline | safe }}", {"data": "costs $5 <b>*x*</b>", "headline": "**ours**"})
    assert filled == "costs <span>&#36;</span>5 &#60;b>&#42;x&#42;&#60;/b> **ours**"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{{ absent }}", "'absent' is undefined"),
        ("{{ 1 / zero }}", "ZeroDivisionError"),
        ("{{ known['no'] }}", "has no"),
        ("{% if zero %}", "TemplateSyntaxError"),
        ("{{ zero | unknown }}", "No filter named 'unknown'"),
    ],
)
def test_a_placeholder_that_fails_is_one_error(text, message):
    with pytest.raises(StudyError, match=message):
        fill(text, {"zero": 0, "known": {}})
