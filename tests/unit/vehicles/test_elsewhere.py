"""Vehicles with a state, with dependent encounters or with a seed in each process differ from themselves."""

from functools import partial

import numpy as np
import pytest
from accelerated_evaluation import CUT_IN, load_vehicle
from accelerated_evaluation.vehicles.external.watched import WatchedVehicle
from accelerated_evaluation.vehicles.external.workers import Elsewhere, Processes, difference_elsewhere
from accelerated_evaluation.vehicles.protocol import CRASH

CLASSES = '''
import os

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


class Seeded(Same):
    """Crashes in a share of the encounters, which is drawn once for each process."""

    share = 0.1
    salt = int.from_bytes(os.urandom(4), "little")

    def crash(self, *encounters):
        draws = [np.random.default_rng([self.salt, hash(one) % 2**32]).random() for one in zip(*encounters)]
        return super().crash(*encounters) | (np.array(draws) < self.share)


class SeldomSeeded(Seeded):
    share = 0.05


class Random(Tired):
    deterministic = False
'''


@pytest.fixture(scope="module")
def other():
    """Return one other process for all tests, because its start takes seconds."""
    with Processes(1) as processes:
        yield processes


@pytest.fixture
def simulated(tmp_path, other):
    """Return a function that simulates encounters in batches of five by a vehicle with a copy elsewhere."""
    path = tmp_path / "cars.py"
    path.write_text(CLASSES)

    def simulate(name, size=60, **changes):
        encounters = np.random.default_rng(1).uniform((5, 10, 2), (35, 20, 6), (size, 3)).T.copy()
        car = load_vehicle(f"{path}:{name}")
        vars(car).update(was_repeated=True, elsewhere=Elsewhere(car.name, {}, CUT_IN, other), **changes)
        vehicle = WatchedVehicle(car, CUT_IN)
        for start in range(0, size, 5):
            vehicle.simulate(*encounters[:, start : start + 5])
        np.testing.assert_array_equal(vehicle.encounters, encounters)
        return car, vehicle.encounters, vehicle.outcomes

    return simulate


def test_a_vehicle_that_repeats_itself_is_reproduced(simulated):
    car, encounters, outcomes = simulated("Same")
    assert 0 < outcomes.crash.sum() < 60
    assert difference_elsewhere(car, encounters, outcomes, CRASH) is None
    turned = np.roll(encounters, 1, axis=1)  # the wrong variant: outcomes of other encounters
    assert difference_elsewhere(car, turned, outcomes, CRASH) is not None


@pytest.mark.parametrize("name", ["Tired", "Crowded", "Seeded"])
@pytest.mark.parametrize("declared", [True, None])
def test_a_state_neighbours_or_a_seed_in_each_process_are_noticed(simulated, name, declared):
    car, encounters, outcomes = simulated(name, deterministic=declared)
    seen = str(difference_elsewhere(car, encounters, outcomes, CRASH))
    assert "when simulated again in another batch; expected the same outcomes" in seen
    assert "set vehicle.deterministic to false" in seen


def test_one_lapse_in_twenty_runs_is_noticed_among_three_hundred(simulated):
    """Two processes agree on the 150 runs or more without a crash with probability 0.9 ** 150, 1e-7."""
    car, encounters, outcomes = simulated("SeldomSeeded", size=300)
    assert difference_elsewhere(car, encounters, outcomes, CRASH) is not None
    car.elsewhere = None  # the wrong variant: in the same process, each repetition ends in the same way
    assert difference_elsewhere(car, encounters, outcomes, CRASH) is None


def test_repetitions_of_a_watched_vehicle_are_counted(simulated):
    car, encounters, _ = simulated("Seeded")
    vehicle = WatchedVehicle(car, CUT_IN)
    vehicle.simulate(*encounters)
    assert vehicle.differed == 0
    vehicle.repeat(*encounters)
    assert vehicle.differed > 0
    assert vehicle.encounters.shape == encounters.shape


def test_vehicles_that_are_random_or_of_this_project_are_not_compared(simulated):
    compared = partial(difference_elsewhere, event=CRASH)
    assert compared(*simulated("Random")) is None
    assert compared(*simulated("Seeded", deterministic=False)) is None
    _, encounters, outcomes = simulated("Same")
    assert compared(load_vehicle("acc_aeb"), encounters, outcomes) is None
