"""Estimate the crash probability by importance sampling, in independent replicates of one method."""

import pandas as pd
from accelerated_evaluation.files import write_csv
from accelerated_evaluation.jobs import job
from accelerated_evaluation.methods.importance_sampling import Stratum
from accelerated_evaluation.methods.paper import load_cut_ins, read_proposals
from accelerated_evaluation.methods.replicates import estimate_replicate
from accelerated_evaluation.randomness import child_generator
from tqdm import trange


def main(
    config: dict,
    inputs: dict[str, str],
    proposals: list[str],
    scope: str,
    method: str,
    outputs: dict[str, str],
) -> None:
    """Write an estimate for each replicate, and how it ran; replicates take the searches' seeds in turn."""
    model, problems = load_cut_ins(inputs["model"], inputs["encounters"], config["vehicle"])
    found = [read_proposals(path) for path in proposals]
    estimates, courses = [], []
    for replicate in trange(config["importance_sampling"]["replicates"], desc=f"{method}, {scope}"):
        strata = {
            segment: Stratum(problem, model.share(segment), found[replicate % len(found)][segment])
            for segment, problem in problems.items()
            if scope in ("all", segment)
        }
        generator = child_generator(config["seed"], "importance_sampling", method, scope, replicate)
        estimate, course = estimate_replicate(strata, generator, config["importance_sampling"])
        labels = {"study": config["study"], "scope": scope, "method": method, "replicate": replicate}
        estimates.append(labels | estimate)
        courses.append(course.assign(**labels)[[*labels, *course.columns]])
    write_csv(outputs["course"], pd.concat(courses, ignore_index=True))
    write_csv(outputs["estimates"], pd.DataFrame(estimates))


if __name__ == "__main__":
    with job(snakemake.log[0]):
        main(
            snakemake.config,
            {"model": snakemake.input.model, "encounters": snakemake.input.encounters},
            list(snakemake.input.proposals),
            snakemake.wildcards.scope,
            snakemake.wildcards.method,
            dict(snakemake.output.items()),
        )
