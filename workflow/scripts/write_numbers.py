"""Write the named numbers of a study, which texts state."""

from pathlib import Path

from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.publishing.named_numbers import Tables, named_numbers
from accelerated_evaluation.publishing.study import Study
from accelerated_evaluation.study.jobs import job

if __name__ == "__main__":
    with job(snakemake.log[0]):
        results = Tables(Path(snakemake.input.benchmarks[0]).parent)
        study = Study(**snakemake.params.study)
        write_csv(snakemake.output[0], named_numbers(Path(snakemake.input.definitions[0]), study, results))
