"""Run a parameterised notebook."""

from accelerated_evaluation.publishing.book.execution import run_notebook
from accelerated_evaluation.study.jobs import job

if __name__ == "__main__":
    with job(snakemake.log[0]):
        run_notebook(
            snakemake.input.notebook,
            dict(snakemake.params.parameters),
            snakemake.output.executed,
        )
