"""The profile for Slurm asks for what was measured, and runs short jobs together."""

import sys
from pathlib import Path

import pandas as pd
import yaml

ROOT = Path(__file__).resolve().parents[3]
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
