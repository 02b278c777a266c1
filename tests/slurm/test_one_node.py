"""Results of the smoke study through profiles/slurm, on a Slurm that is this machine; one job is killed."""

import json
import os
import re
import sqlite3
import subprocess
import sys
import time
from contextlib import closing, suppress

import pytest
from one_node import OneNodeSlurm, missing_programs

RESULTS = ("results/smoke/estimates.csv", "results/smoke/uncertainty.csv")  # with all that they need
PATIENCE = 3600  # seconds for these results, on a machine that has other things to do

pytestmark = [
    pytest.mark.slurm,
    pytest.mark.skipif(
        bool(missing_programs()),
        reason=f"no Slurm on this machine ({', '.join(missing_programs())}); tests/slurm/install.sh",
    ),
]


@pytest.fixture(scope="module")
def slurm():
    """Return a Slurm that runs while the tests of this file do."""
    with OneNodeSlurm() as cluster:
        yield cluster


@pytest.mark.rest  # four minutes of processor time
def test_slurm_makes_the_same_tables_though_a_job_is_killed(slurm, project_with_toys, request):
    """The study without Slurm, which it is compared with, is asked for last: another process may run it."""
    project = project_with_toys
    command = [*project.command(*RESULTS), "--workflow-profile", "profiles/slurm"]
    command[command.index("--cores") + 1] = "1"  # of a Slurm job, as in the profile
    command += ["--slurm-init-seconds-before-status-checks", "2"]
    with open(project.folder / "slurm.txt", "wb") as output:
        environment = slurm.environment | {"PYTHONPATH": str(project.folder / "workflow")}
        begun = time.monotonic()
        study = subprocess.Popen(
            command, cwd=project.folder, env=environment, stdout=output, stderr=subprocess.STDOUT
        )
        try:
            killed = kill_a_job_at_work(slurm, project, study)
            study.wait(timeout=PATIENCE)
        finally:
            study.kill()  # which does nothing to a study that has ended
    took = time.monotonic() - begun
    said = (project.folder / "slurm.txt").read_text()
    assert study.returncode == 0, said[-5000:]
    states = dict(re.findall(r"^(\d+) (\w+)$", slurm.ask("squeue", "-h", "-t", "all", "-o", "%i %T"), re.M))
    assert states.pop(killed) in ("FAILED", "CANCELLED")
    assert set(states.values()) == {"COMPLETED"}
    print(
        f"\n{len(states)} Slurm jobs beside the one that was killed, {took:.0f} s, on {os.cpu_count()} cores"
    )
    tables, expected = project.tables(), request.getfixturevalue("finished").tables()
    assert set(RESULTS) <= set(tables)
    assert {path: content for path, content in expected.items() if path in tables} == tables


CAR = """
import time
from accelerated_evaluation import load_vehicle


class Car:
    deterministic = True

    def simulate(self, *columns):
        time.sleep(0.2 * len(columns[0]))
        return load_vehicle("acc_aeb", "left_turn").simulate(*columns)
"""


def test_an_estimate_through_slurm_goes_on_though_a_job_is_cancelled(slurm, tmp_path):
    """Dask submits another job, and the answer is the same as from processes of this machine."""
    pytest.importorskip("dask_jobqueue", reason="Dask, the extra 'cluster', is not installed")
    answers = {}
    for executor in ("slurm", "processes"):
        folder = tmp_path / executor
        folder.mkdir()
        (folder / "car.py").write_text(CAR)
        options = {"memory": "1 GB", "walltime": "01:00:00"} if executor == "slurm" else {}
        keys = {"keep_class": True, "executor": executor, "options": options}
        vehicle = {"name": "car.py:Car", "deterministic": True}
        (folder / "car.yaml").write_text(json.dumps({"vehicle": vehicle, "simulations": keys}))
        command = [sys.executable, "-m", "accelerated_evaluation.cli", "estimate", "--config", "car.yaml"]
        command += ["--scenario", "left_turn", "--law", "independent_variables"]
        environment = slurm.environment | {"NO_COLOR": "1"}
        with open(folder / "out.txt", "wb") as output:
            study = subprocess.Popen(
                command, cwd=folder, env=environment, stdout=output, stderr=subprocess.STDOUT
            )
            if executor == "slurm":
                cancel_a_job_at_work(slurm, folder, study)
            study.wait(timeout=PATIENCE)
        said = (folder / "out.txt").read_text()
        assert study.returncode == 0, said[-5000:]
        assert ("lost and simulated again" in said) == (executor == "slurm")
        (table,) = folder.glob("results/*/estimate/answer.csv")
        answers[executor] = table.read_text()
    assert answers["slurm"] == answers["processes"]


def cancel_a_job_at_work(slurm, folder, study):
    """Cancel a job when the estimate has stored some outcomes."""
    deadline, stored = time.monotonic() + PATIENCE, 0
    while stored < 60:
        assert study.poll() is None, (folder / "out.txt").read_text()[-5000:]
        assert time.monotonic() < deadline
        time.sleep(0.5)
        for path in folder.glob("results/vehicles/*/outcomes.sqlite"):
            with closing(sqlite3.connect(path)) as connection, suppress(sqlite3.OperationalError):
                stored = connection.execute("SELECT count(*) FROM outcomes").fetchone()[0]
    jobs = slurm.ask("squeue", "-h", "-t", "running", "-o", "%i").split()
    slurm.ask("scancel", jobs[0])


def kill_a_job_at_work(slurm, project, study):
    """Kill the Slurm job that has just written the encounter table, and return its number."""
    deadline = time.monotonic() + PATIENCE
    while not (project.folder / "results/smoke/encounters.parquet").exists():
        assert study.poll() is None, (project.folder / "slurm.txt").read_text()[-5000:]
        assert time.monotonic() < deadline
        time.sleep(0.2)
    jobs = slurm.ask("squeue", "-h", "-t", "running", "-o", "%i %k").splitlines()
    (job,) = [line.split()[0] for line in jobs if "prepare" in line]
    slurm.ask("scancel", "--full", "--signal=KILL", job)
    return job
