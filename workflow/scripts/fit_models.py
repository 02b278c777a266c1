"""Fit the piecewise models and the single parametric one to the encounters."""

import pandas as pd
from accelerated_evaluation.encounters.sources import describe
from accelerated_evaluation.jobs import job
from accelerated_evaluation.laws.lane_change_model import write_model
from accelerated_evaluation.laws.paper import fit_lane_change_models


def main(config: dict, encounters_path: str, outputs: dict[str, str]) -> None:
    """Write one model file for each name in ``outputs``."""
    encounters = pd.read_parquet(encounters_path)
    fitted = fit_lane_change_models(
        encounters, config["models"], config["filters"]["range_max"], describe(config["data"])
    )
    for name, path in outputs.items():
        write_model(path, fitted[name])


if __name__ == "__main__":
    with job(snakemake.log[0]):
        main(snakemake.config, snakemake.input.encounters, dict(snakemake.output.items()))
