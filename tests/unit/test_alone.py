"""Vehicles with a state, or whose encounters depend on each other, differ from a new copy of themselves."""

import numpy as np
import pytest
from accelerated_evaluation.vehicles import load_vehicle
from accelerated_evaluation.vehicles.external.alone import COMPARED, difference_when_alone

CLASSES = '''
import numpy as np
from accelerated_evaluation.vehicles import Outcomes


class Same:
    deterministic = None

    def crash(self, lead_speed, range_, closing_speed):
        return closing_speed > 0.3 * range_

    def simulate(self, *encounters):
        crash = self.crash(*encounters)
        return Outcomes(crash, 1.0 - crash, np.ones(len(crash)), np.where(crash, encounters[2], 0.0))


class Tired(Same):
    """Brakes worse after thirty encounters."""

    def __init__(self):
        self.calls = 0

    def crash(self, lead_speed, range_, closing_speed):
        self.calls += len(range_)
        return closing_speed > (0.3 if self.calls <= 30 else 0.2) * range_


class Crowded(Same):
    """Crashes more easily in a batch of several encounters."""

    def crash(self, lead_speed, range_, closing_speed):
        return closing_speed > (0.3 if len(range_) == 1 else 0.2) * range_


class Random(Tired):
    deterministic = False
'''


@pytest.fixture
def section(tmp_path):
    path = tmp_path / "cars.py"
    path.write_text(CLASSES)
    return lambda name: {"name": f"{path}:{name}", "parameters": {}}


def simulated(section, size=60):
    """Encounters, and the flags of a vehicle that simulates them in batches of five."""
    generator = np.random.default_rng(1)
    encounters = np.array(
        [generator.uniform(5, 35, size), generator.uniform(10, 20, size), generator.uniform(2, 6, size)]
    )
    vehicle = load_vehicle(section["name"])
    vehicle.was_repeated = True
    parts = [vehicle.simulate(*encounters[:, start : start + 5]).crash for start in range(0, size, 5)]
    return encounters, np.concatenate(parts)


def test_a_vehicle_that_repeats_itself_is_reproduced(section):
    encounters, crashed = simulated(section("Same"))
    assert min(crashed.sum(), (~crashed).sum()) > COMPARED
    assert difference_when_alone(section("Same"), encounters, crashed) is None
    assert difference_when_alone(section("Same"), encounters, ~crashed) is not None  # so that it can fail


@pytest.mark.parametrize("name", ["Tired", "Crowded"])
def test_a_state_or_neighbours_are_noticed(section, name):
    encounters, crashed = simulated(section(name))
    seen = difference_when_alone(section(name), encounters, crashed)
    assert "seen crash in the estimate, and no crash in a new copy" in seen
    assert "Keep no state between calls" in seen


def test_vehicles_that_are_random_or_of_this_project_are_not_compared(section):
    encounters, crashed = simulated(section("Random"))
    assert difference_when_alone(section("Random"), encounters, crashed) is None
    declared = section("Tired") | {"deterministic": False}
    assert difference_when_alone(declared, encounters, crashed) is None
    assert difference_when_alone({"name": "acc_aeb", "parameters": {}}, encounters, ~crashed) is None
