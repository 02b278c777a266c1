"""Estimate the crash probability by crude Monte Carlo, resuming where an interrupted run left off."""

import math

from accelerated_evaluation.files import write_csv
from accelerated_evaluation.jobs import job
from accelerated_evaluation.methods.crude import (
    Checkpoint,
    crude_course,
    crude_estimates,
    fingerprint,
    simulate_batches,
)
from accelerated_evaluation.methods.paper import load_cut_ins


def main(
    config: dict, inputs: dict[str, str], all_inputs: list[str], checkpoint: str, outputs: dict[str, str]
) -> None:
    """Write the estimates and their course; the checkpoint is of use for the very same inputs alone."""
    settings, vehicle = config["crude_monte_carlo"], config["vehicle"]
    model, problems = load_cut_ins(inputs["model"], inputs["encounters"], vehicle)
    depends_on = {"seed": config["seed"], "vehicle": vehicle, "batch_size": settings["batch_size"]}
    batches = simulate_batches(
        problems,
        model,
        Checkpoint(checkpoint, fingerprint(all_inputs, depends_on)),
        seed=config["seed"],
        batches=math.ceil(settings["simulations"] / settings["batch_size"]),
        batch_size=settings["batch_size"],
        save_every=settings["save_every"],
    )
    alpha = config["importance_sampling"]["alpha"]
    write_csv(outputs["course"], crude_course(batches, alpha))
    write_csv(outputs["estimates"], crude_estimates(batches, alpha))


if __name__ == "__main__":
    with job(snakemake.log[0]):
        main(
            snakemake.config,
            {name: snakemake.input[name] for name in ("encounters", "model")},
            list(snakemake.input),
            snakemake.params.checkpoint,
            dict(snakemake.output.items()),
        )
