"""Refit the model to bootstrap samples of the data, and compute the budget of the uncertainty."""

from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.crash_map.maps import read_crash_map
from accelerated_evaluation.crash_map.uncertainty import study_uncertainty
from accelerated_evaluation.laws.files import read_law
from accelerated_evaluation.laws.paper.models import PIECEWISE
from accelerated_evaluation.records.segments import read_encounters
from accelerated_evaluation.study.jobs import job

if __name__ == "__main__":
    with job(snakemake.log[0]):
        files, params = snakemake.input, snakemake.params
        encounters = read_encounters(files.encounters)
        tables = study_uncertainty(
            read_crash_map(files.half),
            {name: read_law(files[name], encounters) for name in PIECEWISE},
            params.variant,
            encounters,
            child_generator(params.seed, "bootstrap"),
            params.replicates,
            params.alpha,
        )
        for name, path in snakemake.output.items():
            write_csv(path, tables[name])
