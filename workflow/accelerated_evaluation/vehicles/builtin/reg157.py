"""Reg157: the model of a braking automated vehicle in UN R157."""

import math
from dataclasses import dataclass
from typing import ClassVar

from accelerated_evaluation.scenarios.parameters import zero_or_more
from accelerated_evaluation.vehicles.builtin.driver import ReferenceDriver
from accelerated_evaluation.vehicles.builtin.driver_numbers import TTC_RULE, Driver
from accelerated_evaluation.vehicles.protocol import VEHICLES


@VEHICLES.add("reg157")
@dataclass(frozen=True)
class Reg157(ReferenceDriver):
    """The braking that UN R157, paragraph 5.2.5.2, requires of automated lane keeping, as in JRC-FSM.

    The system detects danger when the lateral gap between the cars is at most ``lateral_gap`` and the time to
    collision is at most closing speed / (2 deceleration) + reaction_time + ttc_margin. After the reaction
    time it brakes fully.
    """

    # The crashes form stripes with a width of a few millimetres of range, so that they resemble chance.
    striped: ClassVar[bool] = True

    # From the detection of danger to braking [s] (UN R157, paragraph 5.2.5.2).
    reaction_time: float = zero_or_more(0.35)
    deceleration: float = 6.0  # m/s^2, which is reached immediately (UN R157, paragraph 5.2.5.2)
    # Gap between the sides of the cars at which a cut-in is detected [m]: 0.8 m to the lane marking minus an
    # intrusion of 0.3 m (JRC-FSM).
    lateral_gap: float = zero_or_more(0.5)
    # Addition to the critical time to collision [s]: one step of 0.1 s (JRC-FSM, without an explanation).
    # Without it, braking would begin too late, because of the steps in time.
    ttc_margin: float = zero_or_more(0.1)

    def compiled(self) -> Driver:
        """Return the parameters of the vehicle as numbers for the compiled simulation."""
        return self._numbers(
            TTC_RULE,
            self.reaction_time,
            ramp_step=math.inf,
            critical_ttc=self.reaction_time + self.ttc_margin,
            ttc_slope=1 / (2 * self.deceleration),
        )
