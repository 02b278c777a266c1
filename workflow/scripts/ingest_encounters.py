"""Read the records of the study, filter and segment lane changes, and account for every row."""

from accelerated_evaluation.base.files import write_csv, write_json
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.scenarios import SCENARIOS
from accelerated_evaluation.scenarios.record_table import named_records_of
from accelerated_evaluation.study.jobs import job

if __name__ == "__main__":
    with job(snakemake.log.messages):
        config, outputs = dict(snakemake.params.items()), snakemake.output
        records = named_records_of(SCENARIOS[config["scenario"]["name"]], config)
        raw = records.read(child_generator(config["seed"], "sample"))
        # Also to the log, because Snakemake removes the outputs of a job in which no table can be made.
        accounts = outputs.account, snakemake.log.account
        encounters = records.encounters(raw, lambda account: [write_csv(path, account) for path in accounts])
        write_json(outputs.exposure, records.exposure(raw))
        records.write(outputs.encounters, encounters)
