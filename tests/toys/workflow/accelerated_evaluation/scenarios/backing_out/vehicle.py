"""The toy vehicle: it reacts after a time and brakes with a constant deceleration."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from accelerated_evaluation.scenarios.backing_out import BACKING_OUT, BackingOutOutcomes
from numpy.typing import ArrayLike


@BACKING_OUT.vehicles.add("braking_car")
@dataclass(frozen=True)
class BrakingCar:
    """Stops after ``reaction_time`` [s] at ``deceleration`` [m/s^2]."""

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
