"""RSS: a driver who follows the rules of responsibility-sensitive safety."""

from dataclasses import dataclass

from accelerated_evaluation.scenarios.parameters import zero_or_more
from accelerated_evaluation.vehicles.builtin.driver import G, ReferenceDriver
from accelerated_evaluation.vehicles.builtin.driver_kernel import STEP
from accelerated_evaluation.vehicles.builtin.driver_numbers import RSS_RULE, Driver
from accelerated_evaluation.vehicles.protocol import VEHICLES


@VEHICLES.add("rss")
@dataclass(frozen=True)
class ResponsibilitySensitiveSafety(ReferenceDriver):
    """Responsibility-sensitive safety, RSS (Shalev-Shwartz et al. 2017, arXiv 1708.06374), as in JRC-FSM.

    The driver perceives danger when the other car is nearer than the safe distances of RSS in both
    directions, longitudinal and lateral. After the reaction time the driver brakes like the competent and
    careful human driver (CC), which is harder than the longitudinal safe distance assumes.
    """

    # From the perception of danger to braking, and response time in the safe distances [s] (JRC-FSM).
    reaction_time: float = zero_or_more(0.75)
    # Of the host during the response, which the safe distance allows for [m/s^2] (JRC-FSM).
    response_acceleration: float = zero_or_more(3.0)
    # In the longitudinal safe distance [m/s^2] (JRC-FSM, one value for both vehicles).
    host_braking: float = 6.0
    lead_braking: float = 6.0  # in the longitudinal safe distance [m/s^2] (JRC-FSM)
    # Acceleration and braking of both cars in the lateral safe distance [m/s^2] (JRC-FSM).
    lateral_acceleration: float = 1.0
    lateral_margin: float = zero_or_more(0.3)  # lateral gap that must remain [m] (JRC-FSM)
    # Rate at which the deceleration increases [m/s^3]: 0.774 g in 0.6 s, as for CC (JRC-FSM).
    jerk: float = 12.65
    deceleration: float = 0.774 * G  # largest deceleration [m/s^2], as for CC (JRC-FSM)

    def compiled(self) -> Driver:
        """Return the parameters of the vehicle as numbers for the compiled simulation."""
        return self._numbers(
            RSS_RULE,
            self.reaction_time,
            ramp_step=self.jerk * STEP,
            response_time=self.reaction_time,
            host_path=1 / (2 * self.host_braking),
            lead_path=1 / (2 * self.lead_braking),
            lateral_path=1 / (2 * self.lateral_acceleration),
            lateral_gap=self.lateral_margin,
        )
