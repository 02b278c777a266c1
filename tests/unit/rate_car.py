"""A car whose crashes are known in closed form."""

import numpy as np
from accelerated_evaluation.vehicles import Outcomes

RATE = 0.3  # [1/s]


class RateCar:
    """Crashes where TTC^-1 exceeds the rate, whatever the lead speed."""

    def simulate(self, lead_speed, range_, closing_speed):
        crash = closing_speed > RATE * range_
        near = np.where(closing_speed > 0, range_ / np.maximum(closing_speed, 1e-9), np.inf)
        return Outcomes(crash, np.where(crash, 0.0, range_), near, np.where(crash, closing_speed, 0.0))
