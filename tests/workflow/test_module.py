"""The study used from another folder: by its Snakefile, and as a module of another workflow."""

import os
import re
import subprocess
import sys
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parents[2]
MODULE = """
configfile: "config.yaml"


module cut_ins:
    snakefile:
        "{snakefile}"
    config:
        config["cut_ins"]


use rule * from cut_ins as cut_ins_*


rule theirs:
    default_target: True
    input:
        rules.cut_ins_all.input,
"""


def dry_run(folder: Path, *arguments: str) -> subprocess.CompletedProcess:
    """Plan what Snakemake would do in a folder that is not the project's."""
    return subprocess.run(
        [sys.executable, "-m", "snakemake", "--dry-run", "--cores", "2", *arguments],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT / "workflow")},
        capture_output=True,
        text=True,
    )


def planned(run: subprocess.CompletedProcess) -> set[str]:
    """Return the rules that a dry run would run."""
    assert run.returncode == 0, run.stderr[-3000:]
    statistics = (run.stdout + run.stderr).split("Job stats:")[-1].split("\n\n")[0]
    return set(re.findall(r"^(\w+) +\d+$", statistics, flags=re.MULTILINE)) - {"total"}


def test_the_snakefile_of_the_workflow_plans_the_whole_study_in_any_folder(tmp_path):
    braces = "data: {spmd: {description: '{{ x }} {x} {'}}"  # which are no wildcards
    (tmp_path / "mine.yaml").write_text(f"study: mine\n{braces}\n")
    snakefile = str(ROOT / "workflow" / "Snakefile")
    rules = planned(dry_run(tmp_path, "--snakefile", snakefile, "--configfile", "mine.yaml"))
    assert {"ingest_encounters", "map_crashes", "fit_models", "search_proposals", "all"} <= rules
    assert {"estimate_surrogate", *(f"run_{path.stem}" for path in ROOT.glob("notebooks/*.ipynb"))} <= rules
    assert not list(tmp_path.glob("*/mine"))


def test_another_workflow_uses_the_study_as_a_module_with_its_own_settings(tmp_path):
    (tmp_path / "Snakefile").write_text(MODULE.format(snakefile=ROOT / "workflow" / "Snakefile"))
    (tmp_path / "config.yaml").write_text(yaml.safe_dump({"cut_ins": {"study": "mine", "seed": 7}}))
    run = dry_run(tmp_path)
    assert {"cut_ins_ingest_encounters", "cut_ins_run_11_where_crashes_happen", "theirs"} <= planned(run)
    assert "figures/mine/fig01_concept.png" in run.stdout + run.stderr


def test_a_module_that_is_misconfigured_says_what_is_wrong(tmp_path):
    (tmp_path / "Snakefile").write_text(MODULE.format(snakefile=ROOT / "workflow" / "Snakefile"))
    (tmp_path / "config.yaml").write_text(yaml.safe_dump({"cut_ins": {"study": "mine", "sead": 7}}))
    run = dry_run(tmp_path)
    assert run.returncode != 0
    assert "nearest known key: seed" in run.stdout + run.stderr
