"""A copy of the project in a temporary folder, and one finished smoke run in it that many tests look at."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PARTS = ("Snakefile", "workflow", "notebooks", "config", "data", "profiles")


class Project:
    """A copy of the project's files, and Snakemake in it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        for part in PARTS:
            source = ROOT / part
            if source.is_dir():
                shutil.copytree(source, folder / part, ignore=shutil.ignore_patterns("__pycache__", "raw"))
            else:
                shutil.copy2(source, folder / part)

    def command(self, *arguments: str, config: str = "config/smoke.yaml", cores: int = 2) -> list[str]:
        return [
            sys.executable, "-m", "snakemake", "--cores", str(cores), *arguments, "--configfile", config,
        ]  # fmt: skip

    @property
    def environment(self) -> dict[str, str]:
        return os.environ | {"PYTHONPATH": str(self.folder / "workflow")}

    def run(self, *arguments: str, **options: str | int) -> subprocess.CompletedProcess:
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
def finished(tmp_path_factory):
    """Return a project whose smoke study ran to the end on two cores."""
    project = Project(tmp_path_factory.mktemp("finished"))
    run = project.run()
    assert run.returncode == 0, run.stderr[-5000:]
    return project


@pytest.fixture
def project(tmp_path):
    """Return a project in which nothing has run yet."""
    return Project(tmp_path)
