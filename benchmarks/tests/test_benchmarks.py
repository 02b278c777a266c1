"""The workflows of the benchmarks find all inputs, and plan their jobs where a run was killed."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.studies
ROOT = Path(__file__).resolve().parents[2]
PARTS = (
    "article",
    "benchmarks",
    "config",
    "data",
    "docs",
    "fewruns",
    "notebooks",
    "profiles",
    "tests",
    "workflow",
)
JOBS = {
    "benchmarks/claims/Snakefile": {"run_sampler", "run_worlds", "study_study_answer", "vehicle"},
    "benchmarks/motorway/Snakefile": {"drive", "count", "chain", "sum_counts", "join_worlds"},
    "benchmarks/samplers/Snakefile": {"run", "reference", "summarise"},
    "benchmarks/samplers/vehicles.smk": {"run", "compare"},
    "benchmarks/worlds/Snakefile": {"prepare", "run", "summarise"},
}


@pytest.mark.parametrize("name", JOBS)
def test_a_benchmark_plans_its_jobs(name, tmp_path):
    for part in PARTS:
        (tmp_path / part).symlink_to(ROOT / part)
    lock = tmp_path / ".snakemake/locks/0.output.lock"  # of a run that was killed
    lock.parent.mkdir(parents=True)
    lock.touch()
    command = [
        sys.executable,
        "-m",
        "snakemake",
        "--snakefile",
        name,
        "--cores",
        "2",
        "--dry-run",
        "--forceall",  # whichever of the published files are newer than the code
    ]
    environment = os.environ | {"PYTHONPATH": str(ROOT / "workflow")}
    run = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr[-3000:] + run.stdout[-3000:]
    statistics = (run.stdout + run.stderr).split("Job stats:")[-1].split("\n\n")[0]
    assert JOBS[name] <= set(re.findall(r"^(\w+) +\d+$", statistics, flags=re.MULTILINE))
    assert not lock.exists()
