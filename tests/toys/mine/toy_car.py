"""A toy: a car that brakes at once, with a constant deceleration."""

from dataclasses import dataclass

import numpy as np
from accelerated_evaluation.vehicles.protocol import VEHICLES, Outcomes


@VEHICLES.add("toy_car")
@dataclass(frozen=True)
class ToyCar:
    """It stops closing in after closing_speed^2 / (2 deceleration) metres."""

    deceleration: float = 3.0

    def simulate(self, lead_speed, range_, closing_speed):
        """Simulate n cut-ins."""
        left = range_ - np.square(np.maximum(closing_speed, 0)) / (2 * self.deceleration)
        crash = left <= 0
        at_impact = np.sqrt(np.maximum(np.square(closing_speed) - 2 * self.deceleration * range_, 0))
        ttc = np.where(closing_speed > 0, range_ / np.maximum(closing_speed, 1e-300), np.inf)
        return Outcomes(crash, np.minimum(left, range_), ttc, np.where(crash, at_impact, 0.0))
