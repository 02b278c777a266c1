"""The guide to simulators: each closed loop is run as it stands, on fewer records."""

import re
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import cli, load_vehicle
from accelerated_evaluation.study.configuration import read_yaml
from guide_files import clone_of, files_in, text_of

FILES = files_in(text_of("your_simulator"))
LOOPS = {"highway": "highway_env", "sumo": "libsumo", "engine": "scenariogeneration"}
clone = clone_of(FILES)


def loaded(loop):
    pytest.importorskip(LOOPS[loop], reason=f"{LOOPS[loop]}, of the extra 'simulators', is not installed")
    section = read_yaml(Path(f"my_{loop}.yaml"))["vehicle"]
    sys.modules.pop("player", None)
    return load_vehicle(section["name"])


@pytest.mark.parametrize("loop", LOOPS)
def test_a_loop_begins_at_the_encounter_and_is_monotone(clone, loop):
    vehicle = loaded(loop)
    # A car that does not close in, keeps the range; the faster it closes in, the nearer it comes.
    closing = np.array([0.0, 4.0, 8.0, 12.0, 30.0])
    outcomes = vehicle.simulate(np.full(5, 20.0), np.full(5, 12.0), closing)
    assert outcomes.min_range[0] == pytest.approx(12.0, abs=0.5)
    assert (np.diff(outcomes.min_range[:-1]) < 0).all()
    assert outcomes.crash.tolist()[0] is False
    assert outcomes.crash.tolist()[-1] is True
    assert 10.0 < outcomes.impact_speed[-1] <= 30.0


def test_the_player_brakes_as_the_formula_says(clone):
    vehicle = loaded("engine")
    outcomes = vehicle.simulate([20.0, 15.0], [10.0, 4.0], [5.0, 5.0])
    assert outcomes.min_range[0] == pytest.approx(10 - 5 * 0.75 - 25 / 12, abs=0.001)
    assert outcomes.crash.tolist() == [False, True]
    assert outcomes.impact_speed[1] == pytest.approx(np.sqrt(25 - 12 * 0.25), abs=0.07)


@pytest.mark.studies
@pytest.mark.parametrize(
    "loop", ["engine", *(pytest.param(loop, marks=pytest.mark.rest) for loop in ("highway", "sumo"))]
)
def test_a_loop_gives_a_crash_probability(clone, loop, capsys):
    """Under one law, because the fits of all laws take longer than the simulations."""
    loaded(loop)
    configs = ["--config", f"my_{loop}.yaml", "--config", "fewer.yaml"]
    assert cli.main(["estimate", *configs, "--law", "hazard"]) == 0
    answer = pd.read_csv(f"results/my_{loop}/estimate/answer.csv").iloc[0]
    assert 0 <= answer.low80 < answer["median"] < answer.high80 < 1
    assert re.search("1 in [0-9,]+ cut-ins", capsys.readouterr().out)
