# Start of a run of any workflow of this project: the packages that it needs, removal of locks of killed runs, and of the
# limit on starts of jobs.
#
# In, out: nothing; definitions only. Each main Snakefile includes this file.

from accelerated_evaluation.base.environment import import_from_here, missing_in_words
from snakemake.exceptions import WorkflowError

if missing := missing_in_words():
    raise WorkflowError(missing)
import_from_here()

from accelerated_evaluation.study.jobs import release_dead_locks

# Only the main process removes locks: a job of a cluster cannot know whether a run on another machine is alive.
ALIVE = release_dead_locks() if workflow.is_main_process else None


# Snakemake limits the number of jobs that start within a second. With this limit, each check of the list of jobs
# causes another check one second later. The checks accumulate: after 70 jobs there are 70 checks per second, which take
# a fifth of the processor time of a study. The limit is therefore removed for jobs on this machine.
onstart:
    if workflow.local_exec:
        workflow.scheduler.job_rate_limiter = None
