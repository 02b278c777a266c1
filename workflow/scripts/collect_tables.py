"""Concatenate tables: each output contains the rows of the inputs with the same name, in the given order."""

import pandas as pd
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.study.jobs import job

if __name__ == "__main__":
    with job(snakemake.log[0]):
        for name, path in snakemake.output.items():
            tables = [pd.read_csv(table, dtype=str, keep_default_na=False) for table in snakemake.input[name]]
            write_csv(path, pd.concat(tables, ignore_index=True))
