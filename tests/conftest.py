"""A copy of the project in a temporary folder, and one finished smoke run in it that many tests look at."""

import copy
import fcntl
import functools
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

# A user's Python keeps what it prints in buffers. Machines that test often switch that off, and hide errors.
os.environ.pop("PYTHONUNBUFFERED", None)

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
PARTS = ("Snakefile", "workflow", "notebooks", "docs", "config", "data", "profiles", "environment.txt")
PARTS += ("benchmarks/results/worlds.csv", "benchmarks/results/worlds_causes.csv")


class Project:
    """A folder with the project's files, and Snakemake in it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @classmethod
    def fresh(cls, folder: Path) -> "Project":
        """Copy the files of the project into a folder, without anything that ran."""
        folder.mkdir(parents=True, exist_ok=True)
        for part in PARTS:
            source = ROOT / part
            if source.is_dir():
                shutil.copytree(source, folder / part, ignore=shutil.ignore_patterns("__pycache__", "raw"))
            else:
                (folder / part).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(source, folder / part)
        return cls(folder)

    def copied(self, folder: Path) -> "Project":
        """Copy this project with all that ran in it, dates included."""
        shutil.copytree(self.folder, folder, dirs_exist_ok=True)
        return Project(folder)

    def command(
        self, *arguments: str, config: str = "config/smoke.yaml", cores: int = 2, quick: bool = False
    ) -> list[str]:
        """Return the command that runs the project; ``quick`` imports the libraries once for all its jobs."""
        snakemake = [str(HERE / "quick_snakemake.py")] if quick else ["-m", "snakemake"]
        return [sys.executable, *snakemake, "--cores", str(cores), *arguments, "--configfile", config]

    @property
    def environment(self) -> dict[str, str]:
        return os.environ | {"PYTHONPATH": str(self.folder / "workflow")}

    def run(self, *arguments: str, **options: str | int | bool) -> subprocess.CompletedProcess:
        return subprocess.run(
            self.command(*arguments, **options),
            cwd=self.folder,
            env=self.environment,
            capture_output=True,
            text=True,
        )

    def tables(self) -> dict[str, bytes]:
        """Every table of the study and the data of every figure, by path."""
        paths = [*self.folder.glob("figures/smoke/**/*.csv"), *self.folder.glob("results/smoke/**/*.csv")]
        return {str(path.relative_to(self.folder)): path.read_bytes() for path in paths}


@pytest.fixture(scope="session")
def stored():
    """Return the function that reads a file of tests/data, by its name: a copy that the test may change."""

    @functools.cache
    def read(name: str) -> pd.DataFrame | dict:
        path = HERE / "data" / name
        if path.suffix == ".json":
            return json.loads(path.read_text())
        return pd.read_parquet(path) if path.suffix == ".parquet" else pd.read_csv(path)

    return lambda name: copy.deepcopy(read(name))


@pytest.fixture(scope="session")
def finished(tmp_path_factory, worker_id):
    """Return a project whose smoke study ran to the end on two cores, once for all processes of the tests.

    Tests only look at it; those that change files do so in a copy.
    """
    if worker_id == "master":
        shared = tmp_path_factory.getbasetemp()
    else:
        shared = tmp_path_factory.getbasetemp().parent  # of all workers of this test run
    folder = shared / "finished_smoke_study"
    with open(shared / "finished_smoke_study.lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (shared / "finished_smoke_study.log").exists():
            run = Project.fresh(folder).run()
            (shared / "finished_smoke_study.log").write_text(f"{run.returncode}\n{run.stdout}{run.stderr}")
    status, output = (shared / "finished_smoke_study.log").read_text().split("\n", 1)
    assert status == "0", output[-5000:]
    return Project(folder)


@pytest.fixture(scope="session")
def project_in():
    """Return the function that copies the project, in which nothing has run yet, into a folder."""
    return Project.fresh


@pytest.fixture
def project(tmp_path):
    """Return a project in which nothing has run yet."""
    return Project.fresh(tmp_path)
