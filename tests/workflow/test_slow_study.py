"""A study of a slow vehicle: maps, replays of records and crude Monte Carlo share one store over two runs."""

from pathlib import Path

import yaml

CAR = """
from accelerated_evaluation.vehicles import load_vehicle


class Car:
    '''The study's car, which notes how many encounters it simulates.'''

    def __init__(self, log):
        self.log, self.car = log, load_vehicle("acc_aeb")

    def simulate(self, lead_speed, range_, closing_speed):
        with open(self.log, "a") as log:
            log.write(f"{len(range_)}\\n")
        return self.car.simulate(lead_speed, range_, closing_speed)
"""
SETTINGS = {
    "vehicle": {"name": "car.py:Car", "parameters": {"log": "simulated.txt"}},
    "simulations": {"keep_class": True, "batch_size": 5000, "workers": 2},
    "crash_map": {
        "grid": {"lead_speed_cells": 4, "range_cells": 4, "refinement": 2, "closing_speed_points": 20}
    },
    "crude_monte_carlo": {"simulations": 2000, "batch_size": 1000},
}
# Results of the rules that simulate; for the last, maps are made too.
RESULTS = {
    "inspect_records": "results/smoke/records_report.csv",
    "run_crude_monte_carlo": "results/smoke/crude.csv",
    "study_sensitivity": "results/smoke/sensitivity.csv",
}


def test_a_study_that_is_run_again_simulates_nothing_again(finished, tmp_path):
    """The finished study gets a slow vehicle, so that only what simulates it runs."""
    project = finished.copied(tmp_path)
    (project.folder / "car.py").write_text(CAR)
    (project.folder / "slow.yaml").write_text(yaml.safe_dump(SETTINGS))
    project.configs = (*project.configs, "slow.yaml")
    log = project.folder / "simulated.txt"

    def run(*options):
        done = project.run(*RESULTS.values(), *options)
        assert done.returncode == 0, done.stderr[-5000:]
        return [(project.folder / path).read_bytes() for path in RESULTS.values()], log.read_text()

    results, simulated = run()
    (store,) = (project.folder / "results/vehicles").glob("*/outcomes.sqlite")
    assert store.stat().st_size > 100_000
    Path(project.folder / "results/smoke/crude_checkpoint.json").unlink()
    assert run("--forcerun", "map_crashes", *RESULTS) == (results, simulated)
