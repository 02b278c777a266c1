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
    further parameters.

    Attributes
    ----------
    aeb
        Whether the car has AEB.
    aeb_deceleration
        Largest deceleration that the AEB commands [m/s^2].
    aeb_jerk
        Rate at which the deceleration that the AEB commands increases [m/s^3].
    aeb_ttc
        TTC at which the AEB switches on [s]; None for the published threshold, which depends on the speed.
    aeb_release_ttc
        TTC above which the AEB switches off again [s].
    headway
        Time headway that the ACC keeps [s].
    kp, ki
        Proportional and integral gain of the ACC on the error of the time headway, [m/s^3] and [m/s^4].
    acc_limit
        Largest acceleration and deceleration that the ACC commands [m/s^2].
    acc_top_speed
        Speed at and above which the ACC does not accelerate [m/s].
    friction_limit
        Largest acceleration and deceleration that the friction of the road permits [m/s^2].
    actuator_jerk
        Rate at which the acceleration follows the command [m/s^3].

    Raises
    ------
    InputError
        If a parameter is not a finite number in its range. The message names the first such parameter.
    """

    deterministic: ClassVar[bool] = True

    aeb: bool = True
    aeb_deceleration: float = 10.0
    aeb_jerk: float = 16.0
    aeb_ttc: float | None = None
    aeb_release_ttc: float = 1.0
    headway: float = 2.0
    kp: float = -38.6252446973784
    ki: float = -1.35416845633818
    acc_limit: float = 5.0
    acc_top_speed: float = 90 / 2.236
    friction_limit: float = 9.8
    actuator_jerk: float = 20.0

    def __post_init__(self) -> None:
        if not isinstance(self.aeb, bool):
            raise parameter_error("aeb", self.aeb, "true or false")
        for each in fields(self):
            value = getattr(self, each.name)
            if each.type is float or (each.name == "aeb_ttc" and value is not None):
                check_number(each.name, value, least=-math.inf if each.name in ("kp", "ki") else None)
