"""Fit the paper's laws to the encounters: the piecewise ones, and the single parametric one."""

from accelerated_evaluation.laws.files import write_law
from accelerated_evaluation.laws.paper.models import fit_paper_laws
from accelerated_evaluation.records.segments import read_encounters
from accelerated_evaluation.study.jobs import job

if __name__ == "__main__":
    with job(snakemake.log[0]):
        params = snakemake.params
        encounters = read_encounters(snakemake.input.encounters)
        fitted = fit_paper_laws(
            encounters,
            params.models,
            params.range_max,
            params.description,
            params.closing_speed_max,
        )
        for name, path in snakemake.output.items():
            write_law(path, fitted[name], encounters)
