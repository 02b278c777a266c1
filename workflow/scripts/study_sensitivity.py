"""Change one choice at a time, and tabulate the crash probability."""

import pandas as pd
from accelerated_evaluation.files import write_csv
from accelerated_evaluation.jobs import job
from accelerated_evaluation.laws.lane_change_model import read_model
from accelerated_evaluation.randomness import child_generator
from accelerated_evaluation.truth.crash_map import read_crash_map
from accelerated_evaluation.truth.sensitivity import study_cap, study_sensitivity
from accelerated_evaluation.vehicles.loading import load_vehicle


def main(
    config: dict, encounters_path: str, maps: dict[str, str], models: dict[str, str], sensitivity: str
) -> None:
    """Write the table; caps are studied with maps like the one at half resolution."""
    encounters = pd.read_parquet(encounters_path)
    fitted = {name: read_model(path) for name, path in models.items()}
    variant = config["models"]["inverse_range"]["variant"]
    outliers = {"outlier_rows": config["data"][config["data"]["source"]]["outlier_rows"]}
    choices = study_sensitivity(
        read_crash_map(maps["full"]), fitted, variant, encounters, config["sensitivity"] | outliers
    )
    caps = study_cap(
        load_vehicle(config["vehicle"]["name"], **config["vehicle"]["parameters"]),
        read_crash_map(maps["half"]),
        fitted[variant],
        encounters,
        config["sensitivity"]["closing_speed_max"],
        child_generator(config["seed"], "sensitivity", "cap"),
    )
    write_csv(sensitivity, pd.concat([choices, caps], ignore_index=True))


if __name__ == "__main__":
    with job(snakemake.log[0]):
        main(
            snakemake.config,
            snakemake.input.encounters,
            {name: snakemake.input[name] for name in ("half", "full")},
            {name: snakemake.input[name] for name in ("two_pieces", "three_pieces", "single")},
            snakemake.output.sensitivity,
        )
