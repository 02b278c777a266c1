"""Fit the piecewise models and the single parametric one to the encounters."""

import pandas as pd
from accelerated_evaluation.jobs import job
from accelerated_evaluation.laws.lane_change_model import write_model
from accelerated_evaluation.laws.paper import fit_lane_change_models

if __name__ == "__main__":
    with job(snakemake.log[0]):
        encounters, params = pd.read_parquet(snakemake.input.encounters), snakemake.params
        fitted = fit_lane_change_models(encounters, params.models, params.range_max, params.description)
        for name, path in snakemake.output.items():
            write_model(path, fitted[name])
