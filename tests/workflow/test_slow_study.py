"""Studies of slow vehicles: nothing is simulated twice, and few simulations are enough for a book."""

import pandas as pd
import pytest
import yaml
from accelerated_evaluation.answer.ways.replays import FOLLOWED, SIZES

pytestmark = pytest.mark.studies
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
    assert run("--forcerun", "map_crashes", *RESULTS) == (results, simulated)


DYING_CAR = """
import os
import signal
from pathlib import Path

from accelerated_evaluation.vehicles import load_vehicle


class Car:
    '''The study's car; its process ends after the 40th and the 80th encounter while a file asks for it.'''

    deterministic = True

    def __init__(self, log):
        self.log, self.car = Path(log), load_vehicle("acc_aeb")

    def simulate(self, lead_speed, range_, closing_speed):
        with self.log.open("a") as log:
            log.writelines(f"{v!r} {r!r} {c!r}\\n" for v, r, c in zip(lead_speed, range_, closing_speed))
        count = len(self.log.read_text().splitlines())
        for deaths, limit in enumerate((40, 80)):
            if count >= limit and self.log.with_suffix(f".{deaths}").exists():
                os.kill(os.getpid(), signal.SIGKILL)
        return self.car.simulate(lead_speed, range_, closing_speed)
"""
FEW_RUNS = {
    "vehicle": {"name": "car.py:Car", "parameters": {"log": "simulated.txt"}},
    "simulations": {"slow": True, "workers": 1, "retries": 0},
    "surrogate": {"maximum_calls": 150},
}


def test_a_study_of_a_slow_vehicle_ends_in_a_book_though_it_dies_twice(finished, tmp_path):
    """The finished study gets a slow vehicle, whose study needs no map of it and at most 150 simulations."""
    project = finished.copied(tmp_path)
    (project.folder / "car.py").write_text(DYING_CAR)
    (project.folder / "slow.yaml").write_text(yaml.safe_dump(FEW_RUNS))
    project.configs = (*project.configs, "slow.yaml")
    for deaths in range(2):  # so many runs fail that they are not set aside
        (project.folder / f"simulated.{deaths}").touch()
        died = project.run("results/smoke/laws/runs.csv")
        assert died.returncode != 0
        assert "the end of the process that simulated it" in died.stderr + died.stdout
        assert "outcomes are kept" in died.stderr + died.stdout
        (project.folder / f"simulated.{deaths}").unlink()
    done = project.run()
    assert done.returncode == 0, done.stderr[-5000:]
    assert "Mapping the crashes of" not in done.stdout + done.stderr  # the maps of the references are shared
    results = project.folder / "results/smoke"
    simulated = (project.folder / "simulated.txt").read_text().splitlines()
    runs = pd.read_csv(results / "laws/runs.csv")
    # Records are replayed, many of them were lost twice, some encounters are repeated on purpose, and a few
    # crashes are followed.
    replayed = pd.read_csv(results / "laws/replays.csv")["replayed"].max()
    assert len(runs) <= 150
    assert replayed <= sum(SIZES) + FOLLOWED
    assert len(set(simulated)) < len(runs) + replayed + 30
    assert len(simulated) < len(runs) + 3 * replayed + 60
    answer = pd.read_csv(results / "laws/answer.csv").set_index("event")
    crash, severe = answer.loc["crash"], answer.loc["impact above 5 m/s"]
    # Under some draws of the law, 150 runs know nothing: the lowest end is then 0, and printed as "below".
    assert 0 <= crash["low95"] < crash["low80"] < crash["median"] < crash["high80"] < crash["high95"] < 0.01
    # Too few of the runs are severe: a limit is stated, and no estimate. A part is never above the whole.
    assert pd.isna(severe["median"])
    assert 0 < severe["high95"] <= crash["high95"]
    crashes = pd.read_csv(results / "laws/crashes.csv")
    assert crashes["share"].sum() == pytest.approx(1)
    assert crashes["impact_speed"].notna().all()
    compared = pd.read_csv(results / "laws/compared.csv").set_index("other")
    assert set(compared.index) >= {"acc_only", "cc_human", "reg157", "rss", "fsm"}
    assert compared.loc["cc_human", "ratio_high80"] < 1
    resolved = pd.read_csv(results / "laws/vehicles.csv").set_index("vehicle")["resolved"]
    ratios = compared.loc[:, "ratio":"safer"].notna().all(axis=1)
    # no ratio where the replayed records contradict an answer
    assert (ratios == resolved[compared.index]).all()
    first_page = (results / "book/index.html").read_text()
    assert f"answers by {len(runs)} simulations" in first_page
    left_out = (results / "book/03_can_it_be_trusted.html").read_text()
    assert "What is left out for a slow vehicle" in left_out
    assert not (results / "book/09_ground_truth.html").exists()
    assert '"run_crash"' in (results / "book/explorer.html").read_text()  # its runs stand in for a map
