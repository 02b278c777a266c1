"""The benchmark of all vehicles: exact probabilities against a reference, and its table by hand."""

import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.crash_map.mapping import map_crashes
from accelerated_evaluation.vehicles import AccAeb
from builders import coarse_grid

pytestmark = pytest.mark.studies
ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "benchmarks" / "samplers"))  # before folders that have a run.py, too

import vehicles  # noqa: E402
from problems import law  # noqa: E402

GRID = coarse_grid(speeds=(5, 35, 12), ranges=(75, 24), closing=(45.0, 80), refinement=4)


def test_vehicles_are_estimated_beside_their_exact_probability():
    crash_map = map_crashes(AccAeb(), GRID, [], np.random.default_rng(1))
    nothing = {event: replace(each, line=each.line[:0], start=each.start[:0], end=each.end[:0])
               for event, each in crash_map.events.items()}  # fmt: skip
    never = replace(crash_map, events=nothing)
    runs = vehicles.estimated("kept", law(), {"acc_aeb": crash_map, "rss": never}, seeds=3)
    known = pd.read_csv(ROOT / "benchmarks/results/samplers.csv").set_index("problem")
    reference = known.loc["all_segments", "reference"].iloc[0]  # by importance sampling, of the same law
    found = runs[runs["vehicle"] == "acc_aeb"]
    assert found["exact"].iloc[0] == pytest.approx(reference, abs=4 * found["exact_se"].iloc[0])
    assert found["exact_se"].iloc[0] < 0.05 * reference
    assert found["seed"].to_list() == [0, 1, 2]
    # Three estimates with a coefficient of variation of .156: four standard errors of their mean.
    assert found["probability"].mean() == pytest.approx(reference, rel=4 * 0.156 / math.sqrt(3))
    table = vehicles.table(runs).set_index("vehicle")
    assert table.loc["acc_aeb", "seeds"] == 3
    assert table.loc["acc_aeb", "calls_mean"] == pytest.approx(found["calls"].mean())
    assert table.loc["rss", ["exact", "seeds"]].to_list() == [0, 0]  # left out, because it never crashes
    assert math.isnan(table.loc["rss", "coverage80"])


def test_table_tells_a_vehicle_without_an_estimate():
    run = {"law": "answer", "vehicle": "reg157", "exact": 0.01, "exact_se": 1e-4, "problem": "answer reg157"}
    run |= {"probability": math.nan, "ci_low": 0.0, "ci_high": 1.0, "calls": 1000}
    run |= {"ci95_low": 0.0, "ci95_high": 1.0}
    runs = pd.DataFrame([run | {"seed": seed, "converged": False} for seed in range(4)])
    (row,) = vehicles.table(runs).to_dict("records")
    assert (row["seeds"], row["failed"], row["claimed"], row["calls_mean"]) == (4, 1, 0, 1000)
    assert math.isnan(row["error"])
