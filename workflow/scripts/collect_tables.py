"""Join tables of one kind into one, in the order given: each output from the inputs of the same name."""

import pandas as pd
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.study.jobs import job

if __name__ == "__main__":
    with job(snakemake.log[0]):
        for name, path in snakemake.output.items():
            tables = [pd.read_csv(table, dtype=str, keep_default_na=False) for table in snakemake.input[name]]
            write_csv(path, pd.concat(tables, ignore_index=True))
