"""Traces of encounters with built-in vehicles, computed by the compiled steps that also simulate batches."""

import numpy as np
import pandas as pd

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.vehicles.builtin import driver_kernel, human_kernel, kernel
from accelerated_evaluation.vehicles.builtin.driver_numbers import Driver
from accelerated_evaluation.vehicles.builtin.human_numbers import HumanNumbers
from accelerated_evaluation.vehicles.builtin.kernel import Car

# Positions are of the lead vehicle's rear and the host's front, which is at 0 at the start. The acceleration
# is that of the step before. "emergency" is 1 while the AEB is on, or while a driver sees danger.
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


def trace_car(car: Car, encounter: Array, lead_speeds: Array | None = None) -> pd.DataFrame:
    """Return the trace of one encounter of the ACC + AEB car.

    Parameters
    ----------
    car
        The car's numbers.
    encounter
        Checked lead speed [m/s], range [m] and closing speed [m/s], shape (3, 1).
    lead_speeds
        Checked lead speeds over time [m/s], shape (states,); None if the lead vehicle keeps its speed.

    Returns
    -------
    pandas.DataFrame
        One row for each state, columns as in COLUMNS. The controller no longer acts in the last state, so its
        time to collision is infinite, and its AEB state is that of the previous state.
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


def trace_driver(driver: Driver, encounter: Array) -> pd.DataFrame:
    """Return the trace of one encounter of a reference driver; arguments and result as for `trace_car`.

    With lateral motion the first state is the first step of that motion. The range is negative while the cars
    overlap along the road, and positive again when the other car is behind the host.
    """
    state = np.empty((driver_kernel.FIELDS, 1))
    driver_kernel.start(driver, encounter[:, 0], 0, state, 0)
    rows: list[tuple] = []
    while True:
        before = state[:, 0].copy()
        driver_kernel.skip(driver, state, 0)
        skipped = int(state[driver_kernel.STEPS, 0]) - len(rows)
        rows += [_driver_row(driver, before, k) for k in range(skipped)]
        for _ in range(driver_kernel.SWEEP):
            driver_kernel.watch(state, 1, driver)
            driver_kernel.decide(state, 1, driver)
            rows.append(_driver_row(driver, state[:, 0], 0))
            if state[driver_kernel.OVER, 0] > 0:
                trace = _table(rows)
                if driver.lateral_speed == 0.0:  # the range as it was given, before rounding
                    trace.loc[0, "range_m"] = min(trace.loc[0, "range_m"], encounter[1, 0])
                return trace
            driver_kernel.move(state, 1, driver)


def trace_moving_driver(driver: Driver, encounter: Array, lead_speeds: Array) -> pd.DataFrame:
    """Return the trace of a reference driver with a changing lead speed; see `trace_car`."""
    state, last = np.empty((driver_kernel.FIELDS, 1)), lead_speeds.size - 1
    driver_kernel.start(driver, encounter[:, 0], 0, state, 0)
    rows: list[tuple] = []
    while True:
        step = len(rows)
        state[driver_kernel.LEAD, 0] = lead_speeds[min(step, last)]
        driver_kernel.watch(state, 1, driver)
        driver_kernel.decide(state, 1, driver)
        rows.append(_driver_row(driver, state[:, 0], 0))
        touches = abs(state[driver_kernel.OFFSET, 0]) < driver.width
        touches &= abs(state[driver_kernel.DISTANCE, 0]) <= driver.length
        is_late = step >= min(last, driver_kernel.STATES - 1)
        if state[driver_kernel.OVER, 0] > 0 and (touches or is_late):
            return _table(rows, is_moving=True)
        state[driver_kernel.OVER, 0] = 0.0
        state[driver_kernel.LEAD, 0] = lead_speeds[min(step + 1, last)]
        driver_kernel.move(state, 1, driver)


def trace_human(
    numbers: HumanNumbers, encounter: Array, traits: Array, lead_speeds: Array | None = None
) -> pd.DataFrame:
    """Return the trace of one encounter of a human driver; other parameters and result as for `trace_car`.

    ``traits`` are those of the driver, shape (traits,). "emergency" is 1 while the driver brakes.
    """
    outcome, course = np.empty(5), np.empty((human_kernel.STEPS + 1, 5))
    if lead_speeds is None:
        count = human_kernel.follow(numbers, encounter[:, 0], traits, outcome, course)
    else:
        count = human_kernel.follow_motion(numbers, encounter[:, 0], lead_speeds, traits, outcome, course)
    rows = []
    for time, range_, closing, braking, sideways in course[:count]:
        lead = encounter[0, 0] if lead_speeds is None else human_kernel.lead_at(lead_speeds, time)
        ttc = range_ / closing if closing > 0 and range_ > 0 else np.inf
        rows.append((time, range_, sideways, lead, lead + closing, -braking, range_, ttc, braking > 0))
    return _table(rows, is_moving=lead_speeds is not None)


def _driver_row(driver: Driver, state: Array, k: int) -> tuple:
    """Return what the trace holds of a driver's state, or of that ``k`` steps later at constant speeds."""
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

    ``is_moving`` says that the lead vehicle changes its speed.
    """
    time, gap, offset, lead, *others, emergency = (np.array(column) for column in zip(*rows, strict=True))
    travelled = lead * time
    if is_moving:
        travelled = np.concatenate([[0.0], np.cumsum((lead[1:] + lead[:-1]) / 2 * np.diff(time))])
    lead_position = gap[0] + travelled
    columns = (time, lead_position, lead_position - gap, offset, lead, *others, emergency.astype(int))
    return pd.DataFrame(dict(zip(COLUMNS, columns, strict=True)))
