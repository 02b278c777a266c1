"""Refit the model to resampled data, and set up the budget of the uncertainty."""

import pandas as pd
from accelerated_evaluation.files import write_csv
from accelerated_evaluation.jobs import job
from accelerated_evaluation.laws.lane_change_model import read_model
from accelerated_evaluation.randomness import child_generator
from accelerated_evaluation.truth.crash_map import read_crash_map
from accelerated_evaluation.truth.uncertainty_study import study_uncertainty

if __name__ == "__main__":
    with job(snakemake.log[0]):
        files, params = snakemake.input, snakemake.params
        tables = study_uncertainty(
            read_crash_map(files.half),
            {name: read_model(files[name]) for name in ("two_pieces", "three_pieces")},
            params.variant,
            pd.read_parquet(files.encounters),
            child_generator(params.seed, "bootstrap"),
            params.uncertainty,
            params.alpha,
        )
        for name, path in snakemake.output.items():
            write_csv(path, tables[name])
