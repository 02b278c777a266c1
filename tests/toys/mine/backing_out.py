"""A toy scenario with its vehicle: a parked car backs out in front of the vehicle under test."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.registry import Registry
from accelerated_evaluation.scenarios import SCENARIOS
from accelerated_evaluation.scenarios.protocol import FLAG, Event, Scenario, Simulating, Variable, outcome
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True)
class BackingOutOutcomes:
    """Outcomes of n simulated encounters; every array has shape (n,)."""

    crash: NDArray[np.bool_] = outcome(FLAG, "1 if the vehicle stopped behind the parked car, else 0")
    gap_left: Array = outcome("m", "distance that was left; 0 or less after a crash")


BACKING_OUT = SCENARIOS.add("backing_out")(
    Scenario(
        name="backing_out",
        description="a parked car backs out in front of the vehicle under test",
        variables=(
            Variable("speed_mps", "m/s", 0, 20, "modelled", "speed of the vehicle under test"),
            Variable("gap_m", "m", 0, 100, "modelled", "distance to the parked car when it begins to move"),
        ),
        outcome_type=BackingOutOutcomes,
        events=(Event.flag("crash", scored_by="gap_left"),),
        vehicles=Registry("vehicle", __name__, [], contract=[Simulating]),
        default_vehicle="braking_car",
    )
)


@BACKING_OUT.vehicles.add("braking_car")
@dataclass(frozen=True)
class BrakingCar:
    """Reacts after ``reaction_time`` [s], and brakes with a constant ``deceleration`` [m/s^2]."""

    reaction_time: float = 1.0
    deceleration: float = 6.0

    def simulate(self, speed: ArrayLike, gap: ArrayLike) -> BackingOutOutcomes:
        """Simulate n encounters."""
        speed, gap = BACKING_OUT.checked(speed, gap)
        gap_left = gap - speed * self.reaction_time - speed**2 / (2 * self.deceleration)
        return BackingOutOutcomes(gap_left <= 0, gap_left)

    def trace(self, speed: float, gap: float) -> pd.DataFrame:
        """Return the speed [m/s] and the gap [m] of one encounter, every 0.1 s."""
        time = np.arange(0, self.reaction_time + speed / self.deceleration + 0.1, 0.1)
        speeds = np.clip(speed - self.deceleration * (time - self.reaction_time), 0, speed)
        driven = np.append(0, np.cumsum((speeds[1:] + speeds[:-1]) / 20))
        return pd.DataFrame({"time_s": time, "speed_mps": speeds, "gap_m": gap - driven})
