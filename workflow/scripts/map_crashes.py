"""Map where the vehicle crashes, at full, half and quarter resolution."""

from accelerated_evaluation.jobs import job
from accelerated_evaluation.randomness import child_generator
from accelerated_evaluation.truth.crash_map import Grid, write_crash_map
from accelerated_evaluation.truth.mapping import map_crashes
from accelerated_evaluation.truth.severity import events_from
from accelerated_evaluation.vehicles.loading import load_vehicle


def main(config: dict, outputs: dict[str, str]) -> None:
    """Write the map with all events as ``full``, and those of crashes alone as ``half`` and ``quarter``."""
    vehicle = load_vehicle(config["vehicle"]["name"], **config["vehicle"]["parameters"])
    filters = config["filters"]
    grid = Grid(
        lead_speed_min=filters["lead_speed_min"],
        lead_speed_max=filters["lead_speed_max"],
        range_max=filters["range_max"],
        closing_speed_max=config["vehicle"]["closing_speed_max"],
        **config["crash_map"]["grid"],
    )
    for name, factor in {"quarter": 0.25, "half": 0.5, "full": 1.0}.items():
        events = events_from(config["crash_map"]["events"]) if name == "full" else []
        generator = child_generator(config["seed"], "crash_map", name)
        write_crash_map(outputs[name], map_crashes(vehicle, grid.refined(factor), events, generator))


if __name__ == "__main__":
    with job(snakemake.log[0]):
        main(snakemake.config, dict(snakemake.output.items()))
