"""Estimate the answer for a slow vehicle from simulations under the mean law; write tables, runs and law."""

import sys

from accelerated_evaluation.answer.chosen_law import mean_law
from accelerated_evaluation.answer.estimation import Traffic, simulate_answer
from accelerated_evaluation.answer.family_file import read_family
from accelerated_evaluation.base.files import read_json, write_csv
from accelerated_evaluation.laws.files import write_law
from accelerated_evaluation.laws.smooth.family import DistinctRecords
from accelerated_evaluation.laws.smooth.support import Support
from accelerated_evaluation.problem import Problem
from accelerated_evaluation.records.encounter_table import read_encounters
from accelerated_evaluation.study.jobs import job
from accelerated_evaluation.vehicles.external.slow import loaded_for

if __name__ == "__main__":
    with job(snakemake.log[0]) as say:
        files, params, outputs = snakemake.input, snakemake.params, dict(snakemake.output.items())
        settings = params.settings
        encounters = read_encounters(files.encounters)
        records = DistinctRecords.of(encounters, Support.of(params.support))
        draws, fastest = settings["answer"]["draws"], settings["answer"]["grid"]["closing_speed_max"]
        law = mean_law(read_family(files.family, records), encounters, draws, settings["seed"], fastest)
        traffic = Traffic(records, read_json(files.exposure))
        with loaded_for(settings["vehicle"], params.simulations | {"workers": snakemake.threads}) as vehicle:
            found = simulate_answer(settings, Problem(law, vehicle), traffic)
        if found.warning is not None:
            say(f"warning: {found.warning}")
            print(found.warning, file=sys.stderr)
        write_law(outputs.pop("law"), law, encounters)
        for name, path in outputs.items():
            write_csv(path, found.tables[name].drop(columns=["study", "replicate"], errors="ignore"))
