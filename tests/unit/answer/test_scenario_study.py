"""The study of a scenario: restricted laws, agreement with verdicts, and what is refused."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import cli, load_vehicle, write_law
from accelerated_evaluation.answer.ways.published_verdicts import agreement, read_verdicts
from accelerated_evaluation.scenarios.left_turn import LEFT_TURN
from accelerated_evaluation.scenarios.record_table import read_scenario_records, records_account
from normal_law import left_turn_law

ROOT = Path(__file__).resolve().parents[3]
FAR = left_turn_law((14, 7, 100), (5, 3, 10))


def test_firm_verdicts_are_reproduced_and_wrong_ones_counted():
    verdicts = read_verdicts(LEFT_TURN, [str(ROOT / LEFT_TURN.records.verdicts)]).iloc[:3000]
    vehicle = load_vehicle("acc_aeb", LEFT_TURN)
    firm = agreement(LEFT_TURN, vehicle, verdicts).set_index("kind").loc["firm"]
    assert firm["agree"] >= 0.999 * firm["verdicts"]
    wrong = verdicts.assign(
        crash=verdicts["crash"].where(verdicts.index != verdicts.index[-1], 1 - verdicts["crash"])
    )
    changed = agreement(LEFT_TURN, vehicle, wrong).sum(numeric_only=True)
    kept = agreement(LEFT_TURN, vehicle, verdicts).sum(numeric_only=True)
    assert abs(changed["agree"] - kept["agree"]) == 1
    assert agreement(LEFT_TURN, vehicle, read_verdicts(LEFT_TURN, []))["verdicts"].sum() == 0


def test_the_account_of_the_records_counts_every_row():
    table = read_scenario_records(LEFT_TURN, ROOT / LEFT_TURN.records.file)
    account = records_account(LEFT_TURN, table).iloc[0]
    assert account["records"] == len(table) == 1055
    assert account["fitted"] + account["repeated"] == 1055
    assert account["clusters"] == 115


def test_the_event_of_an_estimate_can_be_an_impact(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    known = left_turn_law((14, 7, 20), (5, 3, 10))
    write_law("near.json", known)
    outcomes = load_vehicle("acc_aeb", LEFT_TURN).simulate(*known.draw(50_000, np.random.default_rng(6)).T)
    exact = np.mean(outcomes.impact_speed > 15)
    assert 0.01 < exact < 0.7 * outcomes.crash.mean()
    arguments = ["estimate", "--scenario", "left_turn", "--law", "near.json", "--event", "impact_speed=15"]
    assert cli.main(arguments) == 0
    row = pd.read_csv("results/left_turn/estimate/estimate.csv").iloc[0]
    assert row["ci_low"] / 1.5 < exact < row["ci_high"] * 1.5
    assert re.search(r"^impact speed above 15 m/s  1 in \d+ \w+", capsys.readouterr().out, re.MULTILINE)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--scenario", "left_trun"], 'scenario.name: seen "left_trun"; expected cut_in, left_turn'),
        (
            ["--scenario", "left_turn", "--law", "paper"],
            "--law: seen 'paper'; expected answer, gaussian_copula",
        ),
        (["--scenario", "left_turn", "--against", "cc_human"], "--against: seen 'cc_human'; expected one of"),
        (
            ["--scenario", "left_turn", "--reference", "cc_human"],
            "--reference: seen 'cc_human'; expected one of acc_aeb",
        ),
        (
            ["--scenario", "left_turn", "--event", "min_range=1"],
            "--event: seen 'min_range=1'; expected crash, or",
        ),
        (
            ["--config", "speed.yaml"],
            "scenario.event: seen 'speed'; expected crash, or impact_speed or post_encroachment_time",
        ),
    ],
)
def test_options_that_do_not_fit_the_scenario_are_named(tmp_path, monkeypatch, capsys, options, message):
    monkeypatch.chdir(tmp_path)
    Path("data").symlink_to(ROOT / "data")
    Path("speed.yaml").write_text("study: speed\nscenario: {name: left_turn, event: speed}\n")
    assert cli.main(["estimate", *options]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda x: x.assign(sdv_speed_mps=0.0), "column sdv_speed_mps: seen one value in all records"),
        (
            lambda x: x.assign(turning_speed_mps=x["sdv_speed_mps"] / 2 + 1),
            "column turning_speed_mps: seen a linear function of earlier columns",
        ),
        (lambda x: x.head(40), "seen 40 of 40 within the limits of the variables and not repeated"),
        (
            lambda x: x.assign(sdv_speed_mps=3.6 * x["sdv_speed_mps"] + 40),  # as in km/h
            "seen 0 of 200 within the limits of the variables",
        ),
    ],
)
def test_records_to_which_no_law_can_be_fitted_are_named(tmp_path, monkeypatch, capsys, change, message):
    monkeypatch.chdir(tmp_path)
    generator = np.random.default_rng(1)
    x = pd.DataFrame(generator.uniform((5, 3, 20), (20, 9, 90), (200, 3)), columns=LEFT_TURN.names)
    change(x.assign(driver=np.arange(200) % 20)).to_csv("records.csv", index=False)
    Path("own.yaml").write_text("study: own\nscenario: {name: left_turn, records: records.csv}\n")
    names = "equal values", "rows outside limits", "known records", "replayed crashes", "stuck sensor"
    accepted = [word for name in names for word in ("--accept", name)]
    assert cli.main(["estimate", "--config", "own.yaml", "--law", "kernel", *accepted]) == 2
    assert message in capsys.readouterr().err


def test_runs_that_do_not_end_are_counted_by_an_estimate(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    pd.read_parquet(ROOT / LEFT_TURN.records.file)[::4].to_parquet("few.parquet")
    study = "study: own\nscenario: {name: left_turn, records: few.parquet}\nsurrogate: {maximum_calls: 100}\n"
    Path("own.yaml").write_text(study + "vehicle: {parameters: {longest_run: 3}}\n")
    options = ["--config", "own.yaml", "--law", "gaussian_copula"]
    assert cli.main(["estimate", *options]) == 0
    lines = capsys.readouterr().out.splitlines()
    (warning,) = (line for line in lines if "did not end" in line)
    count = int(warning.split()[1].replace(",", ""))
    assert warning == f"warning: {count:,} runs did not end, and count as without the event"
    assert 1 <= count <= 500
    Path("own.yaml").write_text(study.replace("own", "other"))
    assert cli.main(["estimate", *options]) == 0
    assert "did not end" not in capsys.readouterr().out
