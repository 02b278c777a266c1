"""Estimate the crash probability by importance sampling, in independent replicates of one method."""

from functools import partial

from accelerated_evaluation.files import write_csv
from accelerated_evaluation.jobs import job
from accelerated_evaluation.methods.paper import load_cut_ins, read_proposals
from accelerated_evaluation.methods.replicate_study import strata_of_searches, study_replicates
from accelerated_evaluation.randomness import child_generator

if __name__ == "__main__":
    with job(snakemake.log[0]):
        files, params = snakemake.input, snakemake.params
        method, scope = snakemake.wildcards.method, snakemake.wildcards.scope
        model, problems = load_cut_ins(files.model, files.encounters, params.vehicle)
        shares = {segment: model.share(segment) for segment in problems}
        tables = study_replicates(
            strata_of_searches(problems, shares, list(map(read_proposals, files.proposals)), scope),
            {"study": params.study, "scope": scope, "method": method},
            partial(child_generator, params.seed, "importance_sampling", method, scope),
            params.importance_sampling,
        )
        for name, path in snakemake.output.items():
            write_csv(path, tables[name])
