"""Parameters that the paper's car has in all scenarios: in the cut-in, the left turn and the crossing."""

import math
from dataclasses import dataclass, fields
from typing import ClassVar

from accelerated_evaluation.scenarios.parameters import check_number, parameter_error


@dataclass(frozen=True)
class AccAebParameters:
    """Parameters of a car with ACC, and with AEB unless ``aeb`` is false.

    The car has a proportional-integral ACC on the time headway, an AEB triggered by the time to collision
    (TTC), and an actuator limited in friction and jerk. The cars of the scenarios have other defaults and
    further parameters. InputError names the first parameter that is not a finite number in its range.
    """

    deterministic: ClassVar[bool] = True

    aeb: bool = True  # whether the car has AEB
    aeb_deceleration: float = 10.0  # largest deceleration that the AEB commands [m/s^2]
    aeb_jerk: float = 16.0  # rate at which this deceleration increases [m/s^3]
    # TTC at which the AEB switches on [s]; None for the published threshold, which depends on the speed.
    aeb_ttc: float | None = None
    aeb_release_ttc: float = 1.0  # TTC above which the AEB switches off again [s]
    headway: float = 2.0  # time headway that the ACC keeps [s]
    kp: float = -38.6252446973784  # proportional gain of the ACC on the error of the time headway [m/s^3]
    ki: float = -1.35416845633818  # integral gain [m/s^4]
    acc_limit: float = 5.0  # largest acceleration and deceleration that the ACC commands [m/s^2]
    acc_top_speed: float = 90 / 2.236  # at and above this speed [m/s] the ACC does not accelerate
    # Largest acceleration and deceleration that the friction of the road permits [m/s^2].
    friction_limit: float = 9.8
    actuator_jerk: float = 20.0  # rate at which the acceleration follows the command [m/s^3]

    def __post_init__(self) -> None:
        if not isinstance(self.aeb, bool):
            raise parameter_error("aeb", self.aeb, "true or false")
        for each in fields(self):
            value = getattr(self, each.name)
            if each.type is float or (each.name == "aeb_ttc" and value is not None):
                check_number(each.name, value, least=-math.inf if each.name in ("kp", "ki") else None)
