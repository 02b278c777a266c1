"""The toy vehicle: it reacts after a time and brakes with a constant deceleration."""

from dataclasses import dataclass

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
