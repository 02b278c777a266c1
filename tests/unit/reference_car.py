"""Readable NumPy implementation of the ACC + AEB car, with which the compiled code must agree in every bit.

Agreement up to rounding errors would not be enough. Far behind the lead vehicle at a low speed, the control
loop of the ACC is unstable, so that another order of the same operations changes the smallest range by a
centimetre.
"""

import numpy as np
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.vehicles.builtin.acc_aeb import V60_SPEEDS, V60_TTC, AccAeb
from accelerated_evaluation.vehicles.builtin.kernel import STEP, STEPS
from accelerated_evaluation.vehicles.protocol import Outcomes
from numpy.typing import ArrayLike, NDArray


@np.errstate(divide="ignore", invalid="ignore", over="ignore")
def simulate(car: AccAeb, lead_speed: ArrayLike, range_: ArrayLike, closing_speed: ArrayLike) -> Outcomes:
    """Return the outcomes of n cut-ins for the car with given parameters.

    Lead speed [m/s], range [m] and closing speed [m/s] at the start have shape (n,).

    An encounter ends with a crash when the range is 0 or less. It ends without a crash when the host stands
    still, and after 8 s.
    """
    lead_speed, range_, closing_speed = CUT_IN.checked(lead_speed, range_, closing_speed)
    speed = np.minimum(lead_speed + closing_speed, car.top_start_speed)
    acceleration = command = error = timer = onset = np.zeros_like(speed)
    on = np.zeros(speed.shape, dtype=bool)
    min_range, min_ttc = range_, np.full_like(range_, np.inf)
    step, per_decision = car.time_step, round(car.decision_step / car.time_step)
    for number in range(round(STEPS * STEP / step)):
        running = (range_ > 0) & (speed > 0)

        if number % per_decision == 0:
            ttc = time_to_collision(lead_speed, range_, speed)
            min_ttc = np.where(running & (ttc > 0) & (ttc < min_ttc), ttc, min_ttc)

            was_on, on = on, aeb_switch(car, ttc, speed, on)
            last_error, error = np.where(was_on, 0, error), car.headway - range_ / speed
            onset = np.where(on & ~was_on, command, onset)
            timer = np.where(was_on, timer, 0) + step * per_decision
            command = np.where(
                on, aeb_command(car, onset, timer), acc_command(car, speed, command, error, last_error)
            )

        acceleration = actuator(car, command, acceleration)
        new_speed = np.maximum(speed + acceleration * step, 0)
        new_range = range_ + (lead_speed - (speed + new_speed) / 2) * step
        speed = np.where(running, new_speed, speed)
        range_ = np.where(running, new_range, range_)
        min_range = np.where(range_ < min_range, range_, min_range)
    crash = range_ <= 0
    impact_speed = np.where(crash, np.maximum(speed - lead_speed, 0), 0)
    return Outcomes(crash, min_range, min_ttc, impact_speed)


def time_to_collision(lead_speed: Array, range_: Array, speed: Array) -> Array:
    """Return the range divided by the closing speed [s]; negative if the gap opens, -inf at equal speeds."""
    range_rate = lead_speed - speed
    return np.where(range_rate == 0, -np.inf, -range_ / range_rate)


def aeb_threshold(car: AccAeb, speed: Array) -> Array:
    """Return the time to collision at which the AEB switches on [s], given the speed of the host [m/s].

    With the published threshold it is linear in the speed up to 40 km/h, and then constant.
    """
    if not car.aeb or car.aeb_ttc is not None:
        return np.full_like(speed, car.threshold_top)
    slope = (V60_TTC[1] - V60_TTC[0]) / (V60_SPEEDS[1] - V60_SPEEDS[0])
    return np.minimum(V60_TTC[0] + slope * (speed - V60_SPEEDS[0]), V60_TTC[1])


def aeb_switch(car: AccAeb, ttc: Array, speed: Array, was_on: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return whether the AEB is on, given TTC [s], speed [m/s], and whether it was on in the last step.

    The AEB switches on when the TTC falls to the threshold. It stays on until the TTC is negative or above
    ``aeb_release_ttc``.
    """
    switches_on = (ttc > 0) & (ttc <= aeb_threshold(car, speed))
    stays_on = was_on & (ttc > 0) & (ttc <= car.aeb_release_ttc)
    return switches_on | stays_on


def acc_command(car: AccAeb, speed: Array, command: Array, error: Array, last_error: Array) -> Array:
    """Return the acceleration that the ACC commands [m/s^2], by proportional-integral control.

    Parameters
    ----------
    car
        Parameters of the car.
    speed
        Speed of the host [m/s].
    command
        Acceleration commanded in the last step [m/s^2].
    error, last_error
        Error of the time headway [s] in this and in the last step.
    """
    command = command + car.kp * (error - last_error) + car.ki * car.decision_step / 2 * (error + last_error)
    top = np.where(speed >= car.acc_top_speed, 0, car.acc_limit)
    return np.minimum(np.maximum(command, -car.acc_limit), top)


def aeb_command(car: AccAeb, onset: Array, timer: Array) -> Array:
    """Return the acceleration that the AEB commands [m/s^2].

    Parameters
    ----------
    car
        Parameters of the car.
    onset
        Acceleration that was commanded when the AEB switched on [m/s^2].
    timer
        Time since the AEB switched on [s].
    """
    return np.maximum(onset - car.aeb_jerk * timer, -car.aeb_deceleration)


def actuator(car: AccAeb, command: Array, acceleration: Array) -> Array:
    """Return the new acceleration [m/s^2], which follows the command within limits of friction and jerk.

    ``command`` and ``acceleration`` are the commanded and the present acceleration [m/s^2].
    """
    possible = np.minimum(np.maximum(command, -car.friction_limit), car.friction_limit)
    change = car.actuator_jerk * car.time_step
    return np.minimum(np.maximum(possible, acceleration - change), acceleration + change)
