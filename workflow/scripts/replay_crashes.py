"""Simulate the most probable crashes of a slow vehicle again, and write their states over time."""

import pandas as pd
from accelerated_evaluation.answer.ways.likeliest_crashes import traces_of, ways_among_runs
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.study.jobs import job
from accelerated_evaluation.vehicles import load_vehicle
from accelerated_evaluation.vehicles.named import NamedVehicle

if __name__ == "__main__":
    with job(snakemake.log[0]):
        files, params, outputs = snakemake.input, snakemake.params, snakemake.output
        answer = pd.read_csv(files.answer).set_index("event")
        generator = child_generator(params.seed, "happened")
        with NamedVehicle.of(
            params.vehicle, params.simulations, CUT_IN, workers=snakemake.threads
        ).loaded() as vehicle:
            crashes, probability = pd.read_csv(files.crashes), answer.loc["crash", "probability"]
            happened = ways_among_runs(crashes, probability, vehicle, generator)
            write_csv(outputs.encounters, happened)
        own = load_vehicle(params.vehicle["name"], **params.vehicle["parameters"])
        write_csv(outputs.traces, traces_of(happened, getattr(own, "vehicle", own)))
