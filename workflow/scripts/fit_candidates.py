"""Fit the candidate families and the piecewise models to each variable in each segment."""

import pandas as pd
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.laws.files import read_law
from accelerated_evaluation.laws.paper.candidates import compare_with_candidates
from accelerated_evaluation.records.segments import read_encounters
from accelerated_evaluation.study.jobs import job

if __name__ == "__main__":
    with job(snakemake.log[0]):
        encounters = read_encounters(snakemake.input.encounters)
        models = [read_law(path, encounters) for path in snakemake.input.models]
        tables = [compare_with_candidates(encounters, models, *place) for place in snakemake.params.compared]
        write_csv(snakemake.output.candidates, pd.concat(tables, ignore_index=True))
