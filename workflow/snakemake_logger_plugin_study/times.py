"""How long the jobs of each rule will take: as in the last run, otherwise as in the published study."""

import csv
import json
from collections.abc import Mapping
from pathlib import Path

from accelerated_evaluation.base.files import PROJECT

LAST_RUN = Path(".snakemake/metadata")  # of Snakemake: a file for each output of a finished job
SHIPPED = PROJECT / "benchmarks/results/rules.csv"
TRUST = 0.1  # share of all work that has to be done until this run counts as much as the expected times


def expected_seconds(last_run: Path = LAST_RUN, shipped: Path = SHIPPED) -> dict[str, float]:
    """Return the mean seconds of a job of each rule, where they are known."""
    known = {}
    if shipped.is_file():
        with open(shipped, newline="", encoding="utf-8") as file:
            known = {
                row["rule"]: float(row["seconds_all"]) / int(row["jobs"]) for row in csv.DictReader(file)
            }
    jobs: dict[str, dict[int, float]] = {}  # seconds by job, which may have several outputs
    for path in last_run.rglob("*"):
        try:
            job = json.loads(path.read_text(encoding="utf-8"))
            jobs.setdefault(job["rule"], {})[job["job_hash"]] = job["endtime"] - job["starttime"]
        except (OSError, ValueError, KeyError, TypeError):
            continue  # a folder, or a job that did not end
    last = {rule: sum(run.values()) / len(run) for rule, run in jobs.items()}
    return known | last


def pace(expected: Mapping[str, float], took: Mapping[str, list[float]], left: Mapping[str, int]) -> float:
    """Return how many times as long as expected the jobs of this run take.

    It is 1 before the first job, and the ratio of the times of the finished jobs as soon as they were a large
    part of the work: the first jobs are short, and say little about the others.
    """
    done = sum(len(times) * expected[rule] for rule, times in took.items() if rule in expected)
    work = done + sum(count * expected[rule] for rule, count in left.items() if rule in expected)
    spent = sum(sum(times) for rule, times in took.items() if rule in expected)
    return (spent + TRUST * work) / (done + TRUST * work) if work else 1.0
