"""CC: the model of a competent and careful human driver in UN R157."""

import math
from dataclasses import dataclass

from accelerated_evaluation.scenarios.parameters import zero_or_more
from accelerated_evaluation.vehicles.builtin.driver import G, ReferenceDriver
from accelerated_evaluation.vehicles.builtin.driver_kernel import STEP
from accelerated_evaluation.vehicles.builtin.driver_numbers import TTC_RULE, Driver
from accelerated_evaluation.vehicles.protocol import VEHICLES


@VEHICLES.add("cc_human")
@dataclass(frozen=True)
class CompetentCarefulHuman(ReferenceDriver):
    """The competent and careful human driver (UN R157, Annex 4, Appendix 3, as in JRC-FSM).

    The driver perceives danger when the cars overlap laterally and the time to collision is 2 s or less. The
    driver then takes the foot off the accelerator. After the reaction time the driver brakes, and the
    deceleration increases up to its limit.

    According to UN R157 itself, the driver perceives a cut-in when the other car has drifted by 0.375 m, and
    evaluates it in 0.4 s. JRC-FSM, which this class follows, waits until the cars overlap, which is later.
    """

    critical_ttc: float = 2.0  # time to collision at which the driver perceives danger [s] (JRC-FSM)
    reaction_time: float = zero_or_more(0.75)  # from the perception of danger to braking [s] (UN R157)
    # Deceleration during the reaction time, at which the braking begins [m/s^2] (JRC-FSM, whose author is not
    # sure of it; UN R157 has no such deceleration).
    release_deceleration: float = zero_or_more(0.4)
    jerk: float = 12.65  # rate at which the deceleration increases [m/s^3]: 0.774 g in 0.6 s (UN R157)
    deceleration: float = 0.774 * G  # largest deceleration [m/s^2] (UN R157)
    # Whether the driver still brakes if the time to collision is above the critical one when the cars begin
    # to overlap. If true, the driver keeps watching and reacts when the time to collision becomes critical;
    # at closing speeds above 15.3 to 16.5 m/s that is too late for any range. If false, such a cut-in is
    # outside of the model, and ends without a crash, as in the comparison of drivers with JRC-FSM.
    keeps_watching: bool = True

    def compiled(self) -> Driver:
        """Return the parameters of the vehicle as numbers for the compiled simulation."""
        return self._numbers(
            TTC_RULE,
            self.reaction_time,
            ramp_step=self.jerk * STEP,
            coasting=self.release_deceleration,
            dropped_ttc=math.inf if self.keeps_watching else self.critical_ttc,
        )
