"""Run a parameterised notebook, and publish it with its outputs."""

from pathlib import Path

from accelerated_evaluation.publishing.book.execution import run_notebook
from accelerated_evaluation.publishing.book.rendering import write_rendered
from accelerated_evaluation.study.jobs import job

if __name__ == "__main__":
    with job(snakemake.log[0]):
        run_notebook(
            snakemake.input.notebook,
            dict(snakemake.params.parameters),
            snakemake.output.executed,
        )
        write_rendered(
            *map(Path, (snakemake.input.notebook, snakemake.output.executed, snakemake.output.rendered))
        )
