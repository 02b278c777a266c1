"""The guide docs/your_scenario.md: its two files run as they stand, and give the outcomes that it states."""

import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from accelerated_evaluation import SCENARIOS, load_vehicle
from accelerated_evaluation.vehicles.protocol import event_named

GUIDE = (Path(__file__).resolve().parents[3] / "docs" / "your_scenario.md").read_text(encoding="utf-8")
# A speed [m/s] and a gap [m] each; what braking_car and late_car do follows from v t + v^2 / (2 a).
SPEEDS, GAPS = np.array([[10.0, 40.0], [10.0, 20.0], [10.0, 18.0], [20.0, 90.0]]).T


def files():
    """Return the files of the guide by the name in their first line."""
    return dict(re.findall(r"```(?:python|yaml)\n# (\S+)\n(.*?)```", GUIDE, re.DOTALL))


@pytest.fixture
def scenario():
    exec(files()["stopped_car.py"], {"__name__": "stopped_car"})
    yield SCENARIOS["stopped_car"]
    SCENARIOS.remove("stopped_car")


def test_the_vehicle_of_the_scenario_brakes_as_it_says(scenario):
    outcomes = load_vehicle("braking_car", scenario).simulate(SPEEDS, GAPS)
    left = GAPS - SPEEDS - SPEEDS**2 / 12
    assert outcomes.gap_left == pytest.approx(left)
    assert outcomes.crash.tolist() == [False, False, True, False]
    assert outcomes.impact_speed == pytest.approx(np.where(left <= 0, np.sqrt(100 - 12 * 8), 0))


def test_the_vehicle_of_the_user_sees_the_car_too_late(scenario, tmp_path):
    path = tmp_path / "late_car.py"
    path.write_text(files()["late_car.py"])
    outcomes = load_vehicle(f"{path}:LateCar", scenario).simulate(SPEEDS, GAPS)
    assert outcomes.gap_left == pytest.approx(np.minimum(GAPS, 30) - SPEEDS**2 / 16)
    assert outcomes.crash.tolist() == [False, False, False, False]
    slippery = load_vehicle(f"{path}:LateCar", scenario, deceleration=6.0).simulate(SPEEDS, GAPS)
    assert slippery.impact_speed == pytest.approx([0, 0, 0, np.sqrt(400 - 12 * 30)])


def test_the_events_have_the_directions_that_the_guide_states(scenario):
    outcomes = load_vehicle("braking_car", scenario).simulate(SPEEDS, GAPS)
    happened = {
        text: event_named(text, scenario).happens(outcomes).tolist()
        for text in ("crash", "impact_speed=1", "impact_speed=5", "gap_left=2")
    }
    assert happened == {
        "crash": [False, False, True, False],
        "impact_speed=1": [False, False, True, False],  # it hits the car at 2 m/s
        "impact_speed=5": [False] * 4,
        "gap_left=2": [False, True, True, False],
    }


def test_the_configuration_names_the_two_files():
    config = yaml.safe_load(files()["my_scenario.yaml"])
    assert config["modules"] == ["stopped_car.py"]
    assert config["vehicle"]["name"] == "late_car.py:LateCar"
