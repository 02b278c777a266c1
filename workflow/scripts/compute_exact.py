"""Weigh the crash maps with the models: exact probabilities, severity, and the variation of every f*."""

import pandas as pd
from accelerated_evaluation.files import write_csv
from accelerated_evaluation.jobs import job
from accelerated_evaluation.laws.lane_change_model import read_model
from accelerated_evaluation.methods.paper import read_proposals
from accelerated_evaluation.truth.crash_map import read_crash_map
from accelerated_evaluation.truth.exact import exact_table
from accelerated_evaluation.truth.exact_variance import variation_table
from accelerated_evaluation.truth.severity import impact_speed_table, severity_table


def main(
    config: dict,
    encounters_path: str,
    maps: dict[str, str],
    models: dict[str, str],
    proposals: dict,
    outputs: dict,
) -> None:
    """Write a table for each output; ``proposals`` are files of f* by (method, seed)."""
    encounters = pd.read_parquet(encounters_path)
    crash_maps = {name: read_crash_map(path) for name, path in maps.items()}
    fitted = {name: read_model(path) for name, path in models.items()}
    studied = fitted[config["models"]["inverse_range"]["variant"]]
    table = exact_table(crash_maps, fitted, encounters)
    chosen = (table["model"] == config["models"]["inverse_range"]["variant"]) & (
        table["resolution"] == "full"
    )
    write_csv(outputs["exact"], table.loc[chosen, ["segment", "probability", "standard_error"]])
    write_csv(outputs["convergence"], table)
    severity = severity_table(
        crash_maps["full"], studied, encounters, distance=config["exposure"]["distance"]
    )
    write_csv(outputs["severity"], severity)
    write_csv(outputs["impact_speed"], impact_speed_table(severity))
    found = {label: read_proposals(path) for label, path in proposals.items()}
    write_csv(outputs["variation"], variation_table(crash_maps["full"], studied, found, encounters))


if __name__ == "__main__":
    with job(snakemake.log[0]):
        labels = zip(snakemake.params.methods, snakemake.params.seeds, strict=True)
        main(
            snakemake.config,
            snakemake.input.encounters,
            {name: snakemake.input[name] for name in ("quarter", "half", "full")},
            {name: snakemake.input[name] for name in ("two_pieces", "three_pieces", "single")},
            dict(zip(labels, snakemake.input.proposals, strict=True)),
            dict(snakemake.output.items()),
        )
