"""Search the accelerated distributions of one method, segment by segment, from one seed."""

import pandas as pd
from accelerated_evaluation.files import write_csv
from accelerated_evaluation.jobs import job
from accelerated_evaluation.methods.paper import load_cut_ins, search_by_method, write_proposals
from accelerated_evaluation.randomness import child_generator
from tqdm import tqdm


def main(config: dict, encounters: str, model: str, method: str, seed: int, outputs: dict[str, str]) -> None:
    """Write f* of each segment and the trace of all iterations."""
    _, problems = load_cut_ins(model, encounters, config["vehicle"])
    proposals, traces = {}, []
    for segment, problem in problems.items():
        generator = child_generator(config["seed"], "cross_entropy", method, segment, seed)
        with tqdm(desc=f"{method} {segment} m/s, seed {seed}", unit=" iterations") as progress:
            found = search_by_method(
                method, problem, config["cross_entropy"], generator, lambda _, bar=progress: bar.update()
            )
        proposals[segment] = found.proposal
        trace = pd.DataFrame(found.trace)
        for place, (name, value) in enumerate({"method": method, "segment": segment, "seed": seed}.items()):
            trace.insert(place, name, value)
        traces.append(trace)
    write_csv(outputs["trace"], pd.concat(traces, ignore_index=True))
    write_proposals(outputs["proposals"], proposals)


if __name__ == "__main__":
    with job(snakemake.log[0]):
        main(
            snakemake.config,
            snakemake.input.encounters,
            snakemake.input.model,
            snakemake.wildcards.method,
            int(snakemake.wildcards.seed),
            dict(snakemake.output.items()),
        )
