"""The car of the study: adaptive cruise control (ACC) with autonomous emergency braking (AEB)."""

import math
from dataclasses import dataclass, field, replace
from typing import ClassVar

from accelerated_evaluation.scenarios.parameters import AccAebParameters, parameter_error
from accelerated_evaluation.vehicles.builtin.kernel import STEP, Car, simulate_slice
from accelerated_evaluation.vehicles.builtin.traces import trace_car
from accelerated_evaluation.vehicles.moving import CompiledVehicle
from accelerated_evaluation.vehicles.protocol import VEHICLES

KMH = 1 / 3.6  # [m/s]
# Time to collision at which a 2011 Volvo V60 brakes: linear in the speed through two points, then constant.
V60_SPEEDS = (16 * KMH, 40 * KMH)  # [m/s]
V60_TTC = (0.86, 0.91)  # [s]


@VEHICLES.add("acc_aeb")
@dataclass(frozen=True)
class AccAeb(AccAebParameters, CompiledVehicle):
    """A car with ACC, and with AEB unless ``aeb`` is false; the defaults are the authors' published car.

    The car has a proportional-integral ACC on the time headway, an AEB triggered by the time to collision
    (TTC), and an actuator limited in friction and jerk. An encounter is simulated for 8 s, in steps of 0.1 s;
    `tests/unit/reference_car.py` is a readable version of the simulation. If ``aeb_ttc`` is None, the AEB has
    the threshold of a Volvo V60, which depends on the speed and is 0.91 s at 40 km/h and above. InputError is
    raised if a parameter is not a finite number in its range.
    """

    kernel: ClassVar = staticmethod(simulate_slice)
    tracer: ClassVar = staticmethod(trace_car)
    published_ttc: ClassVar[tuple[float, float]] = V60_TTC
    published_line: ClassVar[tuple[float, float, float]] = (
        *(V60_TTC[0], V60_SPEEDS[0]),
        (V60_TTC[1] - V60_TTC[0]) / (V60_SPEEDS[1] - V60_SPEEDS[0]),
    )

    top_start_speed: float = 35.0  # cap on the speed at the start of an encounter [m/s]
    # Steps of the motion and of the controller [s]. The published verdicts have 0.1 s for both; smaller steps
    # show the numerical error of the simulation.
    time_step: float = STEP
    decision_step: float = STEP

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, value, whole in (
            ("time_step", self.time_step, self.decision_step),
            ("decision_step", self.decision_step, STEP),
        ):
            if not math.isclose(whole / value, round(whole / value)):
                raise parameter_error(name, value, f"{whole:g} s, or this divided by a whole number")
        if self.threshold_top > self.aeb_release_ttc:
            expected = f"at most aeb_release_ttc = {self.aeb_release_ttc:g} s"
            raise parameter_error("aeb_ttc", self.threshold_top, expected)

    def at_steps(self, time_step: float, decision_step: float) -> "AccAeb":
        """Return the same car with other steps of the motion and of the controller [s]."""
        return replace(self, time_step=time_step, decision_step=decision_step)

    def compiled(self) -> Car:
        """Return the parameters of the vehicle as numbers for the compiled simulation."""
        per_decision = round(self.decision_step / self.time_step)
        return self.numbers(
            Car, self.decision_step, self.time_step, step=self.time_step, per_decision=per_decision
        )


@VEHICLES.add("acc_only")
@dataclass(frozen=True)
class AccOnly(AccAeb):
    """The car `AccAeb` without AEB: ``aeb`` is fixed, and the other parameters of the AEB have no effect."""

    aeb: bool = field(default=False, init=False)
