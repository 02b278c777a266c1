"""Compiled simulation of the ACC + AEB car, in blocks of encounters that are simulated in parallel.

The array ``state`` of a block has a row for each quantity and a column (a lane) for each encounter. The
functions of a step update the first ``count`` lanes, and loops over lanes become vector instructions.
`tests/unit/reference_car.py` is a readable version of the same calculation, and the tests require that both
agree in every bit. All functions and constants of the compiled code are in this file, because numba's cache
on disk only notices changes of the file itself.

Loops over lanes read the state first and write it last, because LLVM compiles an early write of a minimum to
a masked store, which is slow. A step consists of three loops, because in a single loop the chain of
operations would be too long for the processor to overlap.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from accelerated_evaluation.scenarios.parameters import compiled

STEP = 0.1  # [s]; it is a part of the model, because smaller steps change outcomes
STEPS = 80  # number of these steps, for 8 s

LANES = 320  # number of encounters in a block; their state, 25.6 kB, stays in the level-1 cache
SWEEP = 8  # number of steps after which encounters that have ended are removed; a divisor of STEPS

# The rows of the state of a block. The timer is above 0 if the AEB was on in the last step.
LEAD, RANGE, SPEED, ACCELERATION, COMMAND, ERROR, TIMER, ONSET, MIN_RANGE, MIN_TTC = range(10)
FIELDS = 10


class Car(NamedTuple):
    """The parameters of an `AccAeb` for the compiled code, as floats in SI units."""

    top_start_speed: float
    headway: float
    kp: float
    ki_half_step: float
    acc_limit: float
    acc_top_speed: float
    threshold_base: float
    threshold_slope: float
    threshold_speed: float
    threshold_top: float
    release_ttc: float
    aeb_deceleration: float
    aeb_jerk: float
    friction_limit: float
    acceleration_step: float  # largest change of the acceleration in a step of the motion [m/s^2]
    step: float  # step of the motion [s]
    per_decision: float  # number of steps of the motion from one decision of the controller to the next


@compiled
def start(encounters: NDArray, first: int, count: int, car: Car, state: NDArray, index: NDArray) -> None:
    """Write the initial states of ``count`` encounters, from column ``first`` on, to the lanes of ``state``.

    The rows of ``encounters`` are lead speed [m/s], range [m] and closing speed [m/s]; ``index`` receives the
    column of the encounter in each lane.
    """
    for i in range(count):
        index[i] = first + i
        for field in range(FIELDS):
            state[field, i] = 0.0
        state[LEAD, i] = encounters[0, first + i]
        state[RANGE, i] = state[MIN_RANGE, i] = encounters[1, first + i]
        state[SPEED, i] = min(encounters[0, first + i] + encounters[2, first + i], car.top_start_speed)
        state[MIN_TTC, i] = np.inf


@compiled
def watch(state: NDArray, count: int, car: Car) -> None:
    """Update the smallest TTC, and switch the AEB on or off, in the first ``count`` columns of ``state``."""
    decision_step = car.step * car.per_decision
    for i in range(count):
        range_, speed, timer, min_ttc = state[RANGE, i], state[SPEED, i], state[TIMER, i], state[MIN_TTC, i]
        command, onset = state[COMMAND, i], state[ONSET, i]
        ttc = -range_ / (state[LEAD, i] - speed)  # -inf at equal speeds: not closing
        threshold = car.threshold_base + car.threshold_slope * (speed - car.threshold_speed)
        threshold = min(threshold, car.threshold_top)
        closing = ttc > 0.0
        was_on = timer > 0.0
        on = closing & ((ttc <= threshold) | (was_on & (ttc <= car.release_ttc)))
        running = (range_ > 0.0) & (speed > 0.0)
        state[TIMER, i] = timer + decision_step if on else 0.0
        state[ONSET, i] = onset if was_on else command
        state[MIN_TTC, i] = ttc if running & closing & (ttc < min_ttc) else min_ttc


@compiled
def command(state: NDArray, count: int, car: Car) -> None:
    """Write the acceleration that ACC or AEB commands [m/s^2] to the first ``count`` columns of ``state``.

    After a step with AEB, the last error of the time headway is 0 for the ACC.
    """
    for i in range(count):
        speed, command, last, timer = state[SPEED, i], state[COMMAND, i], state[ERROR, i], state[TIMER, i]
        error = car.headway - state[RANGE, i] / speed
        acc = command + car.kp * (error - last) + car.ki_half_step * (error + last)
        acc = min(max(acc, -car.acc_limit), 0.0 if speed >= car.acc_top_speed else car.acc_limit)
        aeb = max(state[ONSET, i] - car.aeb_jerk * timer, -car.aeb_deceleration)
        on = timer > 0.0
        state[COMMAND, i] = aeb if on else acc
        state[ERROR, i] = 0.0 if on else error


@compiled
def move(state: NDArray, count: int, car: Car) -> None:
    """Apply the actuator, and move the cars by one step, in the first ``count`` columns of ``state``.

    Encounters that have ended do not change.
    """
    step = car.step
    for i in range(count):
        lead, range_, speed, last = state[LEAD, i], state[RANGE, i], state[SPEED, i], state[ACCELERATION, i]
        min_range = state[MIN_RANGE, i]
        running = (range_ > 0.0) & (speed > 0.0)
        wanted = min(max(state[COMMAND, i], -car.friction_limit), car.friction_limit)
        acceleration = min(max(wanted, last - car.acceleration_step), last + car.acceleration_step)
        new_speed = max(speed + acceleration * step, 0.0)
        new_range = range_ + (lead - (speed + new_speed) / 2) * step
        new_range = new_range if running else range_
        state[ACCELERATION, i] = acceleration
        state[SPEED, i] = new_speed if running else speed
        state[RANGE, i] = new_range
        state[MIN_RANGE, i] = new_range if new_range < min_range else min_range


@compiled
def _sweep(state: NDArray, index: NDArray, count: int, over: bool, outcomes: NDArray) -> int:
    """Write the outcomes of encounters that have ended, and return the number of the others.

    The lanes of encounters that have ended are filled with encounters from the last lanes.
    """
    i = 0
    while i < count:
        if not over and state[RANGE, i] > 0.0 and state[SPEED, i] > 0.0:
            i += 1
            continue
        crash = state[RANGE, i] <= 0.0
        outcomes[0, index[i]] = crash
        outcomes[1, index[i]] = state[MIN_RANGE, i]
        outcomes[2, index[i]] = state[MIN_TTC, i]
        outcomes[3, index[i]] = max(state[SPEED, i] - state[LEAD, i], 0.0) if crash else 0.0
        count -= 1
        index[i] = index[count]
        for field in range(FIELDS):
            state[field, i] = state[field, count]
    return count


@compiled
def _follow_lead(state: NDArray, index: NDArray, count: int, speeds: NDArray, first: int, last: int) -> None:
    """Set the lead speeds in ``count`` lanes to the means of their ``speeds``, (n, steps), at two steps."""
    for i in range(count):
        state[LEAD, i] = (speeds[index[i], first] + speeds[index[i], last]) / 2


@compiled
def simulate_slice(
    encounters: NDArray, begin: int, end: int, car: Car, lead_speeds: NDArray, outcomes: NDArray
) -> None:
    """Simulate the columns ``begin`` to ``end`` (excluded) of ``encounters``, independently of each other.

    The rows of ``encounters`` are lead speed [m/s], range [m] and closing speed [m/s]. ``lead_speeds`` [m/s]
    are those at every step, shape (n, steps + 1), or (n, 1) if the lead vehicles keep their speeds. Within a
    step a lead vehicle moves with the mean of its speeds at both ends of the step. ``outcomes``, shape (4,
    n), receives crash (0 or 1), min_range [m], min_ttc [s] and impact_speed [m/s].
    """
    state = np.empty((FIELDS, LANES))
    index = np.empty(LANES, np.int64)
    is_moving = lead_speeds.shape[1] > 1
    steps, per_decision = round(STEPS * STEP / car.step), int(car.per_decision)
    for first in range(begin, end, LANES):
        count = min(LANES, end - first)
        start(encounters, first, count, car, state, index)
        step = 0
        while count > 0:
            step += 1
            if (step - 1) % per_decision == 0:
                watch(state, count, car)
                command(state, count, car)
            if is_moving:
                _follow_lead(state, index, count, lead_speeds, step - 1, step)
            move(state, count, car)
            if is_moving:
                _follow_lead(state, index, count, lead_speeds, step, step)
            if is_moving or step % SWEEP == 0:  # the lead speed at the end of an encounter must not change
                count = _sweep(state, index, count, step == steps, outcomes)
