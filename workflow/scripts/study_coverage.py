"""Compute the coverage of one method's intervals in many replicates, by the exact probability."""

from functools import partial

import pandas as pd
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.methods import Stopping
from accelerated_evaluation.methods.coverage import coverage_of_replicates, coverage_replicates
from accelerated_evaluation.methods.cross_entropy.search import read_proposals
from accelerated_evaluation.methods.problem import loaded_problem
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.study.jobs import job
from accelerated_evaluation.vehicles.named import NamedVehicle

if __name__ == "__main__":
    with job(snakemake.log[0]):
        files, params, method = snakemake.input, snakemake.params, snakemake.wildcards.judged
        exact = pd.read_csv(files.exact).set_index("segment").loc["all"]
        named = NamedVehicle.of(params.vehicle, params.simulations, CUT_IN, workers=snakemake.threads)
        with loaded_problem(files.model, files.encounters, named) as problem:
            replicates = coverage_replicates(
                method,
                problem,
                [read_proposals(path).factors for path in files.get("proposals", [])],
                exact["probability"],
                partial(child_generator, params.seed, "coverage", method),
                Stopping(**params.stopping),
                params.coverage,
            )
        write_csv(snakemake.output.replicates, replicates)
        verdicts = coverage_of_replicates(replicates, exact["probability"], exact["standard_error"])
        write_csv(snakemake.output.coverage, verdicts)
