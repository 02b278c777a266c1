"""Results of the smoke study through profiles/slurm, on a Slurm that is this machine; one job is killed."""

import os
import re
import subprocess
import time

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
