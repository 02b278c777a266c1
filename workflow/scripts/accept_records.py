"""End a study with an error if a check of its records has the verdict "stop" that is not accepted."""

import pandas as pd
from accelerated_evaluation.base.files import write_text
from accelerated_evaluation.records.verdict import Verdict
from accelerated_evaluation.study.jobs import job

if __name__ == "__main__":
    with job(snakemake.log[0]):
        report = pd.read_csv(snakemake.input.report, keep_default_na=False)
        verdict = Verdict.of(report, snakemake.params.accepted)
        verdict.require_accepted(snakemake.params.records)
        write_text(snakemake.output.verdict, "\n".join([*verdict.lines(), ""]))
