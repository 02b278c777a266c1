"""The sum of the rates of several scenarios, against closed forms, and the command ``total``."""

import json
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import Posterior, cli
from accelerated_evaluation.answer.consequences.all_cut_ins import COLUMNS, QUANTILES
from accelerated_evaluation.answer.consequences.criterion import (
    BY_MODELS,
    ENCOUNTER,
    UNDECIDED,
    Basis,
    Criterion,
    judge,
)
from accelerated_evaluation.answer.consequences.rates import Rate
from accelerated_evaluation.answer.consequences.total import SIZE, judged_total, rate_values, total_table
from accelerated_evaluation.answer.ways.posterior import PartlyKnown
from scipy.special import ndtri


def posterior(*probabilities):
    return Posterior(np.array(probabilities), np.zeros(len(probabilities), dtype=int))


def test_the_sum_of_two_rates():
    """Mean and variance of the sum are those of independent products."""
    generator = np.random.default_rng(3)
    p, q = posterior(1e-6, 3e-6), posterior(2e-5)
    rate = Rate(10, 5.0)
    rates = {"a": rate_values(p, rate, generator), "b": rate_values(q, 0.1, generator)}
    bases = {"a": Basis("closing cut-ins", 0.9, (0.0, 1.0)), "b": Basis("", 0.1, (0.0, 2.0))}
    table = total_table(rates, "hour", bases).set_index("scenario")
    mean, variance = rate.law.mean(), rate.law.var()
    expected = mean * 2e-6 + 0.1 * 2e-5
    of_product = (variance + mean**2) * 5e-12 - (mean * 2e-6) ** 2
    error = np.sqrt(of_product / SIZE)
    assert table.loc["together", "mean"] == pytest.approx(expected, abs=5 * error)
    assert table.loc["b", "mean"] == pytest.approx(2e-6)
    assert table.loc["b", "share"] == pytest.approx(2e-6 / expected, rel=0.02)
    spread = np.sum(list(rates.values()), axis=0).std()
    assert spread == pytest.approx(np.sqrt(of_product), rel=0.03)
    assert spread > 1.1 * mean * 1e-6  # the uncertainty of the rate of encounters is in it
    share = table.loc["a", "share"]
    assert table.loc["together", "beyond"] == pytest.approx(0.9 * share + 0.1 * (1 - share))
    judged = judged_total(rates, "hour", bases, 1.0)
    assert (judged.verdict, judged.basis.replayed) == (BY_MODELS[True], (0.0, 3.0))


@pytest.mark.parametrize("is_known", [False, True])
def test_an_unknown_draw_enters_the_upper_end_only(is_known):
    """It is between 0 and its magnitude. In the wrong twin, this magnitude counts as an estimate."""
    unknown = np.array([True, False, False, False]) & (not is_known)
    own = PartlyKnown(np.array([4e-6, 1e-6, 1e-6, 1e-6]), np.zeros(4, int), unknown)
    rates = {"a": rate_values(own, 1.0, np.random.default_rng(5))}
    row = total_table(rates, "hour", {"a": Basis()}).iloc[-1]
    assert row["upper95"] == pytest.approx(4e-6)
    assert (row["mean"] == pytest.approx(0.75e-6, rel=0.05)) != is_known
    total = partial(judged_total, rates, "hour", {"a": Basis()})
    recorded = partial(judge, posterior=own, size=10, exposure={})
    for judged in (total, lambda limit: recorded(Criterion("", limit, ENCOUNTER))):
        assert (judged(0.5e-6).verdict == UNDECIDED) != is_known
        assert judged(2e-6).verdict == UNDECIDED
        assert judged(5e-6).verdict == BY_MODELS[True]
    ratio = recorded(Criterion("", 1.0, reference="old"), others={"old": own})
    assert isinstance(ratio, str) != is_known


@pytest.fixture
def studies(tmp_path, monkeypatch):
    """Two studies, the first with a known distance."""
    monkeypatch.chdir(tmp_path)
    for name, kilometres, probability in (("one", 1e4, 1e-6), ("two", None, 1e-5)):
        folder = tmp_path / "results" / name
        (folder / "laws").mkdir(parents=True)
        (folder / "config.json").write_text(json.dumps({"study": name, "seed": 1}))
        (folder / "exposure.json").write_text(json.dumps({"kilometres": kilometres, "hours": None}))
        draws = {"draw": [1, 2], "law": ["a", "a"], "probability": [probability, 2 * probability]}
        pd.DataFrame(draws).to_csv(folder / "laws/answer_draws.csv", index=False)
        parts = pd.DataFrame({"part": ["all", "recorded"], "records": 1000, "recorded": 0, "upper95": 1e-5})
        parts.to_csv(folder / "laws/extrapolation.csv", index=False)
        (folder / "contents.json").write_text(json.dumps(["laws/extrapolation.csv"]))


@pytest.mark.usefixtures("studies")
def test_the_command_sums_studies(capsys):
    assert cli.main(["total", "one", "two=0.02", "--criterion", "1"]) == 0
    assert "shown to be met, for closing cut-ins whose lead" in capsys.readouterr().out
    table = pd.read_csv("results/total.csv").set_index("scenario")
    assert table.loc["one", "mean"] == pytest.approx(0.1 * 1.5e-6, rel=0.01)
    assert table.loc["two", "mean"] == pytest.approx(0.02 * 1.5e-5, rel=0.01)


@pytest.mark.usefixtures("studies")
def test_the_rate_of_all_cut_ins_enters_the_sum_if_a_study_has_it(capsys):
    """It is lognormal, as in the table of quantiles, and ten times that of closing cut-ins."""
    row = {"vehicle": "under test", "part": "all", "per": "closing cut-in"}
    row |= {name: 1e-5 * np.exp(0.5 * ndtri(level)) for name, level in QUANTILES.items()}
    pd.DataFrame([row], columns=COLUMNS).to_csv("results/one/all_cut_ins.csv", index=False)
    files = ["laws/extrapolation.csv", "all_cut_ins.csv"]
    Path("results/one/contents.json").write_text(json.dumps(files))
    assert cli.main(["total", "one", "--criterion", "1"]) == 0
    assert "met under the models, for all cut-ins" in capsys.readouterr().out
    found = pd.read_csv("results/total.csv").iloc[0]
    assert found["median"] == pytest.approx(0.1 * 1e-5, rel=0.03)
    assert found["high95"] == pytest.approx(0.1 * 1e-5 * np.exp(0.5 * ndtri(0.975)), rel=0.05)


@pytest.mark.usefixtures("studies")
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["one", "two"], "Write two=RATE"),
        (["one", "two=many"], "a positive number"),
        (["one", "two=1_0"], "a positive number"),
        (["one", "one"], "each study once"),
        (["one", "three=1"], "no such file"),
    ],
)
def test_studies_that_cannot_be_summed(arguments, message, capsys):
    assert cli.main(["total", *arguments]) != 0
    assert message in capsys.readouterr().err
