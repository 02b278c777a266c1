"""Count the segments, and test that variables are independent inside them and that they are similar."""

import pandas as pd
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.records.dependence import dependence, similarity
from accelerated_evaluation.records.segments import segment_counts
from accelerated_evaluation.study.jobs import job

if __name__ == "__main__":
    with job(snakemake.log[0]):
        table = pd.read_parquet(snakemake.input.encounters)
        write_csv(snakemake.output.segments, segment_counts(table))
        write_csv(snakemake.output.dependence, dependence(table))
        write_csv(snakemake.output.similarity, similarity(table))
