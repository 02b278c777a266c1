"""Reg157: the braking model of UN R157."""

import math
from dataclasses import dataclass
from typing import ClassVar

from accelerated_evaluation.scenarios.parameters import zero_or_more
from accelerated_evaluation.vehicles.builtin.driver import ReferenceDriver
from accelerated_evaluation.vehicles.builtin.driver_numbers import TTC_RULE, Driver
from accelerated_evaluation.vehicles.registry import VEHICLES


@VEHICLES.add("reg157")
@dataclass(frozen=True)
class Reg157(ReferenceDriver):
    """The braking that UN R157, paragraph 5.2.5.2, asks of an automated lane keeping system, as in JRC-FSM.

    The system sees danger when the sides come as near as ``lateral_gap`` and the time to collision is no more
    than closing speed / (2 deceleration) + reaction time + margin. After its reaction time it brakes fully.

    Attributes
    ----------
    reaction_time
        From danger to the brake [s]; 0.35 (UN R157, paragraph 5.2.5.2).
    deceleration
        Deceleration [m/s^2]; 6 (UN R157, paragraph 5.2.5.2), reached at once.
    lateral_gap
        Gap between the sides from which a cut-in counts [m]: 0.8 m to the lane marking minus an
        intrusion of 0.3 m (JRC-FSM).
    ttc_margin
        Added to the critical time to collision [s]: one step of 0.1 s (JRC-FSM, where it is not explained;
        without it the steps in time would trigger too late to stop).
    """

    # Its crashes are stripes of a few millimetres of range: from a distance they look like chance.
    striped: ClassVar[bool] = True

    reaction_time: float = zero_or_more(0.35)
    deceleration: float = 6.0
    lateral_gap: float = zero_or_more(0.5)
    ttc_margin: float = zero_or_more(0.1)

    def compiled(self) -> Driver:
        """Return the numbers that the compiled code needs."""
        return self._numbers(
            TTC_RULE,
            self.reaction_time,
            critical_ttc=self.reaction_time + self.ttc_margin,
            ttc_slope=1 / (2 * self.deceleration),
            lateral_gap=self.lateral_gap,
            ramp_step=math.inf,
            deceleration=self.deceleration,
        )
