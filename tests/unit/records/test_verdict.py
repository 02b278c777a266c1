"""The verdict on the records at the doors that give a number: stops, their acceptance by name, and looks."""

import json

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import Verdict, cli
from accelerated_evaluation.records.checks import CHECKS, Records, inspect_records
from accelerated_evaluation.records.limits import AUTOMATIC, limits_of
from accelerated_evaluation.study.configuration import load
from accelerated_evaluation.study.limits import value_of
from law_folder import write_law_folder
from scipy.stats import lognorm, norm

KMH, MPH, FEET = 3.6, 1 / 0.44704, 1 / 0.3048
NAMES = ["lead_speed", "range", "closing_speed"]


def sound(rows=2000):
    """Return cut-ins such as those of a motorway and of towns, in SI units."""
    generator = np.random.default_rng(3)
    speed = generator.uniform(5, 35, rows)
    gap = lognorm(0.5, scale=2.2).rvs(rows, random_state=generator)
    ranges = 4 + gap * speed
    closing = np.abs(norm(0, 0.05).rvs(rows, random_state=generator)) * ranges
    return pd.DataFrame(dict(zip(NAMES, (speed, ranges, closing), strict=True)))


def verdict_of(raw):
    config = load(given={"data": {"source": "table", "table": {"path": "x.csv"}}})
    rows = raw.set_axis(pd.RangeIndex(1, len(raw) + 1, name="row"))
    stated = {key: value_of(config, key) for key in AUTOMATIC}
    limits = limits_of(rows, stated, config["data"])
    filters = {key.split(".")[1]: value for key, value in limits.items() if key.startswith("filters.")}
    return Verdict.of(inspect_records(Records.of(rows, filters, limits["segments.lead_speed_edges"])))


def test_sound_records_have_no_stop():
    assert not verdict_of(sound()).stops


def test_a_likely_fault_is_stated_in_full_next_to_the_number_and_in_files_of_laws():
    """The closing speed is divided by 3.6, which only the comparison with known records shows."""
    found = verdict_of(sound() * np.array([1, 1, 1 / KMH]))
    assert "known records" in {*found.stops, *found.warnings}
    report = pd.DataFrame(
        {
            "check": ["known records", "gaps"],
            "verdict": "warning",
            "seen": ["probably range in ft", "a hole"],
            "advice": "",
            "explained": False,
        }
    )
    verdict = Verdict.of(report)
    (line,) = verdict.warning_lines()
    assert line.startswith("warning: known records (probably range in ft), gaps; ")
    assert Verdict.from_content(json.loads(json.dumps(verdict.content()))).warning_lines() == [line]


def test_impossible_rows_are_not_left_out_of_the_limits_in_silence():
    raw = sound()
    raw.loc[:100, "lead_speed"] *= KMH * 2
    outside = int((raw["lead_speed"] > 70).sum())
    found = verdict_of(raw).stops["rows outside limits"]
    assert f"{outside:,} with lead_speed not from 0 to 70 m/s" in found


@pytest.fixture
def wrong(tmp_path, monkeypatch):
    """Write a configuration of a motorway whose speeds are in km/h and are taken for m/s."""
    monkeypatch.chdir(tmp_path)
    (sound() * np.array((KMH, 1, KMH))).to_csv("records.csv", index=False)
    few = "answer: {draws: 20}\nsurrogate: {maximum_calls: 100}\n"
    data = "data: {source: table, table: {path: records.csv}}\n"
    (tmp_path / "study.yaml").write_text("study: wrong\n" + data + few)
    return tmp_path


def test_estimate_asks_the_records_first(wrong, capsys):
    assert cli.main(["estimate", "--config", "study.yaml", "--law", "hazard"]) != 0
    reported = capsys.readouterr().err
    assert "STOP: speed unit: median" in reported
    assert '--accept "speed unit"' in reported
    assert not (wrong / "results").exists()


def test_an_accepted_stop_is_printed_with_the_number_and_kept_in_its_table(wrong, capsys):
    raw = pd.read_csv("records.csv")
    verdict = verdict_of(raw)
    names = list(verdict.stops)
    accepted = [word for name in names for word in ("--accept", name)]
    assert cli.main(["estimate", "--config", "study.yaml", "--law", "hazard", *accepted]) == 0
    assert "STOP (accepted by name): speed unit" in capsys.readouterr().out
    estimate = pd.read_csv("results/wrong/estimate/estimate.csv")
    assert estimate["records"].tolist() == [verdict.in_short]
    assert verdict.in_short.startswith(f"STOP: {', '.join(names)}; warning: ")


def test_the_configuration_accepts_too_and_refuses_unknown_names(wrong, capsys):
    other = wrong / "accepted.yaml"
    other.write_text(json.dumps({"data": {"accepted_warnings": ["speed units"]}}))
    assert cli.main(["estimate", "--config", "study.yaml", "--config", str(other)]) != 0
    assert "'speed units'; expected names of checks of the records" in capsys.readouterr().err


@pytest.mark.parametrize(
    "door", [["campaign", "new", "c.json"], ["export", "set"]], ids=["campaign new", "export"]
)
def test_campaigns_and_exports_ask_the_encounter_table(door, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_law_folder(tmp_path, closing_unit=KMH)
    line = [*door, "--law", "law.json", "--encounters", "encounters.parquet"]
    assert cli.main(line) != 0
    reported = capsys.readouterr().err
    assert "STOP: unavoidable crashes: " in reported
    names = [name.replace("_", " ") for name in CHECKS if f"STOP: {name.replace('_', ' ')}:" in reported]
    assert cli.main([*line, *(word for name in names for word in ("--accept", name))]) == 0
    assert "STOP (accepted by name): unavoidable crashes" in capsys.readouterr().out
