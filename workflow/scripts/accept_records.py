"""End a study with an error if a check of its records has the verdict "stop" that is not accepted."""

from accelerated_evaluation.base.files import write_text
from accelerated_evaluation.records.verdict import Verdict, read_report
from accelerated_evaluation.study.jobs import job

if __name__ == "__main__":
    with job(snakemake.log[0]):
        verdict = Verdict.of(read_report(snakemake.input.report), snakemake.params.accepted)
        verdict.require_accepted(snakemake.params.records)
        write_text(snakemake.output.verdict, "\n".join([*verdict.lines(), ""]))
