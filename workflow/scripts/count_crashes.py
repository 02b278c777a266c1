"""Compare the predicted crash rates of the vehicles with counted ones."""

import pandas as pd
from accelerated_evaluation.answer.consequences.counted_crashes import compare_with_counts, read_events
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.study.jobs import job

if __name__ == "__main__":
    with job(snakemake.log[0]):
        files = snakemake.input
        tables = (pd.read_csv(path) for path in (files.vehicles, files.exposure))
        counted = compare_with_counts(*tables, read_events(files.events), pd.read_csv(files.published))
        write_csv(snakemake.output.counted, counted)
