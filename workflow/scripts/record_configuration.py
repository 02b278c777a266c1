"""Write the resolved configuration into the folder of the results."""

from accelerated_evaluation.base.files import write_json
from accelerated_evaluation.study.jobs import job

if __name__ == "__main__":
    with job(snakemake.log[0]):
        write_json(snakemake.output.config, snakemake.params.config)
