"""Judge the criteria of the configuration by the answer of the vehicle under test."""

import pandas as pd
from accelerated_evaluation.answer.candidates.fitted_records import stored_records
from accelerated_evaluation.answer.consequences.criterion import criteria_of
from accelerated_evaluation.answer.study_tables import study_criteria
from accelerated_evaluation.base.files import read_json, write_csv
from accelerated_evaluation.scenarios import SCENARIOS
from accelerated_evaluation.study.jobs import job

if __name__ == "__main__":
    with job(snakemake.log[0]):
        files, params = snakemake.input, snakemake.params
        scenario = SCENARIOS[params.scenario]
        records = stored_records(scenario, files.encounters, params.support, read_json(files.exposure))
        made = {name: pd.read_csv(path) for name, path in files.items() if name in params.made}
        tables = study_criteria(criteria_of(params.criteria, scenario), scenario, records, made)
        for name, path in snakemake.output.items():
            write_csv(path, tables[name])
