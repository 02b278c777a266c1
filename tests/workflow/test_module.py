"""The study used from another folder: by its Snakefile, and as a module of another workflow."""

import io
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest
import yaml
from conftest import Project

ROOT = Path(__file__).resolve().parents[2]
MODULE = """
configfile: "config.yaml"


module cut_ins:
    snakefile:
        "{snakefile}"
    config:
        config["cut_ins"]
{prefix}

use rule * from cut_ins as cut_ins_*


rule theirs:
    default_target: True
    input:
        rules.cut_ins_all.input,
"""


LIMITS = {"filters": dict.fromkeys(("lead_speed_min", "lead_speed_max", "range_max"), "auto")}


def stranger(project: Path = ROOT, prefix: str = "") -> str:
    """Return the Snakefile of another workflow that uses this one as a module."""
    moved = f"    prefix:\n        {prefix!r}\n" if prefix else ""
    return MODULE.format(snakefile=project / "workflow" / "Snakefile", prefix=moved)


def dry_run(folder: Path, *arguments: str, project: Path = ROOT) -> subprocess.CompletedProcess:
    """Plan what Snakemake would do in a folder that is not the project's."""
    return subprocess.run(
        [sys.executable, "-m", "snakemake", "--dry-run", "--cores", "2", *arguments],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(project / "workflow")},
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
    (tmp_path / "Snakefile").write_text(stranger())
    (tmp_path / "config.yaml").write_text(yaml.safe_dump({"cut_ins": {"study": "mine", "seed": 7}}))
    run = dry_run(tmp_path)
    assert {"cut_ins_ingest_encounters", "cut_ins_run_02_the_answer", "theirs"} <= planned(run)
    assert "figures/mine/fig01_concept.png" in run.stdout + run.stderr


def test_the_default_target_of_another_workflow_stays_its_own(tmp_path):
    module = stranger(prefix="risk").partition("rule theirs")[0]
    own = "rule theirs:\n    output:\n        'a.txt',\n    shell:\n        'touch {output}'\n"
    (tmp_path / "Snakefile").write_text(f"{own}{module}")
    (tmp_path / "config.yaml").write_text(yaml.safe_dump({"cut_ins": {"study": "mine", **LIMITS}}))
    assert planned(dry_run(tmp_path)) == {"theirs"}
    written = {path.relative_to(tmp_path).parts[0] for path in tmp_path.glob("*")}
    assert written <= {"Snakefile", "config.yaml", ".snakemake", "risk"}
    assert (tmp_path / "risk/results/mine/limits.json").is_file()


def test_two_studies_of_a_workflow_have_the_same_modules(tmp_path):
    """They share the processes, so the figure of one would be drawn in the other.

    Each has a prefix of its own, because both would make the crash maps of the same vehicles.
    """
    text = stranger(prefix="first")
    second = text[text.index("module") : text.index("rule theirs")].replace("cut_ins", "others")
    second = second.replace("first", "second")
    (tmp_path / "Snakefile").write_text(f"{text}\n{second}")
    shutil.copy(ROOT / "tests/toys/mine/toy_figure.py", tmp_path / "toy.py")
    studies = {"cut_ins": {"study": "one", "modules": ["toy.py"]}, "others": {"study": "other"}}
    (tmp_path / "config.yaml").write_text(yaml.safe_dump(studies))
    run = dry_run(tmp_path)
    assert run.returncode != 0
    assert 'modules: seen ["toy.py"] in the study one, and [] in the study other;' in run.stdout + run.stderr
    studies["others"]["modules"] = ["toy.py"]
    (tmp_path / "config.yaml").write_text(yaml.safe_dump(studies))
    assert {"cut_ins_draw_toy_figure", "others_all"} <= planned(dry_run(tmp_path, "theirs", "others_all"))


def test_a_module_that_is_misconfigured_says_what_is_wrong(tmp_path):
    (tmp_path / "Snakefile").write_text(stranger())
    (tmp_path / "config.yaml").write_text(yaml.safe_dump({"cut_ins": {"study": "mine", "sead": 7}}))
    run = dry_run(tmp_path)
    assert run.returncode != 0
    assert "nearest known key: seed" in run.stdout + run.stderr


@pytest.mark.parametrize("place", ["elsewhere", "below"])
def test_the_prefix_of_a_module_moves_results_and_no_file_of_the_user_or_the_project(tmp_path, place):
    """Also if the project is in a folder of the other workflow, as a submodule of Git is."""
    project = Project.fresh(tmp_path / "study").folder if place == "below" else ROOT
    (tmp_path / "Snakefile").write_text(stranger(project, "risk"))
    records = pd.read_parquet(ROOT / "data/spmd/cut_ins.parquet").head(3000)
    records["range"] = 1 / records["inverse_range"]
    records["closing_speed"] = records["inverse_ttc"] * records["range"]
    records[["lead_speed", "range", "closing_speed"]].to_csv(tmp_path / "my.csv", index=False)
    shutil.copy(ROOT / "tests/corpus/odd_vehicles.py", tmp_path / "my.py")
    name = re.search(r"^class (\w+)", (tmp_path / "my.py").read_text(), re.MULTILINE)[1]
    own = {"study": "mine", "data": {"source": "table", "table": {"path": "my.csv"}}}
    own["vehicle"] = {"name": f"my.py:{name}"}
    (tmp_path / "config.yaml").write_text(yaml.safe_dump({"cut_ins": own}))
    # The plan fails if an input is missing, as a file of the user or the project with the prefix would be.
    run = dry_run(tmp_path, "--summary", project=project)
    assert run.returncode == 0, run.stderr[-3000:]
    printed = run.stdout
    summary = pd.read_csv(io.StringIO(printed[printed.index("output_file\t") :]), sep="\t")
    assert "cut_ins_study_answer" in set(summary["rule"])
    folders = {tuple(Path(file).parts[:2]) for file in summary["output_file"]}
    assert folders == {("risk", "results"), ("risk", "figures")}
