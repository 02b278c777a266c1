"""Check the records; write the whole report to the log, and print checks with a warning or a stop."""

import sys

from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.records.checks import inspect_records
from accelerated_evaluation.records.verdict import Verdict, report_in_words
from accelerated_evaluation.scenarios import SCENARIOS
from accelerated_evaluation.scenarios.record_table import named_records_of
from accelerated_evaluation.study.jobs import job
from accelerated_evaluation.vehicles.named import NamedVehicle

if __name__ == "__main__":
    with job(snakemake.log[0]) as say:
        params = dict(snakemake.params.items())
        settings, scenario = params["simulations"], SCENARIOS[params["scenario"]["name"]]
        named = NamedVehicle.of(params["vehicle"], settings, scenario, workers=snakemake.threads)
        with named.loaded() as vehicle:
            records = named_records_of(scenario, params)
            raw = records.read(child_generator(params["seed"], "sample"))
            report = inspect_records(records.for_checks(raw, vehicle.simulate if params["replays"] else None))
        print(report_in_words(report), file=sys.stderr)
        write_csv(snakemake.output.report, report)
        for line in Verdict.of(report).lines():
            say(line)
