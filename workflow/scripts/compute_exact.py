"""Weigh the crash maps with the models: exact probabilities, severity, and the variation of every f*."""

import pandas as pd
from accelerated_evaluation.files import write_csv
from accelerated_evaluation.jobs import job
from accelerated_evaluation.laws.lane_change_model import read_model
from accelerated_evaluation.methods.paper import read_proposals
from accelerated_evaluation.truth.crash_map import read_crash_map
from accelerated_evaluation.truth.exact_study import exact_tables

if __name__ == "__main__":
    with job(snakemake.log[0]):
        files, params = snakemake.input, snakemake.params
        labels = zip(params.methods, params.seeds, strict=True)
        tables = exact_tables(
            {name: read_crash_map(files[name]) for name in ("quarter", "half", "full")},
            {name: read_model(files[name]) for name in ("two_pieces", "three_pieces", "single")},
            params.variant,
            pd.read_parquet(files.encounters),
            {label: read_proposals(path) for label, path in zip(labels, files.proposals, strict=True)},
            params.distance,
        )
        for name, path in snakemake.output.items():
            write_csv(path, tables[name])
