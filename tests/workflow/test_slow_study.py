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
GRID = {"lead_speed_cells": 4, "range_cells": 4, "refinement": 2, "closing_speed_points": 20}
SETTINGS = {
    "data": {"sample": 600, "spmd": {"outlier_rows": []}},
    "vehicle": {"name": "car.py:Car", "parameters": {"log": "simulated.txt"}},
    "simulations": {"keep_class": True, "batch_size": 5000, "workers": 2},
    "crash_map": {"grid": GRID},
    "crude_monte_carlo": {"simulations": 2000, "batch_size": 1000},
}
# Results of rules that simulate; for the last, maps are made too.
RESULTS = [
    "results/smoke/records_report.csv",
    "results/smoke/crude.csv",
    "results/smoke/sensitivity.csv",
]


def test_a_study_that_is_run_again_simulates_nothing_again(project):
    (project.folder / "car.py").write_text(CAR)
    config = yaml.safe_load((project.folder / "config/smoke.yaml").read_text()) | SETTINGS
    (project.folder / "slow.yaml").write_text(yaml.safe_dump(config))
    log = project.folder / "simulated.txt"

    def run(*options):
        done = project.run(*RESULTS, *options, config="slow.yaml", quick=True)
        assert done.returncode == 0, done.stderr[-5000:]
        return [(project.folder / path).read_bytes() for path in RESULTS], log.read_text()

    results, simulated = run()
    (store,) = (project.folder / "results/vehicles").glob("*/outcomes.sqlite")
    assert store.stat().st_size > 100_000
    Path(project.folder / "results/smoke/crude_checkpoint.json").unlink()
    assert run("--forceall") == (results, simulated)
