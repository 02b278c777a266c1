"""Tabulate the crash probability with one choice of the study changed at a time."""

import pandas as pd
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.crash_map.maps import read_crash_map
from accelerated_evaluation.crash_map.sensitivity import study_cap, study_sensitivity
from accelerated_evaluation.laws.files import read_law
from accelerated_evaluation.laws.paper.models import PAPER_LAWS
from accelerated_evaluation.records.segments import read_encounters
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.study.jobs import job
from accelerated_evaluation.vehicles.named import NamedVehicle

if __name__ == "__main__":
    with job(snakemake.log[0]):
        files, params = snakemake.input, snakemake.params
        encounters = read_encounters(files.encounters)
        models = {name: read_law(files[name], encounters) for name in PAPER_LAWS}
        full, half = read_crash_map(files.full), read_crash_map(files.half)
        choices = study_sensitivity(full, models, params.variant, encounters, params.sensitivity)
        # Each cap on the closing speeds needs a crash map of its own, which is computed at half resolution.
        with NamedVehicle.of(
            params.vehicle, params.simulations, CUT_IN, workers=snakemake.threads
        ).loaded() as vehicle:
            caps = study_cap(
                vehicle,
                half,
                models[params.variant],
                params.sensitivity["closing_speed_max"],
                child_generator(params.seed, "sensitivity", "cap"),
            )
        write_csv(snakemake.output.sensitivity, pd.concat([choices, caps], ignore_index=True))
