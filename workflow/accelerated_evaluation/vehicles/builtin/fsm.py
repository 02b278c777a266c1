"""FSM: the fuzzy safety model."""

from dataclasses import dataclass

from accelerated_evaluation.scenarios.parameters import zero_or_more
from accelerated_evaluation.vehicles.builtin.driver import G, ReferenceDriver
from accelerated_evaluation.vehicles.builtin.driver_kernel import STEP
from accelerated_evaluation.vehicles.builtin.driver_numbers import FSM_RULE, Driver
from accelerated_evaluation.vehicles.registry import VEHICLES


@VEHICLES.add("fsm")
@dataclass(frozen=True)
class FuzzySafetyModel(ReferenceDriver):
    """The fuzzy safety model, FSM (Mattas et al. 2020, Accident Analysis and Prevention 148:105794).

    Two fuzzy numbers between 0 and 1 measure the danger: a proactive one, in case the lead vehicle brakes
    hard, and a critical one, for its present speed. Above 0 the driver reacts: comfortable braking in
    proportion to the proactive number, or, if there is critical danger, between comfortable and full braking.
    A car beside the lane counts unless the host will have passed before it arrives. All as in JRC-FSM.

    Attributes
    ----------
    reaction_time
        From danger to the brake, and the response time in both numbers [s] (Mattas et al.).
    comfort_braking, host_braking, lead_braking
        Comfortable and full braking of the host, full braking of the lead vehicle [m/s^2] (Mattas et al.).
    margin
        Gap to keep in the worst case, counted in the proactive number alone [m] (JRC-FSM).
    safe_margin
        Further gap above which that number is 0 [m] (JRC-FSM).
    jerk
        Growth of the deceleration [m/s^3]: 0.774 g in 0.6 s, as CC (JRC-FSM). It starts from 0 again after
        a release.
    deceleration
        Largest deceleration [m/s^2]: 0.774 g (JRC-FSM), never reached unless ``host_braking`` is larger.
    """

    reaction_time: float = zero_or_more(0.75)
    comfort_braking: float = 4.0
    host_braking: float = 6.0
    lead_braking: float = 7.0
    margin: float = zero_or_more(2.0)
    safe_margin: float = zero_or_more(2.0)
    jerk: float = 12.65
    deceleration: float = 0.774 * G

    def compiled(self) -> Driver:
        """Return the numbers that the compiled code needs."""
        return self._numbers(
            FSM_RULE,
            self.reaction_time,
            response_time=self.reaction_time,
            comfort=self.comfort_braking,
            comfort_to_full=self.host_braking - self.comfort_braking,
            comfort_path=1 / (2 * self.comfort_braking),
            host_path=1 / (2 * self.host_braking),
            lead_path=1 / (2 * self.lead_braking),
            margin=self.margin,
            safe_margin=self.safe_margin,
            ramp_step=self.jerk * STEP,
            deceleration=self.deceleration,
            forgets_ramp=True,
        )
