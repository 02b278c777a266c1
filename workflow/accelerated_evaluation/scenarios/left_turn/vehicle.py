"""The car under test in the left turn, and the geometry of the turn."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.scenarios.crossing.car import CrossingCar
from accelerated_evaluation.scenarios.crossing.kernel import TICK
from accelerated_evaluation.scenarios.left_turn import LEFT_TURN, VEHICLES
from accelerated_evaluation.scenarios.protocol import Scenario

RADIUS = 6.0  # [m], radius of the turn
LANE = 3.9  # [m], width of a lane
CONFLICT_ANGLE = np.arccos((RADIUS - LANE) / RADIUS)  # angle turned when the car reaches the path of the host
LEAD_TIME = 1.0  # [s], longest time from the start to the conflict point


@VEHICLES.add("acc_aeb")
@dataclass(frozen=True)
class LeftTurnCar(CrossingCar):
    """The authors' car (the host) in an encounter with a car that turns left across its path."""

    scenario: ClassVar[Scenario] = LEFT_TURN
    contact: ClassVar[float] = 2.1

    def start(self, encounters: Array) -> Array:
        """Return the initial states, shape (7, n), of encounters, shape (3, n); `kernel` lists the rows.

        The turning car starts one second before it reaches the conflict point, or at the beginning of its
        turn if that is later. Its velocity is given every 0.1 s, for a quarter turn and then straight ahead
        until it has left the second lane. Points before the start are skipped.
        """
        speed, turning_speed, distance = encounters
        to_conflict = np.minimum(CONFLICT_ANGLE, LEAD_TIME * turning_speed / RADIUS)  # angle still to turn
        turned = CONFLICT_ANGLE - to_conflict
        with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
            lead_time = np.where(turning_speed > 0, to_conflict * RADIUS / turning_speed, LEAD_TIME)
            first = np.floor(turned * RADIUS / turning_speed / TICK + 0.5)
            turning = np.floor(np.pi / 2 * RADIUS / turning_speed / TICK) + 1
            ticks = np.floor((RADIUS * np.pi / 2 + 2 * LANE) / turning_speed / TICK) - first
        ahead = distance * np.sin(CONFLICT_ANGLE) + speed * lead_time + RADIUS * (1 - np.sin(turned))
        aside = LANE - RADIUS * (1 - np.cos(turned))
        endless = ~np.isfinite(ticks)  # the turning car stands still, or almost so
        first, ticks = np.where(endless, 0, first), np.where(endless, np.inf, ticks)
        return np.stack([speed, ahead, aside, turning_speed, first, turning, ticks])
