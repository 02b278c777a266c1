"""The profile for Slurm asks for what was measured, and runs short jobs together."""

import sys
from pathlib import Path

import pandas as pd
import pytest
import yaml
from accelerated_evaluation.base.errors import InputError

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "benchmarks"))

import rules  # noqa: E402

MEASURED = pd.read_csv(rules.MEASURED)
PROFILE = yaml.safe_load(rules.PROFILE.read_text())
SHORT = 30  # seconds that the jobs of a rule take together, below which it may not be a job of Slurm


def test_the_profile_is_made_from_the_table_of_measurements():
    assert rules.profile(rules.PROFILE.read_text(), MEASURED) == rules.PROFILE.read_text()


def test_short_rules_run_together():
    short = MEASURED.loc[MEASURED["seconds_longest"] < SHORT, "rule"]
    assert not set(short) - set(PROFILE["groups"])
    assert set(PROFILE["groups"].values()) == set(PROFILE["group-components"])


def test_requests_leave_room_above_what_was_measured():
    for row in MEASURED.itertuples():
        asked = PROFILE["set-resources"][row.rule]
        minutes, memory = (int(asked[key].split(" *")[0]) for key in ("runtime", "mem_mb"))
        assert 60 * minutes >= 5 * row.seconds_longest
        assert memory >= 1.5 * row.memory_mb


def test_benchmarks_of_a_study_are_measured_by_rule(tmp_path):
    results = tmp_path / "results" / "mine"
    written = {
        "benchmarks/fit_models.tsv": (10.0, 200.0, 50.0),
        "benchmarks/search_proposals/single_0.tsv": (4.0, 300.0, 100.0),
        "benchmarks/search_proposals/single_1.tsv": (6.0, 310.0, 100.0),
        "benchmarks/notebooks/01_what_happens.tsv": (20.0, 500.0, 100.0),
        "../vehicles/rss-0123/benchmarks/map_crashes.tsv": (30.0, 400.0, 100.0),
    }
    for path, row in written.items():
        (results / path).parent.mkdir(parents=True, exist_ok=True)
        pd.DataFrame([row], columns=["s", "max_rss", "mean_load"]).to_csv(
            results / path, sep="\t", index=False
        )
    measured = rules.measure(results).set_index("rule")
    assert measured["jobs"].to_dict() == {
        "fit_models": 1, "map_crashes": 1, "run_01_what_happens": 1, "search_proposals": 2
    }  # fmt: skip
    assert measured.loc["fit_models", "seconds_longest"] == pytest.approx(5)
    assert measured.loc["search_proposals", "seconds_all"] == pytest.approx(10)
    assert measured.loc["search_proposals", "memory_mb"] == pytest.approx(310)
    asked = yaml.safe_load("".join(rules.requests(measured.reset_index())))
    assert asked["map_crashes"] == {"runtime": "5 * attempt", "mem_mb": "1000 * attempt"}


def test_a_folder_without_benchmarks_is_refused(tmp_path):
    with pytest.raises(InputError, match="benchmarks"):
        rules.measure(tmp_path)
