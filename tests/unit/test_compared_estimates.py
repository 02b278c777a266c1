"""Two vehicles under the same draws: their ratio is far better known than the quotient of two intervals."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.answer.compared import compare, compare_estimates
from accelerated_evaluation.answer.references import vehicles_with
from accelerated_evaluation.answer.reweighting import SampledPosterior
from accelerated_evaluation.answer.study import UNDER_TEST
from accelerated_evaluation.base.errors import InputError
from scipy.stats import norm

SIZE = 3000
LAW = np.random.default_rng(1).normal(0, 0.6, SIZE)  # the same for both vehicles
OWN = np.random.default_rng(2).normal(0, 0.1, SIZE)


def posterior(logs, error):
    return SampledPosterior(np.exp(logs), np.full(SIZE, error), np.zeros(SIZE, int), 1000)


def test_the_ratio_has_the_error_of_both_samplings_and_not_that_of_the_law():
    found = compare(posterior(LAW + OWN - 0.2, 0.1), posterior(LAW, 0.05))
    deviation = np.sqrt(0.1**2 + 0.1**2 + 0.05**2)
    width = np.log(found["ratio_high80"] / found["ratio_low80"])
    assert np.log(found["ratio"]) == pytest.approx(-0.2, abs=0.02)
    assert width == pytest.approx(2 * norm.isf(0.1) * deviation, rel=0.06)
    assert found["safer"] == pytest.approx(norm.cdf(0.2 / deviation), abs=0.02)
    unpaired = compare(posterior(LAW + OWN - 0.2, 0.1), posterior(LAW[::-1], 0.05))  # other draws: wrong
    assert np.log(unpaired["ratio_high80"] / unpaired["ratio_low80"]) > 3 * width


def test_lapses_that_no_run_has_shown_are_in_the_ratio():
    """With the bound 0.5 the first vehicle may crash more often than the second in every draw."""
    own, other = posterior(LAW - 5, 0.1), posterior(LAW - 3, 0.1)
    without = compare(own, other)
    found = compare(replace(own, unseen_lapses=0.5), other)
    assert without["safer"] > 0.999 > 0.1 > found["safer"]
    assert (found["ratio"], found["ratio_low80"]) == (without["ratio"], without["ratio_low80"])
    expected = np.quantile((own.probabilities + 0.5) / other.probabilities, 0.9)
    assert found["ratio_high80"] == pytest.approx(expected, rel=0.05)
    turned = compare(other, replace(own, unseen_lapses=0.5))
    assert turned["ratio_low80"] == pytest.approx(1 / found["ratio_high80"], rel=0.01)
    assert turned["safer"] == pytest.approx(1 - without["safer"], abs=0.001)


def test_an_estimate_under_another_law_is_refused(tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "law.json").write_text(name)
        (tmp_path / name / "draws.csv").write_text("draw\n")
        (tmp_path / name / "answer.csv").write_text("replicate,event\n0,crash\n")
    with pytest.raises(InputError, match="draws of another law"):
        compare_estimates(tmp_path / "a", [tmp_path / "b"])


def test_an_estimate_of_another_event_is_refused(tmp_path):
    for name, event in (("a", "crash"), ("b", "TTC at most 1 s")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "law.json").write_text("one law")
        (tmp_path / name / "draws.csv").write_text("draw\n")
        (tmp_path / name / "answer.csv").write_text(f"replicate,event\n0,{event}\n")
    with pytest.raises(InputError, match="the event TTC at most 1 s; expected crash"):
        compare_estimates(tmp_path / "a", [tmp_path / "b"])


def test_lapses_that_no_run_has_shown_are_in_the_table_of_a_slow_vehicle():
    own = posterior(LAW - 5, 0.1)
    human = SimpleNamespace(probabilities=np.exp(LAW - 3), recorded=None)
    without, found = (
        vehicles_with(each, {"cc_human": human}, 100).set_index("vehicle")
        for each in (own, replace(own, unseen_lapses=0.5))
    )
    pd.testing.assert_frame_equal(found.drop(index=UNDER_TEST), without.drop(index=UNDER_TEST))
    row, before = found.loc[UNDER_TEST], without.loc[UNDER_TEST]
    for name in ("high50", "high80", "high95"):
        assert row[name] == pytest.approx(before[name] + 0.5)
    for name in ("low80", "median", "ratio", "ratio_low80"):
        assert row[name] == before[name]
    assert before["safer"] > 0.999 > 0.1 > row["safer"]
    assert row["ratio_high80"] > 5 > before["ratio_high80"]
