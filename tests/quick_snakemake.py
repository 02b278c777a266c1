"""Snakemake whose scripts run in forks of one process that has imported the libraries, instead of new ones.

A small job takes two seconds to import them and much less for its work, and a study has sixty jobs. Nothing
else differs: the same scripts run with the same inputs, outputs, parameters and logs, each in a process.

Snakemake also looks for jobs that it may start. It does so when a job ends, and from then on once a second
for each job that has ended, because it starts at most 100 jobs a second. On a busy machine this took as long
as all figures of a study. A study has fewer jobs, so nothing is lost without it.
"""

import multiprocessing
import runpy
import sys
from subprocess import CalledProcessError

from snakemake.benchmark import benchmarked
from snakemake.cli import main
from snakemake.scheduling.job_scheduler import JobScheduler
from snakemake.script import PythonScript

FORKS = multiprocessing.get_context("forkserver")
IMPORTED = [
    "__main__",
    "accelerated_evaluation.laws.paper.models",
    "accelerated_evaluation.publishing.book.execution",
    "accelerated_evaluation.publishing.study",
    "accelerated_evaluation.answer.study",
    "accelerated_evaluation.vehicles.loading",
    "matplotlib.pyplot",
    "scipy.stats",
]


def run_script(path: str) -> None:
    """Run a script, with what Snakemake has put before its first line, as the interpreter does."""
    runpy.run_path(path, run_name="__main__")


def execute_script(self: PythonScript, path: str, edit: bool = False) -> None:
    """Run the script of a job in place of Snakemake's method of this name."""
    process = FORKS.Process(target=run_script, args=(path,))
    process.start()
    with benchmarked(process.pid, self.bench_record):
        process.join()
    if process.exitcode:
        raise CalledProcessError(process.exitcode, path)


if __name__ == "__main__":
    FORKS.set_forkserver_preload(IMPORTED)
    PythonScript.execute_script = execute_script
    JobScheduler._schedule_reevalutation = lambda scheduler, delay: None
    sys.exit(main(sys.argv[1:]))
