"""Cars that crash never, always or under odd conditions, as a user might bring them."""

from dataclasses import dataclass

import numpy as np
from accelerated_evaluation.vehicles import Outcomes


def outcomes(crash, range_, closing_speed):
    """Return plausible outcomes of given crashes: the gap shrinks to a tenth of the range."""
    gap = np.where(crash, 0.0, range_ / 10)
    ttc = np.where(crash, 1e-3, range_ / np.maximum(closing_speed, 1e-6) / 10)
    return Outcomes(crash, gap, ttc, np.where(crash, closing_speed, 0.0))


@dataclass(frozen=True)
class From:
    """Crashes from a TTC^-1 [1/s] on, below a lead speed [m/s]."""

    inverse_ttc: float = 0.0
    slower_than: float = 1000.0

    def simulate(self, lead_speed, range_, closing_speed):
        crash = (closing_speed / range_ >= self.inverse_ttc) & (lead_speed < self.slower_than)
        return outcomes(crash, range_, closing_speed)


@dataclass(frozen=True)
class Never:
    """Never crashes, and never comes any nearer than it began."""

    def simulate(self, lead_speed, range_, closing_speed):
        return Outcomes(
            np.zeros(range_.size, dtype=bool),
            range_.copy(),
            np.full(range_.size, np.inf),
            np.zeros(range_.size),
        )
