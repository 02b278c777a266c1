"""Compute the crash map of a vehicle at full, half and quarter resolution, or at some of these."""

from collections.abc import Mapping
from typing import Any

from accelerated_evaluation.base.files import write_json
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.crash_map.checked import require_right_map
from accelerated_evaluation.crash_map.mapping import map_crashes
from accelerated_evaluation.crash_map.maps import Grid, write_crash_map
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.study.jobs import job
from accelerated_evaluation.vehicles.named import NamedVehicle
from accelerated_evaluation.vehicles.protocol import CRASH, Vehicle, events_of

FACTORS = {"full": 1.0, "half": 0.5, "quarter": 0.25}  # the full map is checked first


def main(problem: Mapping[str, Any], vehicle: Vehicle, outputs: Mapping[str, str], *, checked: bool) -> None:
    """Write the map with all events as ``full``, and those of crashes alone; see `crash_map.checked`."""
    grid = Grid(**problem["limits"], **problem["crash_map"]["grid"])
    is_sampled = False
    for name in (name for name in FACTORS if name in outputs):
        events = [CRASH, *events_of(CUT_IN, problem["crash_map"]["events"])] if name == "full" else []
        generator = child_generator(problem["seed"], "crash_map", name)
        crash_map = map_crashes(vehicle, grid.refined(FACTORS[name]), events, generator)
        if checked and (name == "full" or is_sampled):
            probes = child_generator(problem["seed"], "crash_map", name, "check")
            scanned, crash_map = crash_map, require_right_map(vehicle, crash_map, probes)
            is_sampled = crash_map is not scanned
        write_crash_map(outputs[name], crash_map)
    write_json(outputs["vehicle"], problem)


if __name__ == "__main__":
    with job(snakemake.log[0]):
        params = snakemake.params
        with NamedVehicle.of(
            params.vehicle, params.simulations, CUT_IN, workers=snakemake.threads
        ).loaded() as vehicle:
            main(params.mapped, vehicle, dict(snakemake.output.items()), checked=params.checked)
