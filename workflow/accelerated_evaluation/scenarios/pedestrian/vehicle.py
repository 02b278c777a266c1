"""The car under test in the pedestrian crossing, and the initial positions of car and pedestrian."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.scenarios.crossing.car import CrossingCar
from accelerated_evaluation.scenarios.crossing.kernel import TICK
from accelerated_evaluation.scenarios.pedestrian import PEDESTRIAN, VEHICLES
from accelerated_evaluation.scenarios.protocol import Scenario

LANE = 3.9  # [m], width of the lane that the pedestrian crosses


@VEHICLES.add("acc_aeb")
@dataclass(frozen=True)
class PedestrianCar(CrossingCar):
    """The authors' car (the host) in an encounter with a pedestrian who crosses its lane.

    The contact of car and pedestrian is tested as in the authors' code, which measures an angle from the
    wrong axis. The sector in which a distance below 2 m is a contact is therefore at the side to which the
    pedestrian walks, and not ahead of the car.
    """

    scenario: ClassVar[Scenario] = PEDESTRIAN
    contact: ClassVar[float] = 1.0
    side_contact: ClassVar[float] = 2.0

    def start(self, encounters: Array) -> Array:
        """Return the initial states, shape (7, n), of encounters, shape (3, n); `kernel` lists the rows.

        The pedestrian walks from one edge of the lane to the other; the direction makes no difference. The
        car starts at such a position that, at constant speed, it would have the given distance when the
        pedestrian is in the middle of the lane.
        """
        speed, walking_speed, distance = np.abs(encounters)
        with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
            duration = LANE / walking_speed
            ahead = distance + np.where(speed > 0, speed * duration / 2, 0)
        aside = np.full_like(speed, LANE / 2)
        none = np.zeros_like(speed)
        return np.stack([speed, ahead, aside, walking_speed, none, none, np.floor(duration / TICK)])
