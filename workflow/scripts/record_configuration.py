"""Write the resolved configuration and the list of results into the folder of the results."""

from accelerated_evaluation.base.files import write_json
from accelerated_evaluation.study.jobs import job

if __name__ == "__main__":
    with job(snakemake.log[0]):
        write_json(snakemake.output.config, snakemake.params.config)
        write_json(snakemake.output.contents, list(snakemake.params.contents))
