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


@pytest.mark.parametrize(
    ("share", "written"),
    [
        (1.0, "every draw"),
        (0.0, "no draw"),
        (0.9996, "more than 99 % of the draws"),
        (0.0004, "less than 1 % of the draws"),
        (0.987, "99 % of the draws"),
        (0.25, "25 % of the draws"),
    ],
)
def test_a_share_of_the_draws_is_all_of_them_only_if_it_is(share, written):
    assert fill("{{ share | of_draws }}", {"share": share}).replace("\N{NO-BREAK SPACE}", " ") == written


@pytest.mark.parametrize(
    ("placeholder", "written"),
    [
        ("0.99996 | percent", "more than 99 %"),
        ("0.004 | percent", "less than 1 %"),
        ("0.00004 | percent(2)", "less than 0.01 %"),
        ("1.0 | percent", "100 %"),
        ("0.0 | percent(1)", "0.0 %"),
        ("0.004 | percent(0, '+')", "+0 %"),  # a change, and no share
    ],
)
def test_a_share_is_rounded_to_nothing_or_everything_only_if_it_is(placeholder, written):
    assert fill(f"{{{{ {placeholder} }}}}", {}).replace("\N{NO-BREAK SPACE}", " ") == written


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
