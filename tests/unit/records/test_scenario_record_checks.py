"""Records of left turns and pedestrians, spoiled in every way a user may: no number without a word."""

import json
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import SCENARIOS, InputError, Verdict, cli, load_vehicle, write_law
from accelerated_evaluation.answer import estimation
from accelerated_evaluation.laws.files import signed
from accelerated_evaluation.records.checks import CHECKS, Records, inspect_records
from accelerated_evaluation.records.segments import complete
from accelerated_evaluation.records.verdict import verdict_on, verdict_on_encounters
from accelerated_evaluation.scenarios.record_table import read_scenario_records, records_to_check
from accelerated_evaluation.study.configuration import load
from test_record_checks import real
from test_scenario_commands import LAW

ROOT = Path(__file__).resolve().parents[3]
FARTHEST = {"left_turn": 150.0, "pedestrian": 60.0}
CLUSTER = {"left_turn": "driver", "pedestrian": "device"}
FOUND = Verdict({"known records": "distance 0.89"}, ("cut edges",), frozenset(), {"known records": "Look."})
KMH, MPH, FEET = 3.6, 1 / 0.44704, 1 / 0.3048
STOP, WARNING = "STOP", "warning"


@cache
def shipped(name):
    return pd.read_parquet(ROOT / SCENARIOS[name].records.file)


def scaled(factor, *places):
    """Multiply the host speed (0), the other speed (1) or the distance (2)."""
    return lambda rows, names, _: rows.assign(**{names[k]: rows[names[k]] * factor for k in places})


def exchanged(one, two):
    return lambda rows, names, _: rows.assign(**{names[one]: rows[names[two]], names[two]: rows[names[one]]})


def every(step, place, value=None):
    """Replace a value in every so many rows; by default the distance by its largest possible value."""

    def change(rows, names, scenario):
        code = FARTHEST[scenario] if value is None else value
        return rows.assign(**{names[place]: rows[names[place]].where(np.arange(len(rows)) % step != 0, code)})

    return change


def scaled_in_half(factor, place):
    return lambda rows, names, _: rows.assign(
        **{names[place]: rows[names[place]] * np.where(np.arange(len(rows)) % 2, factor, 1.0)}
    )


def doubled(cluster):
    return lambda rows, _, scenario: pd.concat(
        [rows, rows.assign(**({CLUSTER[scenario]: "another"} if cluster else {}))], ignore_index=True
    )


# Each fault with a check that says stop, or with a check that must at least give a warning.
SPOILED = {
    "host speed in km/h": (STOP, "known records", scaled(KMH, 0)),
    "host speed in mph": (STOP, "known records", scaled(MPH, 0)),
    "other speed in km/h": (STOP, "known records", scaled(KMH, 1)),
    "all speeds in km/h": (STOP, "known records", scaled(KMH, 0, 1)),
    "all speeds in mph": (STOP, "known records", scaled(MPH, 0, 1)),
    "distance in feet": (STOP, "known records", scaled(FEET, 2)),
    "distance in km": (STOP, "known records", scaled(0.001, 2)),
    "distance in yards": (WARNING, "rows outside limits", scaled(1 / 0.9144, 2)),
    "speeds divided by 3.6": (STOP, "known records", scaled(1 / KMH, 0, 1)),
    "host speed divided by 3.6": (STOP, "known records", scaled(1 / KMH, 0)),
    "other speed divided by 3.6": (STOP, "known records", scaled(1 / KMH, 1)),
    "distance times 0.3048": (STOP, "known records", scaled(1 / FEET, 2)),
    "speeds exchanged": (STOP, "known records", exchanged(0, 1)),
    "host speed and distance exchanged": (STOP, "known records", exchanged(0, 2)),
    "other speed and distance exchanged": (STOP, "known records", exchanged(1, 2)),
    "doubled with another cluster": (STOP, "rows repeated elsewhere", doubled(cluster=True)),
    "doubled": (WARNING, "repeated rows", doubled(cluster=False)),
    "half of the host speeds 0": (STOP, "equal values", every(2, 0, 0.0)),
    "half of the other speeds 0": (STOP, "equal values", every(2, 1, 0.0)),
    "a tenth of the host speeds 0": (WARNING, "equal values", every(10, 0, 0.0)),
    "a sentinel in a third": (STOP, "equal values", every(3, 2)),
    "a sentinel in a fiftieth": (STOP, "cut edges", every(50, 2)),
    "an inner sentinel in a fiftieth": (WARNING, "equal values", every(50, 2, 33.33)),
    "a constant": (STOP, "equal values", every(1, 0, 10.0)),
    "half of the host speeds in km/h": (STOP, "rows outside limits", scaled_in_half(KMH, 0)),
    "half of the host speeds divided by 3.6": (WARNING, "known records", scaled_in_half(1 / KMH, 0)),
    "rounded": (STOP, "round numbers", lambda x, names, _: x.assign(**{names[0]: x[names[0]].round()})),
}
UNREADABLE = {
    "no cluster": (lambda x, c: x.assign(**{c: None}), "of {n} rows have none; expected the name of the"),
    "half of the clusters": (lambda x, c: x.assign(**{c: x[c].where(x.index % 2 == 0)}), "seen no name"),
    "blank clusters": (lambda x, c: x.assign(**{c: "  "}), "seen no name"),
    "no cluster column": (lambda x, c: x.drop(columns=c), "column '{c}'"),
}


def report_on(scenario, path, monkeypatch):
    """Return the report on a table of records, with the replays of the default vehicle."""
    monkeypatch.chdir(ROOT)
    table = read_scenario_records(SCENARIOS[scenario], path)
    simulate = load_vehicle(SCENARIOS[scenario].default_vehicle, SCENARIOS[scenario]).simulate
    return inspect_records(records_to_check(SCENARIOS[scenario], table, simulate))


@pytest.mark.parametrize("scenario", FARTHEST)
def test_the_records_of_the_project_do_not_alarm(scenario, monkeypatch):
    verdict = Verdict.of(report_on(scenario, None, monkeypatch))
    assert (verdict.stops, verdict.warnings, verdict.lines()) == ({}, (), [])
    assert verdict.added_to(shipped(scenario)) is shipped(scenario)


def test_the_cut_ins_of_the_project_do_not_alarm():
    raw, config = real(), load()
    records = Records.of(raw, config["filters"], config["segments"]["lead_speed_edges"])
    assert verdict_on(records, "spmd").lines() == []
    encounters = complete(raw).assign(
        segment=np.where(raw["lead_speed"] < 15, "5-15", np.where(raw["lead_speed"] < 25, "15-25", "25-35"))
    )
    kept = encounters[(encounters["range"] <= 75) & (encounters["closing_speed"] > 0)]
    assert verdict_on_encounters(kept, "encounters.parquet").lines() == []
    assert verdict_on_encounters(kept.iloc[1:], "encounters.parquet").lines() != []  # other records: warnings


@pytest.mark.parametrize("scenario", FARTHEST)
@pytest.mark.parametrize("fault", SPOILED)
def test_a_spoiled_copy_is_noticed(scenario, fault, tmp_path, monkeypatch):
    expected, check, spoil = SPOILED[fault]
    spoil(shipped(scenario), SCENARIOS[scenario].names, scenario).to_csv(tmp_path / "x.csv", index=False)
    verdict = Verdict.of(report_on(scenario, tmp_path / "x.csv", monkeypatch))
    assert check in verdict.stops if expected == STOP else check in {*verdict.stops, *verdict.warnings}
    assert check in verdict.in_short


@pytest.mark.parametrize("scenario", FARTHEST)
@pytest.mark.parametrize("fault", UNREADABLE)
def test_a_table_without_clusters_is_one_message(scenario, fault, tmp_path):
    spoil, message = UNREADABLE[fault]
    spoil(shipped(scenario), CLUSTER[scenario]).to_csv(tmp_path / "x.csv", index=False)
    with pytest.raises(
        InputError, match=message.format(n=f"{len(shipped(scenario)):,}", c=CLUSTER[scenario])
    ):
        read_scenario_records(SCENARIOS[scenario], tmp_path / "x.csv")


@pytest.mark.parametrize("change", ["every second row", "the first 300 rows", "a measurement error of 3 %"])
@pytest.mark.parametrize("scenario", FARTHEST)
def test_sound_records_of_the_same_traffic_are_not_stopped(scenario, change, tmp_path, monkeypatch):
    rows, names = shipped(scenario), list(SCENARIOS[scenario].names)
    noise = np.random.default_rng(1).normal(1, 0.03, (len(rows), 3))
    changed = {
        "every second row": rows.iloc[::2],
        "the first 300 rows": rows.head(300),
        "a measurement error of 3 %": rows.assign(**(rows[names] * noise)),
    }[change]
    changed.to_csv(tmp_path / "x.csv", index=False)
    verdict = Verdict.of(report_on(scenario, tmp_path / "x.csv", monkeypatch))
    assert set(verdict.stops) <= ({"rows outside limits"} if "error" in change else set())


def status_of(command):
    try:
        return cli.main(command)
    except SystemExit as ended:  # of inspect
        return ended.code


DOORS = {
    "inspect": (["inspect", "x.yaml"], 1),
    "estimate": (["estimate", "--config", "x.yaml"], 2),
    "estimate, one law": (["estimate", "--config", "x.yaml", "--law", "kernel"], 2),
    "estimate, law file": (["estimate", "--config", "x.yaml", "--law", "law.json"], 2),
    "campaign": (["campaign", "new", "c.json", "--scenario", "left_turn", "--law", "law.json"], 2),
    "export": (["export", "set", "--scenario", "left_turn", "--law", "law.json"], 2),
}


@pytest.mark.parametrize("door", DOORS)
def test_every_door_states_the_verdict(door, tmp_path, monkeypatch, capsys):
    """Records in km/h are refused at every door; the file of the law keeps the verdict."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(estimation, "checked_answers", lambda *_: pytest.fail("it simulates"))
    rows = scaled(KMH, 0)(shipped("left_turn"), SCENARIOS["left_turn"].names, "left_turn")
    rows.to_csv("x.csv", index=False)
    Path("x.yaml").write_text("study: x\nscenario: {name: left_turn, records: x.csv}\n")
    write_law("law.json", LAW, verdict=FOUND)
    command, status = DOORS[door]
    before = sorted(tmp_path.iterdir())
    assert status_of(command) == status
    printed = "".join(capsys.readouterr())
    assert "STOP" in printed
    assert "known records" in printed
    assert sorted(tmp_path.iterdir()) == before


def test_an_accepted_verdict_and_warnings_are_kept_by_campaigns_and_exports(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_law("law.json", LAW, verdict=FOUND)
    accept = ["--scenario", "left_turn", "--law", "law.json", "--accept", "known records"]
    assert cli.main(["campaign", "new", "c.json", *accept]) == 0
    assert cli.main(["campaign", "status", "c.json"]) == 0
    printed = capsys.readouterr().out
    assert printed.count("STOP (accepted by name): known records of the records: distance 0.89") == 2
    assert printed.count("warning: cut edges") == 2


@pytest.mark.parametrize(
    "content", [None, [], "x", {"stops": None, "warnings": [], "advice": {}}, {"stops": {"x": "y"}}]
)
def test_a_damaged_verdict_in_a_law_is_one_message(tmp_path, monkeypatch, capsys, content):
    monkeypatch.chdir(tmp_path)
    write_law("law.json", LAW)
    changed = json.loads(Path("law.json").read_text()) | {"verdict": content}
    Path("law.json").write_text(json.dumps(signed(changed)))
    assert cli.main(["campaign", "new", "c.json", "--scenario", "left_turn", "--law", "law.json"]) == 2
    assert "law.json, verdict: seen" in capsys.readouterr().err


def test_a_law_without_a_verdict_is_used_with_a_warning(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_law("law.json", LAW)
    assert cli.main(["campaign", "new", "c.json", "--scenario", "left_turn", "--law", "law.json"]) == 0
    assert "warning: no verdict on the records in the file of the law" in capsys.readouterr().out


def test_all_checks_of_other_scenarios_are_tried():
    need = {name.replace("_", " "): getattr(check, "needs", frozenset()) for name, check in CHECKS.items()}
    other = {name for name, columns in need.items() if columns == {"cluster"}}
    assert other == {"clusters"}
