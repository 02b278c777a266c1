"""Search for the accelerated distributions of one method for every seed, stratum by stratum."""

from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.methods import METHODS
from accelerated_evaluation.methods.cross_entropy.search import write_proposals
from accelerated_evaluation.methods.problem import loaded_problem
from accelerated_evaluation.methods.study import search_strata
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.study.jobs import job
from accelerated_evaluation.vehicles.named import NamedVehicle

if __name__ == "__main__":
    with job(snakemake.log[0]):
        files, params, name = snakemake.input, snakemake.params, snakemake.wildcards.method
        named = NamedVehicle.of(params.vehicle, params.simulations, CUT_IN, workers=snakemake.threads)
        outputs = zip(params.seeds, snakemake.output.proposals, snakemake.output.trace, strict=True)
        for seed, proposals_file, trace_file in outputs:
            # Each search loads the vehicle again, because a random vehicle may have an internal state.
            with loaded_problem(files.model, files.encounters, named) as problem:
                proposals, trace = search_strata(
                    METHODS[name].configured(params.settings),
                    problem,
                    lambda stratum, seed=seed: child_generator(
                        params.seed, "cross_entropy", name, stratum, seed
                    ),
                )
            trace.insert(0, "method", name)
            trace.insert(2, "seed", seed)
            write_csv(trace_file, trace)
            write_proposals(proposals_file, proposals)
