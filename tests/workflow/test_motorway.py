"""A table of another road: from ten lines of configuration to a crash probability, with limits of its own."""

import json
import sys
from pathlib import Path

import pandas as pd
import pytest
import yaml

pytestmark = [pytest.mark.studies, pytest.mark.rest]
ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "unit"))

from motorway import CONFIGURATION, motorway_table  # noqa: E402

AUTO = {"lead_speed_edges": "auto", "closing_speed_max": "auto"}  # which the smoke study states


@pytest.fixture
def motorway(project):
    """Return a project with the generated table, and its ten lines over the sizes of the smoke study."""
    motorway_table().to_csv(project.folder / "data" / "motorway.csv", index=False)
    config = yaml.safe_load((project.folder / "config" / "smoke.yaml").read_text())
    config["sensitivity"] |= AUTO
    config["answer"]["grid"] = config["crash_map"]["grid"]  # a coarser map would be refused on this road
    del config["data"]
    config |= yaml.safe_load(CONFIGURATION)
    (project.folder / "motorway.yaml").write_text(yaml.safe_dump(config))
    return project


def test_motorway_cut_ins_are_not_cut_away_and_give_a_crash_probability(motorway):
    assert len(CONFIGURATION.splitlines()) <= 10
    results = motorway.folder / "results" / "motorway"
    targets = [
        f"results/motorway/{name}" for name in ("laws/answer.csv", "config.json", "records_report.csv")
    ]
    run = motorway.run(*targets, config="motorway.yaml")
    assert run.returncode == 0, (run.stdout + run.stderr)[-5000:]

    config = json.loads((results / "config.json").read_text())
    assert config["filters"] == {"lead_speed_min": 20, "lead_speed_max": 45, "range_max": 150}
    account = pd.read_csv(results / "encounters_account.csv").set_index("step")
    assert account.loc[["lead_speed", "range"], "rows_dropped"].sum() == 0

    crash = pd.read_csv(results / "laws" / "answer.csv").set_index("event").loc["crash"]
    assert 0 < crash["low80"] < crash["median"] < crash["high80"] < 1e-3
    report = pd.read_csv(results / "records_report.csv").set_index("check")["verdict"]
    assert "stop" not in set(report)
    assert report["rows outside limits"] == "fine"
    assert "0 stop" in (results / "logs" / "inspect_records.log").read_text()
