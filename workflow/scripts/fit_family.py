"""Fit the family of laws with dependence to the records, and score each law on held-out records."""

from accelerated_evaluation.answer.candidates.family_file import write_family
from accelerated_evaluation.answer.candidates.smooth_family import SmoothFamily
from accelerated_evaluation.laws.smooth.family import DistinctRecords
from accelerated_evaluation.laws.smooth.support import Support
from accelerated_evaluation.records.segments import read_encounters
from accelerated_evaluation.study.jobs import job

if __name__ == "__main__":
    with job(snakemake.log[0]):
        encounters = read_encounters(snakemake.input.encounters)
        records = DistinctRecords.of(encounters, Support.of(snakemake.params.support))
        write_family(snakemake.output.family, SmoothFamily.of(records, calibrated=True))
