"""Fit the candidate families to one variable in one segment, and the piecewise models beside them."""

import pandas as pd
from accelerated_evaluation.files import write_csv
from accelerated_evaluation.jobs import job
from accelerated_evaluation.laws.comparison import compare_with_candidates
from accelerated_evaluation.laws.lane_change_model import read_model

if __name__ == "__main__":
    with job(snakemake.log[0]):
        encounters = pd.read_parquet(snakemake.input.encounters)
        models = map(read_model, snakemake.input.models)
        variable, segment = snakemake.wildcards.variable, snakemake.wildcards.segment
        write_csv(snakemake.output.table, compare_with_candidates(encounters, models, variable, segment))
