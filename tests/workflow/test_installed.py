"""The wheels of study and sampler work without the repository, with a vehicle in a file of the user."""

import os
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.base.files import PROJECT
from accelerated_evaluation.scenarios import SCENARIOS

pytestmark = pytest.mark.studies
ROOT = Path(__file__).resolve().parents[2]
CAR = '''
import numpy as np
from accelerated_evaluation.vehicles import Outcomes


class Car:
    """Brakes with 6 m/s^2 after one second; the lead vehicle keeps its speed."""

    deterministic = True

    def simulate(self, lead_speed, range_, closing_speed):
        left = range_ - closing_speed - closing_speed**2 / 12
        crash = left <= 0
        return Outcomes(crash, np.maximum(left, 0), np.ones(len(left)), np.where(crash, closing_speed, 0.0))
'''


@pytest.fixture(scope="module")
def wheels(tmp_path_factory):
    """Return the wheels of the study and of the sampler."""
    folder = tmp_path_factory.mktemp("wheels")
    options = ["--quiet", "--no-deps", "--no-build-isolation", "--wheel-dir", str(folder)]
    sources = [str(ROOT), str(ROOT / "fewruns")]
    subprocess.run([sys.executable, "-m", "pip", "wheel", *options, *sources], check=True)
    return next(folder.glob("accelerated_evaluation-*.whl")), next(folder.glob("fewruns-*.whl"))


def test_the_wheel_of_the_sampler_holds_its_package_and_nothing_else(wheels):
    files = {name for name in zipfile.ZipFile(wheels[1]).namelist() if ".dist-info/" not in name}
    sources = (ROOT / "fewruns/src/fewruns").glob("*.py")
    pages = {f"fewruns/pages/{name}" for name in ("README.md", "method.md", "sampler_reference.md")}
    pages |= {"fewruns/pages/method_course.svg", "fewruns/py.typed"}
    assert files == pages | {f"fewruns/{path.name}" for path in sources}
    assert wheels[1].stat().st_size < 2e5


def test_the_wheel_of_the_study_holds_all_packages_and_the_files_that_they_read(wheels):
    wheel = wheels[0]
    files = set(zipfile.ZipFile(wheel).namelist())
    code = {path.relative_to(ROOT / "workflow") for path in (ROOT / "workflow").glob("*/**/*.py")}
    assert {str(path) for path in code if path.parts[0] != "scripts"} <= files
    read = [each.records.file for each in SCENARIOS.values() if each.records.file is not None]
    read += ["config/config.yaml", "data/spmd/cut_ins.parquet"]
    assert {f"accelerated_evaluation/project/{path}" for path in read} <= files
    assert wheel.stat().st_size < 8e6


@pytest.fixture(scope="module")
def run(wheels, tmp_path_factory):
    """Return the function that runs a program of an environment with the wheels, in a folder of its own."""
    environment = tmp_path_factory.mktemp("environment")
    venv.create(environment)
    (packages,) = environment.glob("lib/*/site-packages")
    # Dependencies are those of the tests. Their link to this project is not followed from here.
    (packages / "dependencies.pth").write_text(str(Path(np.__file__).parents[1]))
    pip = [sys.executable, "-m", "pip", "--python", str(environment / "bin/python"), "install", "--quiet"]
    subprocess.run([*pip, "--no-deps", "--no-index", *map(str, wheels)], check=True)
    folder = tmp_path_factory.mktemp("empty")
    clean = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}

    def run(program, *arguments):
        command = [environment / "bin" / program, *arguments]
        done = subprocess.run(command, cwd=folder, env=clean, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr[-3000:]
        return done.stdout

    run.folder = folder
    return run


def test_the_installed_library_is_not_that_of_the_repository(run):
    shown = run("python", "-c", "from accelerated_evaluation.base.files import PROJECT; print(PROJECT)")
    assert Path(shown.strip()).parts[-3:] == ("site-packages", "accelerated_evaluation", "project")
    assert PROJECT == ROOT


def test_a_vehicle_in_a_file_is_simulated_inspected_and_estimated(run):
    (run.folder / "car.py").write_text(CAR)
    (run.folder / "my.yaml").write_text("study: mine\nvehicle: {name: 'car.py:Car'}\n")
    cut_ins = pd.DataFrame({"lead_speed": 20.0, "range": [9.0, 50.0], "closing_speed": 8.0})
    cut_ins.to_csv(run.folder / "cut_ins.csv", index=False)
    run("accelerated-evaluation", "simulate", "cut_ins.csv", "out.csv", "--vehicle", "car.py:Car")
    assert pd.read_csv(run.folder / "out.csv")["crash"].tolist() == [True, False]
    assert "of 157,757 rows" in run("accelerated-evaluation", "inspect", "my.yaml")
    run("accelerated-evaluation", "estimate", "--config", "my.yaml")
    found = pd.read_csv(run.folder / "results/mine/estimate/estimate.csv").iloc[0]
    assert found["converged"]
    assert 0 < found["probability"] < 1e-3


@pytest.mark.parametrize("name", sorted(SCENARIOS.keys() - {"cut_in"}))
def test_the_records_of_every_scenario_are_there(run, name):
    (run.folder / f"{name}.yaml").write_text(f"scenario: {{name: {name}}}\n")
    assert "warning, 0 stop." in run("accelerated-evaluation", "inspect", f"{name}.yaml")
