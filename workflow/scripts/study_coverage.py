"""Judge the intervals of one method by the exact probability, in many replicates."""

from functools import partial

import pandas as pd
from accelerated_evaluation.files import write_csv
from accelerated_evaluation.jobs import job
from accelerated_evaluation.methods.importance_sampling import Stratum
from accelerated_evaluation.methods.paper import load_cut_ins, read_proposals
from accelerated_evaluation.randomness import child_generator
from accelerated_evaluation.truth.coverage import (
    CRUDE,
    Stream,
    coverage_table,
    foretold_size,
    replicate_rows,
    stop_crude,
    stop_importance_sampling,
)
from tqdm import trange


def read_searches(config: dict, inputs: dict[str, str], proposals: list[str]) -> list[dict[str, Stratum]]:
    """Set up the segments with the f* of each search."""
    model, problems = load_cut_ins(inputs["model"], inputs["encounters"], config["vehicle"])
    return [
        {segment: Stratum(problem, model.share(segment), f[segment]) for segment, problem in problems.items()}
        for f in map(read_proposals, proposals)
    ]


def main(
    config: dict, inputs: dict[str, str], proposals: list[str], method: str, outputs: dict[str, str]
) -> None:
    """Write all replicates and the verdict on each way to stop; replicates take the searches in turn."""
    settings = config["importance_sampling"]
    exact = pd.read_csv(inputs["exact"]).set_index("segment").loc["all"]
    generator_of = partial(child_generator, config["seed"], "coverage", method)
    if method == CRUDE:
        stops, bound = [partial(stop_crude, exact["probability"], generator_of(), settings)], 1.0
    else:
        searches = read_searches(config, inputs, proposals)
        size = foretold_size(searches, generator_of("pilot"), config["coverage"]["pilot"], settings)
        streams = [Stream(strata, generator_of(number)) for number, strata in enumerate(searches)]
        stops = [partial(stop_importance_sampling, stream, size, settings) for stream in streams]
        bound = None
    rows = []
    for replicate in trange(config["coverage"]["replicates"], desc=f"coverage, {method}"):
        stopped = stops[replicate % len(stops)]()
        rows += [{"method": method, "replicate": replicate, **row} for row in replicate_rows(stopped, bound)]
    replicates = pd.DataFrame(rows)
    write_csv(outputs["replicates"], replicates)
    write_csv(outputs["coverage"], coverage_table(replicates, exact["probability"], exact["standard_error"]))


if __name__ == "__main__":
    with job(snakemake.log[0]):
        main(
            snakemake.config,
            {name: snakemake.input[name] for name in ("encounters", "model", "exact")},
            list(snakemake.input.get("proposals", [])),
            snakemake.params.method,
            dict(snakemake.output.items()),
        )
