"""A car whose crashes are known in closed form, and records whose distribution is."""

import numpy as np
from accelerated_evaluation.laws.smooth.family import DistinctRecords
from accelerated_evaluation.laws.smooth.support import SUPPORT
from accelerated_evaluation.vehicles import Outcomes

RATE = 0.3  # [1/s]


class RateCar:
    """Crashes where TTC^-1 exceeds the rate, whatever the lead speed."""

    def simulate(self, lead_speed, range_, closing_speed):
        crash = closing_speed > RATE * range_
        near = np.where(closing_speed > 0, range_ / np.maximum(closing_speed, 1e-9), np.inf)
        return Outcomes(crash, np.where(crash, 0.0, range_), near, np.where(crash, closing_speed, 0.0))


def exponential_records(size, mean):
    """Draw records; closing speeds are exponential with this mean [m/s] at every lead speed and range."""
    generator = np.random.default_rng(1)
    lead_speed = generator.uniform(5, 34.9, size)
    range_ = SUPPORT.range_max * generator.uniform(0, 1, size) ** 0.5  # P(R < r) = (r / 75)^2
    return DistinctRecords(lead_speed, range_, mean * generator.standard_exponential(size))
