"""The short repetition of the claims: tests by hand, and a wrong published value, which it must refute."""

import re
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.stats import binomtest, ttest_ind

pytestmark = pytest.mark.studies
ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "benchmarks" / "claims"))

from comparing import AtLeast, Between, Claim, Exactly, Mean, Share  # noqa: E402
from settle import FILES, NOT_REPEATED, PARTS, Files, main  # noqa: E402

SEEDS = 120


def test_two_means_are_compared_by_the_test_of_welch():
    generator = np.random.default_rng(1)
    one, other = generator.normal(5, 1, 12), generator.normal(6, 3, 40)
    expected = ttest_ind(one, other, equal_var=False).pvalue
    assert Mean.of(one).likelihood(Mean.of(other)) == pytest.approx(expected, rel=1e-9)


def test_right_numbers_are_seldom_refuted():
    """The p-values of equal quantities are uniform, so that a tenth of them lie below 0.1."""
    generator, repetitions = np.random.default_rng(2), 2000
    low = sum(
        Mean.of(generator.normal(3, 1, 8)).likelihood(Mean.of(generator.normal(3, 1, 15))) < 0.1
        for _ in range(repetitions)
    )
    assert binomtest(low, repetitions, 0.1).pvalue > 0.001


def test_the_error_of_a_ratio_is_that_of_its_simulated_values():
    generator, size = np.random.default_rng(3), 200_000
    ratio = Mean(9000, 300, 4).over(Mean(6500, 250, 9))
    simulated = generator.normal(9000, 300, size) / generator.normal(6500, 250, size)
    # The first order leaves out terms of the size of the squared relative error, 0.2 %.
    assert ratio.error == pytest.approx(simulated.std(), rel=0.01)
    assert ratio.freedom == 4


@pytest.mark.parametrize(
    ("published", "found", "verdict"),
    [
        (Mean(4), Mean(4), "agrees"),
        (Mean(4), Mean(5), "refuted"),
        (Mean(100, 1, 50), Mean(103, 1, 50), "agrees"),
        (Mean(100, 1, 50), Mean(108, 1, 50), "refuted"),
        (Share(0, 1000), Share(0, 100), "agrees"),
        (Share(0, 1000), Share(9, 100), "refuted"),
        (AtLeast(0.8), Share(75, 100), "agrees"),
        (AtLeast(0.8), Share(60, 100), "refuted"),
        (Between(5, 34), Mean(20), "agrees"),
        (Between(5, 34), Mean(35), "refuted"),
        (Exactly("a"), Exactly("a"), "agrees"),
        (Exactly("a"), Exactly("b"), "refuted"),
    ],
)
def test_verdicts(published, found, verdict):
    assert Claim("a claim", published, found).verdict == verdict


@pytest.fixture
def repeated(tmp_path) -> Files:
    """The published tables, and runs of the sampler and of the paper's method that agree with them."""
    shutil.copytree(FILES.benchmarks, tmp_path / "published")
    table = (
        pd.read_csv(FILES.benchmarks / "samplers.csv").query("problem == 'segment_5_15'").set_index("method")
    )
    generator = np.random.default_rng(4)
    (tmp_path / "raw").mkdir()
    for method in ("surrogate", "piecewise"):
        row = table.loc[method]
        deviation = row["calls_mean_se"] * np.sqrt(row["seeds"])
        calls = generator.normal(row["calls_mean"], deviation, SEEDS)
        runs = pd.DataFrame(
            {"calls": calls, "probability": row["reference"] * generator.uniform(0.7, 1.4, SEEDS)}
        )
        for half, part in runs.groupby(np.arange(SEEDS) % 2):
            part.to_csv(tmp_path / "raw" / f"{method}_{half}.csv", index=False)
    return replace(
        FILES, benchmarks=tmp_path / "published", raw=tmp_path / "raw", study=tmp_path / "no study"
    )


def settled(files, capsys) -> tuple[int, dict[str, str]]:
    """Return the exit status, and the verdict of each claim as it is printed."""
    status = main(["sampler"], files)
    rows = [
        row.split("|")[1:-1] for row in capsys.readouterr().out.splitlines() if row.startswith("| 8 sampler")
    ]
    return status, {row[1].strip(): row[-1].strip() for row in rows}


def test_right_published_values_agree(repeated, capsys):
    status, verdicts = settled(repeated, capsys)
    assert status == 0
    assert list(verdicts.values()) == ["agrees"] * 3
    assert (repeated.raw / "claims.csv").exists()


@pytest.mark.parametrize(
    ("method", "column", "factor", "refuted"),
    [
        ("surrogate", "calls_mean", 1.25, "simulations on the main problem, this project"),
        ("piecewise", "calls_mean", 0.8, "simulations on the main problem, the paper's piecewise method"),
        ("surrogate", "reference", 2.5, "runs that are wrong by more than a factor of 2"),
    ],
)
def test_a_wrong_published_value_is_refuted(repeated, capsys, method, column, factor, refuted):
    path = repeated.benchmarks / "samplers.csv"
    table = pd.read_csv(path)
    wrong = (table["problem"] == "segment_5_15") & (table["method"] == method)
    table.loc[wrong, column] *= factor
    table.to_csv(path, index=False)
    status, verdicts = settled(repeated, capsys)
    assert status == 1
    assert [claim for claim, verdict in verdicts.items() if verdict == "refuted"] == [refuted]


def test_what_is_missing_is_named(tmp_path, capsys):
    nothing = replace(FILES, raw=tmp_path, study=tmp_path / "claims")
    for part, missing in {"worlds": "worlds_*.csv", "answer": "answer_draws.csv"}.items():
        assert main([part], nothing) == 2
        message = capsys.readouterr().err
        assert missing in message
        assert "make claims" in message
    assert not list(tmp_path.glob("*.csv"))


def test_every_part_has_a_rule_and_a_line_in_the_guide():
    rules = re.findall(r"^rule (\w+):", (ROOT / "benchmarks/claims/Snakefile").read_text(), re.MULTILINE)
    guide = re.findall(
        r"^\| (\d+) \|.*`make claims CLAIMS=(\w+)`", (ROOT / "REPRODUCE.md").read_text(), re.MULTILINE
    )
    assert guide == [(str(number), part) for number, part in enumerate(PARTS, start=1)]
    assert set(PARTS) <= set(rules)


def test_lead_motion_agrees_with_itself_and_a_wrong_factor_is_refuted(tmp_path, capsys):
    study = tmp_path / "study"
    study.mkdir()
    table = pd.read_csv(FILES.tables / "lead_motion.csv")
    files = replace(FILES, raw=tmp_path, study=study)
    pd.DataFrame({"difference": [-3.9, 2.0]}).to_csv(tmp_path / "moving_leads.csv", index=False)
    for ratio, status in ((1, 0), (2, 1)):
        table.assign(factor=table["factor"] * ratio).to_csv(study / "lead_motion.csv", index=False)
        assert main(["motion"], files) == status
        rows = [row for row in capsys.readouterr().out.splitlines() if row.startswith("| 5 motion")]
        assert [row.split("|")[-2].strip() for row in rows] == [
            *["agrees" if status == 0 else "refuted"] * 2,
            *["agrees"] * 2,
        ]


@pytest.mark.parametrize(("difference", "status"), [(-3.9, 0), (4.1, 1), (-4.1, 1)])
def test_an_answer_that_counts_contradict_is_refuted(tmp_path, difference, status):
    table = pd.DataFrame({"study": "claims_left_turn", "difference": [0.1, difference]})
    table.to_csv(tmp_path / "second_ways.csv", index=False)
    assert main(["scenarios"], replace(FILES, raw=tmp_path)) == status


@pytest.mark.parametrize(("factor", "status"), [(1.0, 0), (1.5, 1)])
def test_an_end_of_whole_answers_that_maps_contradict_is_refuted(tmp_path, factor, status):
    generator, table = np.random.default_rng(4), pd.read_csv(FILES.tables / "answer.csv")
    table["high95"] *= factor
    answers = [table.assign(seed=k, simulations=generator.normal(156, 30)) for k in range(12)]
    pd.concat(answers).to_csv(tmp_path / "estimate_0.csv", index=False)
    assert main(["estimate"], replace(FILES, raw=tmp_path)) == status


def test_what_is_not_repeated_is_printed_and_is_in_the_guide(repeated, capsys):
    main(["sampler"], repeated)
    printed = capsys.readouterr().out
    guide = (ROOT / "REPRODUCE.md").read_text()
    for claim, why in NOT_REPEATED.items():
        assert f"- {claim}: {why}" in printed
        assert f"| {claim} | {why} |" in guide
    assert guide.split("## What is not repeated")[1].split("##")[0].count("\n| ") == len(NOT_REPEATED) + 2
