# How a run of any workflow of this project begins: locks that killed runs left behind, and the pace of jobs.
#
# In, out: nothing; definitions only. Each main Snakefile includes this file.

from accelerated_evaluation.study.locks import release_dead_locks

# A job of a cluster runs on a machine of its own, which cannot know whether the run that sent it is alive.
ALIVE = release_dead_locks() if workflow.is_main_process else None


# Snakemake limits how many jobs begin within a second. For that it examines all jobs once more a second after each
# examination that it makes, so the examinations add up: after 70 jobs there are 70 of them a second, and they take
# a fifth of the processor time of a study. Jobs on this machine need no such limit.
onstart:
    if workflow.local_exec:
        workflow.scheduler.job_rate_limiter = None
