"""Retrieve the published lane changes and verify their checksum."""

from accelerated_evaluation.encounters.spmd import retrieve
from accelerated_evaluation.jobs import job

if __name__ == "__main__":
    with job(snakemake.log[0]):
        retrieve(snakemake.params.url, snakemake.params.sha256, snakemake.output.records)
