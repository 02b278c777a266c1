"""Traces (states over time) of encounters with built-in vehicles, from the code that simulates batches."""

import numpy as np
import pandas as pd

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.vehicles.builtin import driver_kernel, human_kernel, kernel
from accelerated_evaluation.vehicles.builtin.driver_numbers import Driver
from accelerated_evaluation.vehicles.builtin.human_kernel import HumanNumbers
from accelerated_evaluation.vehicles.builtin.kernel import Car

# Columns of a trace. Positions are those of the rear of the lead vehicle and of the front of the host, which
# starts at 0. The acceleration is that of the step before. "emergency" is 1 while the AEB is on, or while a
# driver perceives danger.
COLUMNS = (
    "time_s",
    "lead_position_m",
    "host_position_m",
    "lateral_distance_m",
    "lead_speed_m_per_s",
    "host_speed_m_per_s",
    "host_acceleration_m_per_s2",
    "range_m",
    "time_to_collision_s",
    "emergency",
)
STATE_OF_HUMAN = [getattr(human_kernel, name) for name in ("TIME", "RANGE", "SPEED", "NOW", "BRAKES")]
CONTACT_OF_HUMAN = [getattr(human_kernel, name) for name in ("TIME", "RANGE", "CLOSING", "BRAKES")]


def trace_car(car: Car, encounter: Array, lead_speeds: Array | None = None) -> pd.DataFrame:
    """Simulate one encounter of the ACC + AEB car, and return its states with the columns `COLUMNS`.

    The caller has checked the encounter, shape (3, 1), and the lead speeds. The controller does not act in
    the last state, where the time to collision is infinite and the AEB is in the state of the step before.
    """
    state, index = np.empty((kernel.FIELDS, 1)), np.zeros(1, dtype=np.int64)
    kernel.start(encounter, 0, 1, car, state, index)
    rows: list[tuple] = []
    step, over = 0, False
    while not over:
        over = step == kernel.STEPS or not (state[kernel.RANGE, 0] > 0 and state[kernel.SPEED, 0] > 0)
        lead, range_, speed = state[[kernel.LEAD, kernel.RANGE, kernel.SPEED], 0]
        acceleration, ttc = state[kernel.ACCELERATION, 0], np.inf
        if not over:
            kernel.watch(state, 1, car)
            ttc = range_ / (speed - lead) if speed > lead else np.inf
        emergency = state[kernel.TIMER, 0] > 0
        rows.append((step * kernel.STEP, range_, 0.0, lead, speed, acceleration, range_, ttc, emergency))
        kernel.command(state, 1, car)
        if lead_speeds is not None:
            state[kernel.LEAD, 0] = lead_speeds[step : step + 2].mean()
        kernel.move(state, 1, car)
        step += 1
        if lead_speeds is not None and not over:
            state[kernel.LEAD, 0] = lead_speeds[step]
    return _table(rows, is_moving=lead_speeds is not None)


def trace_driver(driver: Driver, encounter: Array, lead_speeds: Array | None = None) -> pd.DataFrame:
    """Simulate one encounter of a reference driver, and return its states with the columns `COLUMNS`.

    With lateral motion, the first state is the state after the first step of this motion. The range is
    negative while the cars overlap along the road, and positive again when the other car is behind the host.
    """
    state = np.empty((driver_kernel.FIELDS, 1))
    is_moving = lead_speeds is not None
    speeds = lead_speeds[None] if is_moving else encounter[:1]
    driver_kernel.start_encounter(driver, encounter[:, 0], 0, state, 0)
    rows: list[tuple] = []
    while True:
        before = state[:, 0].copy()
        if not is_moving:
            driver_kernel.skip(driver, state, 0)
        skipped = int(state[driver_kernel.STEPS, 0]) - len(rows)
        rows += [_driver_row(driver, before, k) for k in range(skipped)]
        for _ in range(driver_kernel.SWEEP):
            driver_kernel.observe(state, 1, driver, speeds)
            rows.append(_driver_row(driver, state[:, 0], 0))
            if state[driver_kernel.OVER, 0] > 0:
                trace = _table(rows, is_moving=is_moving)
                if driver.lateral_speed == 0.0:  # the range as it was given, before rounding
                    trace.loc[0, "range_m"] = min(trace.loc[0, "range_m"], encounter[1, 0])
                return trace
            driver_kernel.advance(state, 1, driver, speeds)


def trace_human(
    numbers: HumanNumbers, encounter: Array, traits: Array, lead_speeds: Array | None = None
) -> pd.DataFrame:
    """Simulate one encounter of a human driver, and return its states with the columns `COLUMNS`.

    The column "emergency" is 1 while the driver brakes.
    """
    state = np.empty((human_kernel.FIELDS, 1))
    course: list[tuple] = []
    speeds = encounter[0] if lead_speeds is None else lead_speeds
    human_kernel.start(numbers, encounter[:, 0], speeds, traits, state, 0)
    while len(course) < human_kernel.STEPS and state[human_kernel.OVER, 0] == 0:
        human_kernel.watch_lead(numbers, speeds, state, 0)
        time, range_, speed, lead, braking = state[STATE_OF_HUMAN, 0]
        since_response = time - state[human_kernel.ONSET, 0]
        sideways = numbers.car_width - human_kernel.overlap(numbers, traits, time, since_response)
        course.append((time, range_, speed - lead, braking, sideways))
        human_kernel.advance(numbers, state, 1, speeds.size - 1)
    if state[human_kernel.OVER, 0] == human_kernel.CONTACT:
        course.append((*state[CONTACT_OF_HUMAN, 0], 0.0))
    rows = []
    for time, range_, closing, braking, sideways in course:
        lead = human_kernel.lead_at(speeds, time)
        ttc = range_ / closing if closing > 0 and range_ > 0 else np.inf
        rows.append((time, range_, sideways, lead, lead + closing, -braking, range_, ttc, braking > 0))
    return _table(rows, is_moving=lead_speeds is not None)


def _driver_row(driver: Driver, state: Array, k: int) -> tuple:
    """Return the row of the trace for a state of a driver, or for the state ``k`` steps later.

    In these steps the speeds are constant.
    """
    lead, speed = state[driver_kernel.LEAD], state[driver_kernel.SPEED]
    closing = speed - lead
    ahead = state[driver_kernel.DISTANCE] - k * closing * driver_kernel.STEP
    sideways = min(k, max(state[driver_kernel.MOVING], 0.0)) * driver.lateral_speed * driver_kernel.STEP
    gap = abs(ahead) - driver.length
    closes = gap > 0 and closing > 0 and ahead > 0
    return (
        (state[driver_kernel.STEPS] + k) * driver_kernel.STEP,
        ahead - driver.length,
        state[driver_kernel.OFFSET] - sideways,
        lead,
        speed,
        state[driver_kernel.ACCELERATION],
        gap,
        gap / closing if closes else np.inf,
        state[driver_kernel.WANTED] > 0,
    )


def _table(rows: list[tuple], *, is_moving: bool = False) -> pd.DataFrame:
    """Return the states as a table, with the positions of both cars on the road.

    ``is_moving`` states whether the lead vehicle changes its speed.
    """
    time, gap, offset, lead, *others, emergency = (np.array(column) for column in zip(*rows, strict=True))
    travelled = lead * time
    if is_moving:
        travelled = np.concatenate([[0.0], np.cumsum((lead[1:] + lead[:-1]) / 2 * np.diff(time))])
    lead_position = gap[0] + travelled
    columns = (time, lead_position, lead_position - gap, offset, lead, *others, emergency.astype(int))
    return pd.DataFrame(dict(zip(COLUMNS, columns, strict=True)))
