"""The commands replay, export, campaign and inspect in scenarios other than the cut-in."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import SCENARIOS, DrawnLaws, cli, load_vehicle, write_law
from accelerated_evaluation.scenarios.left_turn import LEFT_TURN
from accelerated_evaluation.track import weighted_set
from accelerated_evaluation.track.campaign_file import read_campaign, write_campaign
from accelerated_evaluation.track.export import page, table_of
from accelerated_evaluation.track.weighted_set import draw_scored_set
from normal_law import left_turn_law

ROOT = Path(__file__).resolve().parents[3]
ENCOUNTERS = {"left_turn": ["15", "7", "20"], "pedestrian": ["5", "-1", "20"]}
LAW = left_turn_law(deviation=(5, 4, 25))  # one in twenty left turns crashes
OTHER = left_turn_law(mean=(16, 6, 55), deviation=(5, 4, 25))  # crashes are more frequent


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_law("law.json", LAW)
    return tmp_path


@pytest.mark.parametrize("name", ENCOUNTERS)
def test_a_replay_ends_in_the_outcomes_of_the_simulation(folder, name):
    options = ["--scenario", name, "--figure", "out.svg"]
    assert cli.main(["replay", *ENCOUNTERS[name], "out.csv", *options]) == 0
    trace = pd.read_csv("out.csv")
    outcomes = load_vehicle("acc_aeb", SCENARIOS[name]).simulate(*([float(x)] for x in ENCOUNTERS[name]))
    assert trace["time_s"].iloc[-1] == pytest.approx(outcomes.run_time[0])
    distance = np.hypot(trace["ahead_m"], trace["aside_m"])
    assert distance.min() == pytest.approx(outcomes.min_distance[0], abs=1.0)  # rows are 0.1 s apart
    assert b"position of the target" in Path("out.svg").read_bytes()


def campaign(step, *arguments):
    return cli.main(["campaign", step, "c.json", *map(str, arguments)])


def test_a_campaign_of_left_turns_keeps_all_it_is_told(folder, capsys):
    options = ("--scenario", "left_turn", "--deterministic", "yes", "--batch-size", 20)
    assert campaign("new", "--law", "law.json", *options) == 0
    for _ in range(2):
        assert campaign("ask", "next") == 0
        assert cli.main(["simulate", "next/runs.csv", "done.csv", "--scenario", "left_turn"]) == 0
        assert campaign("tell", "done.csv") == 0
    assert "no OpenSCENARIO files, because they are written for cut-ins only" in capsys.readouterr().out
    assert [path.name for path in Path("next").iterdir()] == ["runs.csv"]
    read, done = read_campaign("c.json"), pd.read_csv("done.csv")
    assert len(read.runs) == read.sampler.simulations == 40
    assert read.runs[-1].encounter == tuple(done[list(LEFT_TURN.names)].iloc[-1])
    known = load_vehicle("acc_aeb", LEFT_TURN).simulate(*np.transpose([run.encounter for run in read.runs]))
    assert read.sampler.progress.happened.tolist() == known.crash.tolist()
    assert read.sampler.progress.score == pytest.approx(known.clearance)
    write_campaign("copy.json", read)
    assert Path("copy.json").read_text() == Path("c.json").read_text()
    assert campaign("status") == 0
    assert "the interval above is that of the sampling alone" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("run,crash,clearance\n1,0,-1\n", "column clearance: seen -1; expected 0 or more without a crash"),
        ("run,crash,sdv_speed_mps\n1,0,99\n", "column sdv_speed_mps: seen 99"),
        ("run,crash,impact_speed\n1,1,\n", "column impact_speed: seen nothing; expected a number"),
    ],
)
def test_outcomes_that_contradict_the_scenario_are_refused(folder, capsys, table, message):
    options = ("--scenario", "left_turn", "--event", "impact_speed=5")
    assert campaign("new", "--law", "law.json", *options) == 0
    assert campaign("ask", "next") == 0
    Path("outcomes.csv").write_text(table)
    assert campaign("tell", "outcomes.csv") == 2
    assert message in capsys.readouterr().err


def recipe_of(drawn):
    """Do what the page of a set says, with its own script and the built-in car; return what it computes."""
    table_of(drawn, [], LEFT_TURN).to_csv("scenarios.csv", index=False)
    table = pd.read_csv("scenarios.csv")
    other = load_vehicle("acc_aeb", LEFT_TURN, headway=1.3)
    crash = other.simulate(*table[list(LEFT_TURN.names)].T.to_numpy()).crash
    table.assign(crash=crash.astype(int))[["scenario", "crash"]].to_csv("outcomes.csv", index=False)
    found = {}
    exec(re.search(r"```python\n(.*?)```", page(drawn, {}, LEFT_TURN), re.DOTALL)[1], found)
    return found


def test_the_recipe_of_a_set_gives_the_crash_probability(folder, monkeypatch, capsys):
    monkeypatch.setattr(weighted_set, "POOL", 20_000)
    sets = [draw_scored_set(LEFT_TURN, LAW, 150, np.random.default_rng(seed)) for seed in range(20)]
    found = [recipe_of(drawn) for drawn in sets]
    x = LAW.draw(100_000, np.random.default_rng(99))
    truth = load_vehicle("acc_aeb", LEFT_TURN, headway=1.3).simulate(*x.T).crash.mean()
    estimates = np.array([one["probability"] for one in found])
    reach = 4 * np.hypot(estimates.std(ddof=1) / np.sqrt(len(sets)), np.sqrt(truth / len(x)))
    assert abs(estimates.mean() - truth) < reach < 0.3 * truth
    assert abs(2 * estimates.mean() - truth) > reach  # the wrong variant: weights twice as large
    assert np.mean([one["low"] <= truth <= one["high"] for one in found]) > 0.5
    assert all(drawn.probabilities.sum() == pytest.approx(1) for drawn in sets)
    assert "per encounter, 80% interval" in capsys.readouterr().out


@pytest.fixture(scope="module")
def draws():
    return DrawnLaws.of([LAW, OTHER], ["first", "second"], np.random.default_rng(5))


def crash_probabilities(laws, size=100_000):
    car = load_vehicle("acc_aeb", LEFT_TURN)
    drawn = (law.draw(size, np.random.default_rng(98)) for law in laws)
    return np.array([car.simulate(*x.T).crash.mean() for x in drawn])


def test_the_weights_of_a_set_give_the_probability_under_each_draw(folder, draws, monkeypatch):
    monkeypatch.setattr(weighted_set, "POOL", 20_000)
    car, sums, pooled = load_vehicle("acc_aeb", LEFT_TURN), [], []
    write_law("draws.json", draws)
    for seed in range(8):
        options = ["--scenario", "left_turn", "--law", "draws.json", "--size", "150", "--seed", str(seed)]
        assert cli.main(["export", f"set{seed}", *options]) == 0
        table, weights = (pd.read_csv(f"set{seed}/{name}.csv") for name in ("scenarios", "weights"))
        crash = car.simulate(*table[list(LEFT_TURN.names)].T.to_numpy()).crash
        sums.append(weights.loc[crash, ["draw_001", "draw_002"]].sum())
        pooled.append(table.loc[crash, "weight"].sum())
    known, found = crash_probabilities(draws.laws), np.mean(sums, axis=0)
    error = np.hypot(np.std(sums, axis=0, ddof=1) / np.sqrt(len(sums)), np.sqrt(known / 100_000))
    assert np.all(np.abs(found - known) < 4.5 * error)  # the standard error is that of eight sets
    assert np.abs((np.mean(pooled) - known) / error).max() > 9  # the wrong variant: weights of the mean
    assert np.mean(pooled) == pytest.approx(known.mean(), abs=4.5 * error.mean())
    assert "`weights.csv`" in Path("set0/README.md").read_text()
    assert "the law of encounters exactly" in Path("set0/README.md").read_text()


def test_a_campaign_of_left_turns_is_reported_under_all_draws(folder, draws, capsys):
    write_law("draws.json", draws)
    options = ("--scenario", "left_turn", "--deterministic", "yes", "--batch-size", 40)
    assert campaign("new", "--law", "draws.json", *options) == 0
    driven = 0
    while driven < 200:  # while it searches, the sampler asks for less than a batch
        assert campaign("ask", "next") == 0
        assert cli.main(["simulate", "next/runs.csv", "done.csv", "--scenario", "left_turn"]) == 0
        assert campaign("tell", "done.csv") == 0
        driven += len(pd.read_csv("done.csv"))
    capsys.readouterr()
    assert campaign("status") == 0
    lines = capsys.readouterr().out
    median = float(re.search(r"encounter (\S+) \(median, 1 in", lines)[1])
    low, high = map(float, re.search(r"80%: (\S+) to (\S+);", lines).groups())
    known = np.median(crash_probabilities(draws.laws))
    assert abs(np.log(median / known)) < 0.6  # three relative errors of the sampling
    assert low < known < high
    assert "only more records reduce" in lines


def test_the_report_on_records_counts_what_is_wrong(folder, capsys):
    rows = pd.read_parquet(ROOT / LEFT_TURN.records.file).head(200)
    spoiled = pd.concat([rows, rows.head(2), rows.head(1).assign(turning_speed_mps=-1.0)])
    spoiled.to_csv("records.csv", index=False)
    arguments = ["inspect", "records.csv", "--scenario", "left_turn", "--report", "report.csv"]
    assert cli.main(arguments) == 0
    report = pd.read_csv("report.csv").set_index("check")
    before = rows.duplicated([*LEFT_TURN.names, "driver"]).sum()
    assert report.loc["repeated rows", "number"] == before + 2
    assert report.loc["rows outside limits", "rows"] == 1
    assert report.loc["rows outside limits", "example_rows"] == "203"
    assert report.loc["replayed crashes", "verdict"] == "warning"
    assert "1 with turning_speed_mps not from 0 to 60 m/s" in capsys.readouterr().out
    spoiled.assign(turning_speed_mps=-1.0).to_csv("records.csv", index=False)
    with pytest.raises(SystemExit):
        cli.main(arguments)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["replay", "15", "7", "out.csv", "--scenario", "left_turn"], "seen 2 values; expected 3, the value"),
        (["replay", "15", "7", "500", "o.csv", "--scenario", "left_turn"], "seen 500.0; expected 0 to 150 m"),
        (["export", "new", "--law", "law.json"], "--encounters: seen nothing; expected the encounter table"),
        (["export", "new", "--law", "law.json", "--scenario", "pedestrian"], "seen sdv_speed_mps from 0 to"),
        (
            ["export", "new", "--law", "law.json", "--scenario", "left_turn", "--safe-deceleration", "2"],
            "--safe-deceleration: seen the scenario left_turn; expected cut_in",
        ),
        (
            ["campaign", "new", "new", "--law", "law.json", "--scenario", "left_turn", "--range-min", "2"],
            "--range-min: seen the scenario left_turn; expected cut_in",
        ),
        (
            [
                "campaign",
                "new",
                "new",
                "--law",
                "law.json",
                "--scenario",
                "left_turn",
                "--event",
                "min_ttc=1",
            ],
            "expected crash, or impact_speed or post_encroachment_time with a threshold, such as",
        ),
    ],
)
def test_what_does_not_fit_a_scenario_is_named(folder, capsys, arguments, message):
    assert cli.main(arguments) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert [path.name for path in folder.iterdir()] == ["law.json"]
