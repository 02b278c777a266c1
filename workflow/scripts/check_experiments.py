"""Check stored experiments by importance sampling; write an empty table if the scenario has none."""

from accelerated_evaluation.answer.stored_experiments import COLUMNS, authors_records, stored_experiments
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.scenarios import SCENARIOS
from accelerated_evaluation.study.jobs import job
from pandas import DataFrame

if __name__ == "__main__":
    with job(snakemake.log[0]):
        files, scenario = snakemake.input, SCENARIOS[snakemake.params.scenario]
        table = DataFrame(columns=COLUMNS)
        if files.published:
            records = authors_records(scenario, files.records[0])
            known = files.verdicts[0], files.published[0]
            table = stored_experiments(*known, scenario.name, records, scenario.names)
        write_csv(snakemake.output.experiments, table[list(COLUMNS)])
