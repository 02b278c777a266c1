"""Two vehicles under the same draws: their ratio is far better known than the quotient of two intervals."""

import json
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import InputError, Posterior, SampledPosterior, compare
from accelerated_evaluation.answer.comparison import (
    compare_estimates,
    draws_table,
    posterior_of,
    require_estimate,
    vehicle_row,
    vehicle_table,
)
from accelerated_evaluation.answer.posterior import answer_row
from accelerated_evaluation.answer.study_tables import UNDER_TEST
from scipy.stats import norm

SIZE = 3000
LAW = np.random.default_rng(1).normal(0, 0.6, SIZE)  # the same for both vehicles
MEMBER = np.random.default_rng(3).integers(0, 2, SIZE)
OWN = np.random.default_rng(2).normal(0, 0.1, SIZE)


def posterior(logs, error):
    return SampledPosterior(np.exp(logs), np.zeros(SIZE, int), np.full(SIZE, error), 1000)


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


DRAWS = pd.DataFrame(
    {
        "replicate": 0, "draw": [1, 2, 3], "law": ["a", "b", "a"], "probability": [1e-6, 2e-6, 3e-6],
        "error": 0.1, "shared_error": 0.1, "own_error": 0.01, "batches": 20, "unseen_lapses": 0.0,
    }
)  # fmt: skip


def written(folder, law="one law", event="crash", draws=DRAWS, converged=True):
    """Write the files of an estimate that are compared, and return the folder."""
    folder.mkdir()
    (folder / "law.json").write_text(json.dumps({"kind": law, "verdict": str(folder)}))
    draws.to_csv(folder / "draws.csv", index=False)
    pd.DataFrame({"replicate": [0], "event": [event]}).to_csv(folder / "answer.csv", index=False)
    pd.DataFrame({"replicate": [0], "converged": [converged]}).to_csv(folder / "estimate.csv", index=False)
    return folder


def test_estimates_in_two_folders_are_compared(tmp_path):
    own = written(tmp_path / "a", draws=DRAWS.assign(probability=DRAWS["probability"] / 2))
    found = compare_estimates(own, [written(tmp_path / "b", converged=False)])
    assert found["ratio"].iloc[0] == pytest.approx(0.5, rel=1e-6)
    assert found["other_converged"].tolist() == [False]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"law": "another"}, "seen draws of another law; expected the same law.json"),
        ({"event": "TTC at most 1 s"}, "the event TTC at most 1 s; expected crash"),
        ({"draws": DRAWS.head(2)}, "draws.csv: seen 2 draws of the law; expected 3"),
        ({"draws": pd.concat([DRAWS, DRAWS])}, "draws.csv: seen 6 draws of the law; expected 3"),
        ({"draws": DRAWS.head(0)}, "draws.csv: seen no rows"),
        ({"draws": DRAWS.assign(replicate=1)}, "draws.csv: seen no rows"),
        ({"draws": DRAWS.assign(error=np.nan)}, "draws.csv: seen a cell that is missing or no number"),
        ({"draws": DRAWS.assign(error=np.inf)}, "draws.csv: seen a cell that is missing or no number"),
        ({"draws": DRAWS.assign(probability="x")}, "draws.csv: seen a cell that is missing or no number"),
        ({"draws": DRAWS.drop(columns="law")}, "draws.csv, column 'law'"),
        (
            {"draws": DRAWS.assign(probability=[1e-6, -2e-6, 1e-6])},
            "seen -2e-06 in row 3, column probability",
        ),
        ({"draws": DRAWS.assign(probability=1.5)}, "seen 1.5 in row 2, column probability; expected 0 to 1"),
        ({"draws": DRAWS.assign(batches=0)}, "seen 0 in row 2, column batches; expected 1 to 1e+06"),
        ({"draws": DRAWS.assign(error=1e300)}, "seen 1e+300 in row 2, column error; expected 0 to 1000"),
        ({"draws": DRAWS.assign(own_error=-0.1)}, "seen -0.1 in row 2, column own_error"),
        ({"draws": DRAWS.assign(shared_error=1e4)}, "seen 10000 in row 2, column shared_error"),
        ({"draws": DRAWS.assign(unseen_lapses=2)}, "seen 2 in row 2, column unseen_lapses"),
    ],
)
def test_other_estimates_that_cannot_be_compared_are_one_message(tmp_path, changes, message):
    own = written(tmp_path / "a")
    with pytest.raises(InputError, match=re.escape(message)):
        compare_estimates(own, [written(tmp_path / "b", **changes)])


@pytest.mark.parametrize("text", ["", "\x00\x01", "replicate,law\n0,"])
def test_a_file_of_draws_that_is_cut_is_one_message(tmp_path, text):
    other = written(tmp_path / "b")
    (other / "draws.csv").write_text(text)
    with pytest.raises(InputError, match=r"draws.csv"):
        require_estimate(other)


def test_lapses_that_no_run_has_shown_are_in_the_table_of_a_slow_vehicle():
    own = posterior(LAW - 5, 0.1)
    human = Posterior(np.exp(LAW - 3), np.zeros(SIZE, int))
    without, found = (tabulated(each, human) for each in (own, replace(own, unseen_lapses=0.5)))
    pd.testing.assert_frame_equal(found.drop(index=UNDER_TEST), without.drop(index=UNDER_TEST))
    row, before = found.loc[UNDER_TEST], without.loc[UNDER_TEST]
    for name in ("high50", "high80", "high95"):
        assert row[name] == pytest.approx(before[name] + 0.5)
    for name in ("low80", "median", "ratio", "ratio_low80"):
        assert row[name] == before[name]
    assert before["safer"] > 0.999 > 0.1 > row["safer"]
    assert row["ratio_high80"] > 5 > before["ratio_high80"]


def tabulated(own, human):
    """Return the table of two vehicles, indexed by their names."""
    posteriors = {UNDER_TEST: own, "cc_human": human}
    answers = {k: SimpleNamespace(posterior=v, replayed=None, notes={}) for k, v in posteriors.items()}
    rows = pd.DataFrame([vehicle_row(name, answer) for name, answer in answers.items()])
    return vehicle_table(rows, posteriors, {"": "cc_human"}).set_index("vehicle")


@pytest.mark.parametrize("own", [None, np.full(SIZE, 0.02)])
def test_a_posterior_is_read_back_from_the_table_of_its_draws(own):
    """Studies compare vehicles by this table, and must get the ratios of the answer itself."""
    shared = np.nan if own is None else 0.08
    sampled = SampledPosterior(np.exp(LAW), MEMBER, np.full(SIZE, 0.1), 12, shared, own, 0.003)
    for known in (sampled, Posterior(np.exp(LAW), MEMBER)):
        names = tuple(np.array(["a", "b"])[MEMBER])
        drawn = SimpleNamespace(size=SIZE, names=names)
        table = draws_table(SimpleNamespace(posterior=known, draws=drawn, simulations=150))
        again = posterior_of(table)
        assert type(again) is type(known)
        assert again.member.tolist() == MEMBER.tolist()
        assert answer_row(again) == answer_row(known)
        assert compare(again, sampled) == compare(known, sampled)
    assert (
        posterior_of(draws_table(SimpleNamespace(posterior=None, draws=SimpleNamespace(size=0, names=()))))
        is None
    )
