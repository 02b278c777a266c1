"""The guides to records: their commands run, their settings are those of the configuration."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest
from accelerated_evaluation.study.configuration import load

ROOT = Path(__file__).resolve().parents[3]
GUIDE = (ROOT / "docs" / "your_records.md").read_text(encoding="utf-8")
FORMATS = (ROOT / "docs" / "formats_of_recordings.md").read_text(encoding="utf-8")
COMMANDS = {
    "python": [sys.executable],
    "accelerated-evaluation": [sys.executable, "-m", "accelerated_evaluation.cli"],
}
COMMANDS["snakemake"] = [sys.executable, "-m", "snakemake"]


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", GUIDE, re.DOTALL)


def configurations():
    """Return the configurations of the guide by the name in their first line."""
    return {block.split("\n")[0].removeprefix("# "): block for block in blocks("yaml")}


@pytest.mark.studies
def test_the_commands_of_the_guide_run_as_they_stand(project):
    folder = project.folder
    (folder / "benchmarks" / "recordings").symlink_to(ROOT / "benchmarks" / "recordings")
    for name, content in configurations().items():
        (folder / name).write_text(content)
    for line in "".join(blocks("sh")).splitlines():
        program, *arguments = shlex.split(line)
        run = subprocess.run(
            [*COMMANDS[program], *arguments],
            cwd=folder,
            env=project.environment,
            capture_output=True,
            text=True,
        )
        assert run.returncode == 0, line + run.stdout + run.stderr
    found = {path.name for path in (folder / "results" / "motorway").iterdir()}
    assert {"encounters.parquet", "encounters_account.csv", "exposure.json"} <= found
    account = pd.read_csv(folder / "results/motorway/encounters_account.csv")
    assert account["rows_in"].tolist()[1:] == account["rows_kept"].tolist()[:-1]
    encounters = pd.read_parquet(folder / "results/motorway/encounters.parquet")
    planted = pd.read_csv(folder / "data/raw/motorway_planted.csv")
    assert len(encounters) == (planted["closing_speed"] > 0).sum() == account["rows_kept"].iloc[-1]
    cut_ins = pd.read_parquet(folder / "results/cut_ins.parquet")
    assert len(cut_ins) == len(pd.read_csv(folder / "data/raw/safety_pilot_planted.csv"))
    exits = pd.read_csv(folder / "results/exits.csv")
    assert len(exits) == len(pd.read_csv(folder / "data/raw/exits_planted.csv"))


def test_the_configuration_of_the_guide_has_ten_lines_and_is_valid(tmp_path):
    content = configurations()["motorway.yaml"]
    assert len(content.splitlines()) <= 10
    (tmp_path / "motorway.yaml").write_text(content)
    assert load([tmp_path / "motorway.yaml"])["filters"]["range_max"] == "auto"


def test_every_setting_of_the_rule_is_explained():
    data = load()["data"]
    for section in ("spmd_raw", "highd", "exid"):
        names = set(data[section]) - {"description", "path", "outlier_rows", "rule"} | set(
            data[section]["rule"]
        )
        assert all(f"| `{name}` |" in FORMATS for name in names)
