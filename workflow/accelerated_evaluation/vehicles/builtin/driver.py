"""Base class of the reference drivers: the two cars, the lateral motion, and the simulation."""

import math
from dataclasses import dataclass
from typing import ClassVar

from accelerated_evaluation.scenarios.parameters import (
    check_parameters,
    numbers_of,
    parameter_error,
    zero_or_more,
)
from accelerated_evaluation.vehicles.builtin.driver_kernel import STEP, follow_slice
from accelerated_evaluation.vehicles.builtin.driver_numbers import Driver
from accelerated_evaluation.vehicles.builtin.traces import trace_driver
from accelerated_evaluation.vehicles.moving import CompiledVehicle

G = 9.81  # [m/s^2], as in JRC-FSM


@dataclass(frozen=True)
class ReferenceDriver(CompiledVehicle):
    """Base class of driver models with which an automated vehicle is compared.

    The models behave as in JRC-FSM, the code of the Joint Research Centre of the European Commission.

    The host starts at the speed lead speed + closing speed, without the limit of 35 m/s that the study's car
    has, and keeps this speed until the driver reacts. The driver only brakes, and neither steers nor
    accelerates again. The lead vehicle keeps its speed. An encounter is simulated for 34.8 s, in steps of
    0.1 s, in which the cars move with their speeds at the end of the step.

    There is a crash if the cars overlap laterally and the gap along the road is 0 or less. The smallest range
    and the smallest time to collision are those of all states until contact in which the cars overlap
    laterally and the host is behind; the smallest range also includes the initial range. If the contact
    occurs in the first state with overlap (from the side), the smallest time to collision is that of the
    approach before. The impact speed is host speed minus lead speed at contact. It is negative only if the
    other car moves sideways into a host that has braked to a lower speed next to it.

    By default the car that cuts in is in the host's lane from the start, and the range is the distance
    between the bumpers. With a ``lateral_speed``, the car comes from the lane on the left, and its lateral
    motion is simulated as well.
    """

    deterministic: ClassVar[bool] = True
    kernel: ClassVar = staticmethod(follow_slice)
    tracer: ClassVar = staticmethod(trace_driver)

    # Sideways speed of the other car [m/s]; 0 for a car that is in the lane from the start. If it is above 0,
    # the driver can react before the cut-in, or too late. Real cut-ins have speeds of 0.2 to 2 m/s.
    lateral_speed: float = zero_or_more(0.0)
    # Lateral distance of the centres [m] at which range and closing speed are given, if the other car moves
    # laterally: 3.5 for the start of its motion, 1.75 for its centre above the lane marking. If it is smaller
    # than `start_offset`, the simulation begins earlier. The initial range is then larger, by the distance
    # that the host closes in at the given closing speed.
    entry_offset: float = 3.5
    # Lateral distance of the centres before the lane change [m]. The default is a gap of 1.6 m between the
    # sides plus a width of 1.9 m (JRC-FSM), which corresponds to a lane of 3.5 m with both cars in the
    # middle.
    start_offset: float = 3.5
    length: float = 4.3  # of both cars [m] (JRC-FSM)
    width: float = 1.9  # of both cars [m] (JRC-FSM)

    def __post_init__(self) -> None:
        check_parameters(self)
        if self.entry_offset > self.start_offset:
            expected = f"at most start_offset = {self.start_offset:g} m"
            raise parameter_error("entry_offset", self.entry_offset, expected)
        if self.lateral_speed * STEP >= self.width:
            expected = f"less than {self.width / STEP:g} m/s, a car's width in a step"
            raise parameter_error("lateral_speed", self.lateral_speed, expected)

    def _numbers(self, rule: int, reaction_time: float, **others: float) -> Driver:
        """Return the parameters of the driver for the compiled code.

        The reaction time is rounded up to whole steps: 8 for 0.75 s, 4 for 0.35 s. The ``others`` are
        specific to the rule that detects danger.
        """
        steps = math.ceil(reaction_time / STEP - 1e-9)  # 0.3 / 0.1 is a little less than 3 in floating point
        return numbers_of(self, Driver, rule=rule, reaction_steps=steps, **others)._replace(rule=rule)
