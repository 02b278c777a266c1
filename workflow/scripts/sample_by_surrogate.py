"""Estimate the crash probability by surrogate-guided sampling, in independent replicates."""

from functools import partial

from accelerated_evaluation.files import write_csv
from accelerated_evaluation.jobs import job
from accelerated_evaluation.methods.paper import load_cut_ins
from accelerated_evaluation.methods.surrogate.study import study_surrogate
from accelerated_evaluation.randomness import child_generator

if __name__ == "__main__":
    with job(snakemake.log[0]):
        files, params = snakemake.input, snakemake.params
        model, problems = load_cut_ins(files.model, files.encounters, params.vehicle)
        tables = study_surrogate(
            problems,
            {segment: model.share(segment) for segment in problems},
            params.lead_speed_edges,
            partial(child_generator, params.seed, "surrogate"),
            params.criterion,
            params.surrogate,
        )
        for name, path in snakemake.output.items():
            tables[name].insert(0, "study", params.study)
            write_csv(path, tables[name])
