"""Refit the model to resampled data, and set up the budget of the uncertainty."""

import pandas as pd
from accelerated_evaluation.files import write_csv
from accelerated_evaluation.jobs import job
from accelerated_evaluation.laws.lane_change_model import read_model
from accelerated_evaluation.randomness import child_generator
from accelerated_evaluation.truth.crash_map import read_crash_map
from accelerated_evaluation.truth.exact import ALL, exact_probabilities
from accelerated_evaluation.truth.sensitivity import Levels
from accelerated_evaluation.truth.uncertainty import (
    bootstrap_probabilities,
    probabilities_of_choices,
    uncertainty_budget,
)


def main(
    config: dict, encounters_path: str, crash_map_path: str, models: dict[str, str], outputs: dict[str, str]
) -> None:
    """Write the budget, and the probability of each refit."""
    settings, encounters = config["uncertainty"], pd.read_parquet(encounters_path)
    crash_map = read_crash_map(crash_map_path)
    fitted = {name: read_model(path) for name, path in models.items()}
    studied = fitted[config["models"]["inverse_range"]["variant"]]
    bootstrap = bootstrap_probabilities(
        crash_map,
        encounters,
        Levels.of(studied),
        child_generator(config["seed"], "bootstrap"),
        replicates=settings["replicates"],
        block_runs=settings["block_runs"],
    )
    variants = [Levels.of(model) for model in fitted.values()]
    choices = probabilities_of_choices(crash_map, encounters, variants, settings["inverse_ttc_knots"])
    budget = uncertainty_budget(
        exact_probabilities(crash_map, studied, encounters)[ALL].probability,
        bootstrap,
        choices,
        tuple(settings["sampling_interval"]),
        alpha=config["importance_sampling"]["alpha"],
    )
    write_csv(outputs["uncertainty"], budget)
    write_csv(
        outputs["bootstrap"], pd.DataFrame({"probability": bootstrap}).rename_axis("replicate").reset_index()
    )


if __name__ == "__main__":
    with job(snakemake.log[0]):
        main(
            snakemake.config,
            snakemake.input.encounters,
            snakemake.input.half,
            {name: snakemake.input[name] for name in ("two_pieces", "three_pieces")},
            dict(snakemake.output.items()),
        )
