"""Search the accelerated distributions of one method, stratum by stratum, from one seed."""

from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.methods import METHODS
from accelerated_evaluation.methods.cross_entropy.proposals import write_proposals
from accelerated_evaluation.methods.study import search_strata
from accelerated_evaluation.problem import loaded_problem
from accelerated_evaluation.study.jobs import job

if __name__ == "__main__":
    with job(snakemake.log[0]):
        files, params, labels = snakemake.input, snakemake.params, snakemake.wildcards
        simulations = params.simulations | {"workers": snakemake.threads}
        with loaded_problem(files.model, files.encounters, params.vehicle, simulations) as problem:
            proposals, trace = search_strata(
                METHODS[labels.method].configured(params.settings),
                problem,
                lambda stratum: child_generator(
                    params.seed, "cross_entropy", labels.method, stratum, int(labels.seed)
                ),
            )
        trace.insert(0, "method", labels.method)
        trace.insert(2, "seed", int(labels.seed))
        write_csv(snakemake.output.trace, trace)
        write_proposals(snakemake.output.proposals, proposals)
