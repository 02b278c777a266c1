"""Search the accelerated distributions of one method, segment by segment, from one seed."""

import pandas as pd
from accelerated_evaluation.files import write_csv
from accelerated_evaluation.jobs import job
from accelerated_evaluation.methods.paper import load_cut_ins, search_by_method, write_proposals
from accelerated_evaluation.randomness import child_generator
from tqdm import tqdm

if __name__ == "__main__":
    with job(snakemake.log[0]):
        params, method = snakemake.params, snakemake.wildcards.method
        seed = int(snakemake.wildcards.seed)
        _, problems = load_cut_ins(snakemake.input.model, snakemake.input.encounters, params.vehicle)
        proposals, traces = {}, []
        for segment, problem in problems.items():
            generator = child_generator(params.seed, "cross_entropy", method, segment, seed)
            with tqdm(desc=f"{method} {segment} m/s, seed {seed}", unit=" iterations") as progress:
                found = search_by_method(
                    method, problem, params.cross_entropy, generator, lambda _, bar=progress: bar.update()
                )
            proposals[segment] = found.proposal
            labels, trace = {"method": method, "segment": segment, "seed": seed}, pd.DataFrame(found.trace)
            traces.append(trace.assign(**labels)[[*labels, *trace.columns]])
        write_csv(snakemake.output.trace, pd.concat(traces, ignore_index=True))
        write_proposals(snakemake.output.proposals, proposals)
