"""Estimate the crash probability by one method, in independent replicates."""

from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.methods import METHODS, Stopping
from accelerated_evaluation.methods.cross_entropy.search import read_proposals
from accelerated_evaluation.methods.problem import loaded_problem
from accelerated_evaluation.methods.study import in_scope, study_method
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.study.jobs import job
from accelerated_evaluation.vehicles.named import NamedVehicle

if __name__ == "__main__":
    with job(snakemake.log[0]):
        files, params, scope = snakemake.input, snakemake.params, snakemake.wildcards.scope
        method = METHODS[params.method].configured(params.settings)
        named = NamedVehicle.of(params.vehicle, params.simulations, CUT_IN, workers=snakemake.threads)
        with loaded_problem(files.model, files.encounters, named) as whole:
            proposals = [read_proposals(path) for path in files.get("proposals", [])]
            problem, proposals = in_scope(whole, proposals, scope)
            tables = study_method(
                method,
                problem,
                Stopping(**params.stopping),
                [
                    child_generator(params.seed, *method.stream(scope, replicate))
                    for replicate in range(params.replicates)
                ],
                {"study": params.study, "scope": scope, "method": method.name},
                proposals,
            )
        for name, path in snakemake.output.items():
            write_csv(path, tables[name])
