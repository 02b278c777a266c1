"""CC: the competent and careful human driver of UN R157."""

import math
from dataclasses import dataclass

from accelerated_evaluation.scenarios.parameters import zero_or_more
from accelerated_evaluation.vehicles.builtin.driver import G, ReferenceDriver
from accelerated_evaluation.vehicles.builtin.driver_kernel import STEP
from accelerated_evaluation.vehicles.builtin.driver_numbers import TTC_RULE, Driver
from accelerated_evaluation.vehicles.registry import VEHICLES


@VEHICLES.add("cc_human")
@dataclass(frozen=True)
class CompetentCarefulHuman(ReferenceDriver):
    """The competent and careful human driver (UN R157, Annex 4, Appendix 3, as in JRC-FSM).

    The driver sees danger when the bodies overlap sideways and the time to collision is 2 s or less. It then
    takes the foot off the accelerator, and after its reaction time brakes, ever harder, to its limit.

    UN R157 itself lets the driver perceive a cut-in when the car has drifted 0.375 m, and evaluate it in
    0.4 s. JRC-FSM waits until the bodies overlap, which is later, and this class does as JRC-FSM.

    Attributes
    ----------
    critical_ttc
        Time to collision that is critical [s] (JRC-FSM).
    reaction_time
        From danger to the brake [s]; 0.75 (UN R157).
    release_deceleration
        Deceleration during the reaction [m/s^2], from which the braking grows (JRC-FSM, whose author is not
        sure of it; UN R157 has none).
    jerk
        Growth of the deceleration [m/s^3]: 0.774 g in 0.6 s (UN R157).
    deceleration
        Largest deceleration [m/s^2]: 0.774 g (UN R157).
    keeps_watching
        What becomes of a cut-in at a time to collision above the critical one. If true, the driver goes on
        watching and brakes when it becomes critical; at closing speeds above 15.3 to 16.5 m/s that
        is too late, whatever the range. If false, such a cut-in is outside the model and counts as no crash,
        as in JRC-FSM's comparison of the drivers; the simulation ends there.
    """

    critical_ttc: float = 2.0
    reaction_time: float = zero_or_more(0.75)
    release_deceleration: float = zero_or_more(0.4)
    jerk: float = 12.65
    deceleration: float = 0.774 * G
    keeps_watching: bool = True

    def compiled(self) -> Driver:
        """Return the numbers that the compiled code needs."""
        return self._numbers(
            TTC_RULE,
            self.reaction_time,
            critical_ttc=self.critical_ttc,
            coasting=self.release_deceleration,
            ramp_step=self.jerk * STEP,
            deceleration=self.deceleration,
            dropped_ttc=math.inf if self.keeps_watching else self.critical_ttc,
        )
