"""Run a parameterised notebook."""

from accelerated_evaluation.jobs import job
from accelerated_evaluation.publishing.execution import run_notebook

if __name__ == "__main__":
    with job(snakemake.log[0]):
        run_notebook(
            snakemake.input.notebook,
            dict(snakemake.params.parameters),
            snakemake.output.executed,
        )
