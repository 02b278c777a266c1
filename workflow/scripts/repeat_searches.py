"""Search f* of the first segment with more seeds and more updates, and judge it by its exact variance."""

from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.crash_map.maps import read_crash_map
from accelerated_evaluation.methods import METHODS, Stopping
from accelerated_evaluation.methods.cross_entropy.repeated import repeated_searches
from accelerated_evaluation.methods.problem import loaded_problem
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.study.jobs import job
from accelerated_evaluation.vehicles.named import NamedVehicle

if __name__ == "__main__":
    with job(snakemake.log[0]):
        files, params = snakemake.input, snakemake.params
        named = NamedVehicle.of(params.vehicle, params.simulations, CUT_IN, workers=snakemake.threads)
        with loaded_problem(files.model, files.encounters, named) as problem:
            table = repeated_searches(
                [METHODS[name].configured(params.settings) for name in params.methods],
                Stopping(**params.stopping),
                problem,
                params.segment,
                read_crash_map(files.quarter),
                lambda method, seed: child_generator(params.seed, "repeated_searches", method, seed),
            )
        write_csv(snakemake.output.repeated, table)
