"""Judge the intervals of one method by the exact probability, in many replicates."""

from functools import partial

import pandas as pd
from accelerated_evaluation.files import write_csv
from accelerated_evaluation.jobs import job
from accelerated_evaluation.methods.paper import load_cut_ins, read_proposals
from accelerated_evaluation.methods.replicate_study import strata_of_searches
from accelerated_evaluation.randomness import child_generator
from accelerated_evaluation.truth.coverage import coverage_table
from accelerated_evaluation.truth.coverage_study import coverage_replicates

if __name__ == "__main__":
    with job(snakemake.log[0]):
        files, params, method = snakemake.input, snakemake.params, snakemake.wildcards.judged
        model, problems = load_cut_ins(files.model, files.encounters, params.vehicle)
        shares = {segment: model.share(segment) for segment in problems}
        exact = pd.read_csv(files.exact).set_index("segment").loc["all"]
        replicates = coverage_replicates(
            method,
            strata_of_searches(problems, shares, list(map(read_proposals, files.get("proposals", [])))),
            exact["probability"],
            partial(child_generator, params.seed, "coverage", method),
            params.importance_sampling,
            params.coverage,
        )
        write_csv(snakemake.output.replicates, replicates)
        verdicts = coverage_table(replicates, exact["probability"], exact["standard_error"])
        write_csv(snakemake.output.coverage, verdicts)
