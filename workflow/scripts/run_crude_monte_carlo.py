"""Estimate the crash probability by crude Monte Carlo."""

import math

from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.methods.crude import crude_course, crude_estimates, simulate_batches
from accelerated_evaluation.methods.problem import loaded_problem
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.study.jobs import job
from accelerated_evaluation.vehicles.named import NamedVehicle

if __name__ == "__main__":
    with job(snakemake.log[0]):
        params, settings = snakemake.params, snakemake.params.crude_monte_carlo
        files = snakemake.input
        named = NamedVehicle.of(params.vehicle, params.simulations, CUT_IN, workers=snakemake.threads)
        with loaded_problem(files.model, files.encounters, named) as problem:
            batches = simulate_batches(
                problem,
                seed=params.seed,
                batches=math.ceil(settings["simulations"] / settings["batch_size"]),
                batch_size=settings["batch_size"],
            )
        write_csv(snakemake.output.course, crude_course(batches, params.alpha))
        write_csv(snakemake.output.estimates, crude_estimates(batches, params.alpha))
