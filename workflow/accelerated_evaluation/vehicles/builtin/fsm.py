"""FSM: the fuzzy safety model of a driver."""

from dataclasses import dataclass

from accelerated_evaluation.scenarios.parameters import zero_or_more
from accelerated_evaluation.vehicles.builtin.driver import G, ReferenceDriver
from accelerated_evaluation.vehicles.builtin.driver_kernel import STEP
from accelerated_evaluation.vehicles.builtin.driver_numbers import FSM_RULE, Driver
from accelerated_evaluation.vehicles.protocol import VEHICLES


@VEHICLES.add("fsm")
@dataclass(frozen=True)
class FuzzySafetyModel(ReferenceDriver):
    """The fuzzy safety model, FSM (Mattas et al. 2020, Accident Analysis and Prevention 148:105794).

    Two fuzzy numbers between 0 and 1 measure the danger. The proactive number assumes that the lead vehicle
    brakes hard now, and the critical number assumes that it keeps its speed. The driver reacts if one of them
    is above 0. If the critical number is above 0, the deceleration is between comfortable and full braking,
    in proportion to this number. Otherwise it is comfortable braking times the proactive number. A car that
    is still next to the lane is taken into account, unless the host will have passed before it arrives. The
    model follows JRC-FSM.
    """

    # From the perception of danger to braking, and response time in both fuzzy numbers [s] (Mattas et al.).
    reaction_time: float = zero_or_more(0.75)
    comfort_braking: float = 4.0  # m/s^2 (Mattas et al.)
    host_braking: float = 6.0  # full braking of the host [m/s^2] (Mattas et al.)
    lead_braking: float = 7.0  # full braking of the lead vehicle [m/s^2] (Mattas et al.)
    # Gap that must remain in the worst case, in the proactive number only [m] (JRC-FSM).
    margin: float = zero_or_more(2.0)
    # Additional gap above which the proactive number is 0 [m] (JRC-FSM).
    safe_margin: float = zero_or_more(2.0)
    # Rate at which the deceleration increases [m/s^3]: 0.774 g in 0.6 s, as for CC (JRC-FSM). After the brake
    # was released, the deceleration starts from 0 again.
    jerk: float = 12.65
    # Largest deceleration [m/s^2] (JRC-FSM); it has an effect only if `host_braking` is larger.
    deceleration: float = 0.774 * G

    def compiled(self) -> Driver:
        """Return the parameters of the vehicle as numbers for the compiled simulation."""
        return self._numbers(
            FSM_RULE,
            self.reaction_time,
            ramp_step=self.jerk * STEP,
            response_time=self.reaction_time,
            comfort=self.comfort_braking,
            comfort_to_full=self.host_braking - self.comfort_braking,
            comfort_path=1 / (2 * self.comfort_braking),
            host_path=1 / (2 * self.host_braking),
            lead_path=1 / (2 * self.lead_braking),
            forgets_ramp=True,
        )
