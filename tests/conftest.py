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

# Two processes of the tests share the cores. With several threads each, OpenBLAS mostly waits for itself.
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import SCENARIOS, load_vehicle

# A user's Python keeps what it prints in buffers. Machines that test often switch that off, and hide errors.
os.environ.pop("PYTHONUNBUFFERED", None)

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
PARTS = ["Snakefile", "workflow", "notebooks", "docs", "fewruns", "config", "data", "profiles", "article"]
BENCHMARKS = "worlds motorway motorway_chain europe samplers successors answers chance hidden vehicles"
PARTS += ["environment.txt", *(f"benchmarks/results/{name}.csv" for name in BENCHMARKS.split())]
WITH_TOYS = ("config/smoke.yaml", "config/toys.yaml")


LEFT_OUT = """\
The tests marked browser, slurm and crate: pytest -m "browser or slurm or crate"
Whole studies and other long tests, the benchmarks' own and the installed wheel: make test-studies
The sampler over many seeds, if fewruns/ has changed: make test-fewruns"""


def pytest_terminal_summary(terminalreporter, config):
    """Say at the end which tests the options in pyproject.toml leave out, and how to run them."""
    if config.option.markexpr == "not (browser or slurm or crate or studies or seeds)":
        terminalreporter.section("left out")
        terminalreporter.write_line(LEFT_OUT)


@pytest.fixture(autouse=True)
def _closed_figures():
    """Close all figures after each test, without an import of Matplotlib if there are none."""
    yield
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")


@functools.cache
def compile_vehicles() -> None:
    """Compile the kernels of the vehicles in this project, so that its copies need not.

    The processes of the tests wait for each other, because each would compile all of them.
    """
    with open(__file__) as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        cut_in = np.array([20.0]), np.array([20.0]), np.array([3.0])
        for name in ("acc_aeb", "cc_human", "human"):
            vehicle = load_vehicle(name)
            vehicle.simulate(*cut_in)
            vehicle.simulate_moving(*cut_in, np.full((1, 81), 20.0))
            vehicle.trace(*np.ravel(cut_in))
        left_turn = SCENARIOS["left_turn"]
        middle = [[(variable.low + variable.high) / 2] for variable in left_turn.variables]
        load_vehicle(left_turn.default_vehicle, left_turn).simulate(*np.array(middle))


class Project:
    """A folder with the project's files, the configurations of its study, and Snakemake in it."""

    def __init__(self, folder: Path, *configs: str) -> None:
        self.folder = folder
        self.configs = configs or ("config/smoke.yaml",)

    @classmethod
    def fresh(cls, folder: Path) -> "Project":
        """Copy the files of the project into a folder, without anything that ran."""
        compile_vehicles()
        folder.mkdir(parents=True, exist_ok=True)
        for part in PARTS:
            source = ROOT / part
            if source.is_dir():
                # Compiled code comes along: it is valid as long as its sources keep their dates.
                shutil.copytree(source, folder / part, ignore=shutil.ignore_patterns("raw"))
            else:
                (folder / part).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(source, folder / part)
        return cls(folder)

    @classmethod
    def with_toys(cls, folder: Path) -> "Project":
        """Copy the project with the toys of tests/toys, which its study then uses."""
        cls.fresh(folder)
        shutil.copytree(
            HERE / "toys", folder, dirs_exist_ok=True, ignore=shutil.ignore_patterns("*.pyc", "*.md")
        )
        return cls(folder, *WITH_TOYS)

    def copied(self, folder: Path) -> "Project":
        """Copy this project with all that ran in it, dates included."""
        shutil.copytree(self.folder, folder, dirs_exist_ok=True)
        return Project(folder, *self.configs)

    def command(self, *arguments: str, config: str = "", cores: int = 2) -> list[str]:
        """Return the command that runs Snakemake here, with other configurations if any are given."""
        snakemake = [sys.executable, "-m", "snakemake", "--cores", str(cores)]
        return [*snakemake, *arguments, "--configfile", *(config.split() or self.configs)]

    @property
    def environment(self) -> dict[str, str]:
        return os.environ | {"PYTHONPATH": f"{self.folder}/workflow{os.pathsep}{self.folder}/fewruns/src"}

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
    """Return a project whose smoke study, with the toys, ran to the end on two cores: once for all tests.

    Tests only read it; those that change files do so in a copy (``finished.copied``).
    """
    if worker_id == "master":
        shared = tmp_path_factory.getbasetemp()
    else:
        shared = tmp_path_factory.getbasetemp().parent  # of all workers of this test run
    folder = shared / "finished_smoke_study"
    with open(shared / "finished_smoke_study.lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (shared / "finished_smoke_study.log").exists():
            run = Project.with_toys(folder).run()
            (shared / "finished_smoke_study.log").write_text(f"{run.returncode}\n{run.stdout}{run.stderr}")
    status, output = (shared / "finished_smoke_study.log").read_text().split("\n", 1)
    assert status == "0", output[-5000:]
    return Project(folder, *WITH_TOYS)


@pytest.fixture(scope="session")
def project_in():
    """Return the function that copies the project, in which nothing has run yet, into a folder."""
    return Project.fresh


@pytest.fixture
def project(tmp_path):
    """Return a project in which nothing has run yet."""
    return Project.fresh(tmp_path)


@pytest.fixture
def project_with_toys(tmp_path):
    """Return a project with the toys in which nothing has run yet: that of ``finished``, before its run."""
    return Project.with_toys(tmp_path)


@pytest.fixture(scope="module")
def browser():
    """Start the Chromium of this machine; the tests that need it are skipped where there is none."""
    playwright = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed")
    chromium = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if chromium is None:
        pytest.skip("no Chromium is installed on this machine")
    with playwright.sync_playwright() as driver:
        # A container's root has no sandbox for the pages, which are our own.
        options = ["--no-sandbox"] if os.geteuid() == 0 else []
        started = driver.chromium.launch(executable_path=chromium, args=options)
        yield started
        started.close()
