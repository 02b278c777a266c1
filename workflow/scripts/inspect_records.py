"""Check the records; write the whole report to the log, and print checks with a warning or a stop."""

import sys

from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.records.checks import Records, inspect_records
from accelerated_evaluation.records.report import report_in_words
from accelerated_evaluation.records.sources import read_source
from accelerated_evaluation.records.verdict import Verdict
from accelerated_evaluation.study.jobs import job
from accelerated_evaluation.vehicles.external.slow import loaded_for

if __name__ == "__main__":
    with job(snakemake.log[0]) as say:
        params = snakemake.params
        raw = read_source(params.data, child_generator(params.seed, "sample"))
        with loaded_for(params.vehicle, params.simulations | {"workers": snakemake.threads}) as vehicle:
            simulate = vehicle.simulate if params.replays else None
            report = inspect_records(Records.of(raw, dict(params.items()), simulate))
        print(report_in_words(report), file=sys.stderr)
        write_csv(snakemake.output.report, report)
        for line in Verdict.of(report).lines():
            say(line)
