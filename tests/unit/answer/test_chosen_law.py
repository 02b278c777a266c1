"""The law that the command ``estimate`` is given: fitted at once, named, or of a finished study."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import accelerated_evaluation as ae
import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import cli
from accelerated_evaluation.answer.estimate_tables import estimate_tables
from accelerated_evaluation.answer.settings import support_of
from accelerated_evaluation.vehicles.named import NamedVehicle
from motorway import CONFIGURATION, motorway_table

LIMIT = 0.35  # [1/s]
CAR = f"""
import numpy as np
from accelerated_evaluation.vehicles import Outcomes

class Car:
    '''Crashes where the closing speed exceeds {LIMIT} of the range a second.'''

    def simulate(self, lead_speed, range_, closing_speed):
        with np.errstate(divide="ignore"):
            ttc = np.where(closing_speed > 0, range_ / np.maximum(closing_speed, 0), np.inf)
        crash = ttc < 1 / {LIMIT}
        return Outcomes(crash, np.where(crash, 0, range_), ttc, np.where(crash, closing_speed, 0))
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with the generated motorway, its configuration and a car."""
    folder = tmp_path_factory.mktemp("motorway")
    (folder / "data").mkdir()
    motorway_table(4000).to_csv(folder / "data/motorway.csv", index=False)
    (folder / "car.py").write_text(CAR)
    (folder / "motorway.yaml").write_text(
        CONFIGURATION + "vehicle: {name: car.py:Car, deterministic: true}\n"
    )
    return folder


@pytest.fixture(scope="module")
def chosen():
    """Return a function that fits a law to the records of a configuration, each law once for all tests."""

    @cache
    def fitted(choice):
        config = few_draws()
        return ae.choose_draws(choice, ae.read_records(config), config).proposal

    return fitted


@pytest.fixture(scope="module")
def estimated():
    """Return a function that estimates the crash probability under a law, each law once for all tests."""
    return cache(lambda choice: ae.estimate(few_draws(), ae.Request(law=choice)))


def few_draws():
    config = ae.load("motorway.yaml")
    return config | {"answer": config["answer"] | {"draws": 20}}


@pytest.fixture
def config(folder, monkeypatch):
    monkeypatch.chdir(folder)
    return few_draws()


def crash_probability(law):
    """P(closing speed > LIMIT R), over recorded lead speeds and equally likely scores of the range."""
    u = (np.arange(200) + 0.5) / 200
    probability = 0.0
    for name, stratum in law.strata.items():
        speeds = stratum.lead_speed.ppf((np.arange(20) + 0.5) / 20)
        speed, first = (x.ravel() for x in np.meshgrid(speeds, stratum.factors.first.ppf(u)))
        range_ = stratum.points(speed, first, stratum.factors.second.ppf(np.full(first.size, 0.5)))[:, 1]
        start = LIMIT * range_
        closing = start, np.full(start.size, np.inf)
        inside = stratum.closing_speed_probability(speed, 1 / range_, *closing)
        probability += law.shares[name] * inside[start < law.closing_speed_max].sum() / start.size
    return probability


# What the intervals under a law contain: in the table ``answer``, and in words.
CONTAINED = {
    "answer": ("data, choice of law, sampling", "data, choice of law and sampling"),
    "exponential 0.9": ("data, sampling", "data and sampling, without choice of law"),
    "paper": ("sampling", "sampling, without data and choice of law"),
}


@pytest.mark.parametrize("choice", CONTAINED)
def test_the_estimate_is_of_the_law_that_was_chosen(config, chosen, estimated, choice):
    found = estimated(choice)
    tables = estimate_tables(found.answers, found.records)
    row = tables["estimate"].iloc[0]
    exact = crash_probability(found.answers[0].draws.proposal)
    error = (row["ci_high"] - row["ci_low"]) / 2 / 1.28
    assert row["converged"]
    assert row["probability"] == pytest.approx(exact, abs=4 * error)
    assert tables["answer"].iloc[0]["probability"] == pytest.approx(exact, abs=4 * error)
    contained, in_words = CONTAINED[choice]
    assert set(tables["answer"]["contains"]) == {contained, ""}  # no estimate of events that are no crash
    words = f"  intervals with {in_words}: 50%"
    assert any(line.startswith(words) for line in found.lines(verbose=True))
    assert ("far tail" in set(tables["budget"]["source"])) == (choice != "paper")
    others = [
        estimated(name).answers[0].draws.proposal for name in ("paper", "exponential 0.9") if name != choice
    ]
    wrong = [crash_probability(other) for other in (chosen("hazard"), *others)]
    assert max(abs(row["probability"] - other) for other in wrong) > 4 * error


def test_a_law_file_of_a_study_is_taken_and_of_other_records_refused(config, chosen, tmp_path):
    records, law = ae.read_records(config), chosen("hazard")
    ae.write_law(tmp_path / "law.json", law, records.table)
    read = ae.choose_draws(str(tmp_path / "law.json"), records, config)
    assert read.proposal.content() == law.content()
    others = replace(records, table=records.table.iloc[:-1])
    with pytest.raises(ae.InputError, match="expected the table to which the law was fitted"):
        ae.choose_draws(str(tmp_path / "law.json"), others, config)


def test_the_command_says_the_law_and_what_the_interval_is(config, capsys):
    Path("few_draws.yaml").write_text("answer: {draws: 20}\n")
    configs = ["--config", "motorway.yaml", "--config", "few_draws.yaml"]
    assert cli.main(["estimate", *configs, "--law", "exponential 0.9", "--verbose"]) == 0
    printed = capsys.readouterr().out
    assert "law of cut-ins: mean of 20 draws of exponential 0.9\n" in printed
    assert "interval of the sampling alone" in printed
    folder = Path("results/motorway/estimate")
    found = pd.read_csv(folder / "estimate.csv")
    assert found["law"].tolist() == ["mean of 20 draws of exponential 0.9"]
    bounds = f"{found['unseen_mode'][0]:.1g} if a half-space, {found['unseen_any'][0]:.1g} if of any shape"
    assert f"no run has met: at most {bounds} (95% confidence)" in printed
    assert ae.read_law(folder / "law.json", ae.read_records(config).table).draws.size == 20
    beyond = pd.read_csv(folder / "extrapolation.csv")
    assert beyond["part"].tolist()[:4] == ["all", "recorded", "near", "far"]
    assert beyond["share"][1:4].sum() == pytest.approx(1)


def test_the_command_judges_criteria(config, estimated, capsys):
    """One criterion is met, one is not, one is not decided, and one cannot be judged without an exposure.

    The first is in the configuration and on the command line, and is judged once.
    """
    texts = ["0.5 per cut-in", "1e-9 per cut-in", "MEDIAN per cut-in", "1e-7 per hour"]
    Path("few_draws.yaml").write_text(f"answer: {{draws: 20}}\ncriteria: [{texts[0]}]\n")
    configs = ["--config", "motorway.yaml", "--config", "few_draws.yaml"]
    median = estimated("answer").answers[0].posterior.probability
    texts[2] = f"{median:.3g} per cut-in"
    options = [part for text in texts for part in ("--criterion", text)]
    assert cli.main(["estimate", *configs, *options]) == 1  # as long as one of them is not met
    printed = capsys.readouterr().out
    assert printed.count("criterion 0.5 per cut-in: met under the models, for closing") == 1
    assert "criterion 1e-9 per cut-in: not met under the models" in printed
    assert f"criterion {texts[2]}: not shown, and not refuted" in printed
    folder = Path("results/motorway/estimate")
    criteria, deciding = (pd.read_csv(folder / f"{name}.csv") for name in ("criteria", "deciding"))
    words = ["met under the models", "not met under the models", "not decided", "not known"]
    assert criteria["verdict"].tolist() == words
    assert set(deciding["criterion"]) == {texts[2]}
    assert np.isnan(deciding.set_index("effort").loc["records", "needed"])
    assert "not computed" in printed  # how many records would decide it


def test_a_criterion_that_cannot_be_read_ends_before_the_simulations(config, capsys):
    assert cli.main(["estimate", "--config", "motorway.yaml", "--criterion", "one in a million"]) != 0
    assert "--criterion" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        ("two kinds", "expected answer, paper, single, three_pieces, two_pieces, hazard, exponential 0.9"),
        ("nowhere.json", "seen no file nowhere.json"),
        ("broken.json", "broken.json: seen JSONDecodeError"),
    ],
)
def test_laws_that_cannot_be_used(config, capsys, choice, message):
    Path("broken.json").write_text(json.dumps({"format": "accelerated-evaluation law"})[:-3])
    assert cli.main(["estimate", "--config", "motorway.yaml", "--law", choice]) == 2
    assert message in capsys.readouterr().err


def test_a_threshold_that_too_few_records_exceed_is_told(config):
    records = ae.read_records(config)
    few = records.table.iloc[:: len(records.table) // 300]
    with pytest.raises(ae.InputError, match="fewer than ten of the"):
        ae.choose_draws(
            "two kinds 0.995", ae.FittedRecords.of(ae.CUT_IN, few, support_of(ae.CUT_IN, config)), config
        )


@pytest.mark.parametrize(
    ("option", "message"),
    [
        (["--reference", "nope"], "--reference: seen 'nope'; expected one of acc_aeb, acc_only, cc_human"),
        (["--reference", ""], "the argument after --reference: seen an empty text"),
        (
            ["--reference", "command"],
            "--reference: seen command; expected a vehicle that is fast to simulate",
        ),
        (["--reference", "no.py:Car"], "vehicle no.py:Car: seen no file no.py"),
        (["--against", "nope"], "--against: seen 'nope'; expected one of acc_aeb, acc_only, cc_human"),
        (["--against", "no.py:Car"], "vehicle no.py:Car: seen no file no.py"),
        (["--against", "no.yaml"], "no.yaml: seen [Errno 2] No such file"),
    ],
)
def test_vehicles_that_cannot_be_compared_are_refused_before_anything_is_simulated(
    folder, monkeypatch, capsys, option, message
):
    monkeypatch.chdir(folder)
    monkeypatch.setattr(NamedVehicle, "loaded", lambda _: pytest.fail("it simulates"))
    assert cli.main(["estimate", "--config", "motorway.yaml", *option]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize("deterministic", [True, False])
def test_an_answer_that_has_not_converged_says_so_first(folder, monkeypatch, capsys, deterministic):
    # A car in whose outcomes chance may have a part could lapse, and few runs cannot exclude that. The study
    # is that of the other tests, so that the fit of all laws is read from its file.
    monkeypatch.chdir(folder)
    Path("chance.yaml").write_text(
        f"answer: {{draws: 20}}\nvehicle: {{name: car.py:Car, deterministic: {json.dumps(deterministic)}}}\n"
    )
    assert cli.main(["estimate", "--config", "motorway.yaml", "--config", "chance.yaml"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) <= 12
    answer = next(k for k, line in enumerate(lines) if line.startswith("crash  "))
    row = pd.read_csv("results/motorway/estimate/estimate.csv").iloc[0]
    assert row["converged"] == deterministic
    warned = lines[answer - 1].startswith("NOT CONVERGED")
    assert warned != deterministic
    if warned:
        assert f"can add up to {row['unseen_lapses']:.1g}, which the upper ends contain" in lines[answer - 1]
    found = pd.read_csv("results/motorway/estimate/answer.csv").iloc[0]
    draws = pd.read_csv("results/motorway/estimate/draws.csv")["probability"]
    unseen = row["unseen_lapses"] if warned else 0.0
    assert found["high80"] == pytest.approx(draws.quantile(0.9) + unseen, rel=0.2)
    assert found["low80"] == pytest.approx(draws.quantile(0.1), rel=0.3)
