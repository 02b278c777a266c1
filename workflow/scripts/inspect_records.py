"""Check the records before any result, and tell the verdicts in the log."""

import sys

from accelerated_evaluation.encounters.checks import Records, inspect_records
from accelerated_evaluation.encounters.sources import read_source
from accelerated_evaluation.encounters.told import told
from accelerated_evaluation.files import write_csv
from accelerated_evaluation.jobs import job
from accelerated_evaluation.randomness import child_generator
from accelerated_evaluation.vehicles.slow import loaded_for

if __name__ == "__main__":
    with job(snakemake.log[0]):
        params = snakemake.params
        raw = read_source(params.data, child_generator(params.seed, "sample"))
        with loaded_for(params.vehicle, params.simulations | {"workers": snakemake.threads}) as vehicle:
            report = inspect_records(Records.of(raw, dict(params.items()), vehicle.simulate))
        print(told(report), file=sys.stderr)
        write_csv(snakemake.output.report, report)
