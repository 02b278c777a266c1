"""Compiled simulation of the reference drivers CC, Reg157, RSS and FSM, in blocks as in `kernel`.

In each step of 0.1 s a driver sees the state and chooses a deceleration. Distances are between the centres of
two cars of equal length and width; gaps are between their edges. All compiled code of the drivers is in this
file, because numba's cache on disk only notices changes of the file itself.

No driver accelerates. The code uses this in two ways. An encounter ends as soon as the host, behind a car in
its lane, does not close in any more. And the steps before the first danger are computed at once.

The array ``state`` of a block has a row for each quantity and a column (a lane) for each encounter. The
functions update the first ``count`` lanes, or lane ``i``; ``driver`` has the parameters of the driver.

The functions for one encounter become vector instructions in a loop over lanes. For this purpose they compute
both sides of a choice, and multiply instead of dividing if possible, because divisions are slow.
"""

import numpy as np
from numpy.typing import NDArray

from accelerated_evaluation.vehicles.builtin.driver_numbers import FSM_RULE, RSS_RULE, Driver
from accelerated_evaluation.vehicles.builtin.kernel import compiled

STEP = 0.1  # [s]; it is a part of the model, because constants of the drivers allow for it
STATES = 349  # number of states of an encounter that are tested for contact, for 34.8 s

LANES = 256  # number of encounters in a block; their state stays in the level-1 cache
SWEEP = 8  # number of steps after which encounters that have ended are replaced by new ones

SMALLEST = 5e-324  # the smallest positive number

# The rows of the state of a block. Distance and offset are between the centres, along and across the road.
# WAITED is the number of steps of the reaction time that have passed, MOVING the number of steps of lateral
# motion that remain.
LEAD, DISTANCE, OFFSET, SPEED, ACCELERATION, RAMP, WAITED, MOVING = range(8)
STEPS, WANTED, OVER, MIN_RANGE, LANE_TTC, ANY_TTC, INDEX = range(8, 15)
FIELDS = 15


@compiled
def _ttc_wanted(driver: Driver, gap: float, lateral_gap: float, closing: float) -> float:
    """Return the deceleration that CC and Reg157 choose [m/s^2].

    It is the full deceleration if the cars (almost) overlap laterally and the TTC is critical, otherwise 0.
    """
    critical = driver.critical_ttc + driver.ttc_slope * closing
    danger = (lateral_gap <= driver.lateral_gap) & (abs(gap) <= abs(closing) * critical)
    return driver.deceleration if danger else 0.0


@compiled
def _rss_distance(driver: Driver, speed: float, lead: float) -> float:
    """Return the longitudinal safe distance of RSS [m], if host and lead vehicle behave in the worst way."""
    time, end_speed = driver.response_time, speed + driver.response_acceleration * driver.response_time
    response = (speed + end_speed) * time / 2
    return response + end_speed * end_speed * driver.host_path - lead * lead * driver.lead_path


@compiled
def _rss_wanted(
    driver: Driver, gap: float, lateral_gap: float, speed: float, lead: float, lateral: float
) -> float:
    """Return the deceleration that RSS chooses: full if the distance is unsafe in both directions, else 0."""
    time, end_speed = driver.response_time, lateral + driver.lateral_acceleration * driver.response_time
    lateral_safe = driver.lateral_gap + (lateral + end_speed) * time / 2
    lateral_safe += end_speed * end_speed * driver.lateral_path
    danger = (gap < _rss_distance(driver, speed, lead)) & (lateral_gap < lateral_safe)
    return driver.deceleration if danger else 0.0


@compiled
def _fsm_proactive(driver: Driver, speed: float, lead: float) -> tuple[float, float]:
    """Return the safe and the unsafe gap [m] for the proactive fuzzy number of FSM.

    The lead vehicle is assumed to brake hard now. Both gaps include the margin.
    """
    shared = speed * driver.response_time - lead * lead * driver.lead_path + driver.margin
    safe = shared + speed * speed * driver.comfort_path + driver.safe_margin
    return safe, shared + speed * speed * driver.host_path


@compiled
def _fsm_critical(driver: Driver, closing: float, acceleration: float) -> tuple[float, float, float]:
    """Return the safe and the unsafe gap [m] for the critical fuzzy number of FSM, and a closing speed [m/s].

    The lead vehicle is assumed to keep its speed. The closing speed is that at the end of the response.
    """
    time, slowing = driver.response_time, max(acceleration, -driver.comfort)
    left = closing + time * slowing  # at the end of the response
    travelled = (closing + left) * time / 2
    square = left * left
    return travelled + square * driver.comfort_path, travelled + square * driver.host_path, left


@compiled
def _fsm_wanted(
    driver: Driver,
    distance: float,
    gap: float,
    lateral_gap: float,
    speed: float,
    lead: float,
    lateral: float,
    acceleration: float,
) -> float:
    """Return the deceleration that FSM chooses [m/s^2], from the critical or the proactive fuzzy number.

    A fuzzy number is 0 for gaps above the safe gap, 1 for gaps below the unsafe gap, and linear between them.
    If the host loses all its closing speed during the response, the critical number is 0 or 1. The proactive
    number is used only if the critical one is 0.

    A car next to the lane is no danger if it does not come nearer, or if the host will have passed before it
    arrives; one step is added to the time of the host.
    """
    closing = speed - lead
    arrives = lateral_gap * closing <= (distance + driver.length + STEP * closing) * lateral
    arrives = (lateral_gap <= 0.0) | ((lateral > 0.0) & (closing >= 0.0) & arrives)
    critical_safe, critical_unsafe, left = _fsm_critical(driver, closing, acceleration)
    too_late = gap * -2.0 * acceleration < closing * closing
    critical = (closing > 0.0) & (gap < critical_safe if left >= 0.0 else too_late)
    proactive_safe, proactive_unsafe = _fsm_proactive(driver, speed, lead)
    safe = critical_safe if critical else proactive_safe
    unsafe = critical_unsafe if critical else proactive_unsafe
    fuzzy = 0.0 if gap >= safe else 1.0 if gap <= unsafe else (gap - safe) / (unsafe - safe)
    fuzzy = 1.0 if critical & (left < 0.0) else fuzzy
    wanted = driver.comfort + driver.comfort_to_full * fuzzy if critical else driver.comfort * fuzzy
    return min(wanted, driver.deceleration) if arrives else 0.0


@compiled
def _wake_gap(driver: Driver, speed: float, lead: float) -> float:
    """Return the gap [m] at which a driver first perceives danger, at constant speeds in the same lane."""
    closing = speed - lead
    if driver.rule == FSM_RULE:
        return max(_fsm_proactive(driver, speed, lead)[0], _fsm_critical(driver, closing, 0.0)[0])
    if driver.rule == RSS_RULE:
        return _rss_distance(driver, speed, lead)
    return closing * (driver.critical_ttc + driver.ttc_slope * closing)


@compiled
def _ttc(gap: float, closing: float) -> float:
    """Return the time to collision [s], which is above 0; infinite without closing, or after contact."""
    return max(gap / closing, SMALLEST) if (gap > 0.0) & (closing > 0.0) else np.inf


@compiled
def start_encounter(driver: Driver, encounter: NDArray, index: int, state: NDArray, i: int) -> None:
    """Write the initial state of an encounter to column ``i`` (a lane) of the array ``state``.

    The encounter is given by lead speed [m/s], range [m] and closing speed [m/s], and by its ``index``, which
    is the column of its outcomes.

    With lateral motion, the first state is one step after the other car began to move laterally. If the range
    is given at a smaller offset, the motion began earlier, and the initial range is larger by the distance
    that the host closed in since then.
    """
    lead, range_, closing = encounter
    state[:, i] = 0.0
    distance, offset, moving = range_ + driver.length, 0.0, 0.0
    if driver.lateral_speed > 0.0:
        since = (driver.start_offset - driver.entry_offset) / driver.lateral_speed
        distance += max(closing, 0.0) * since - closing * STEP
        offset = driver.start_offset - driver.lateral_speed * STEP
        moving = np.floor(driver.start_offset / STEP / driver.lateral_speed)
    state[LEAD, i], state[SPEED, i] = lead, lead + closing
    state[DISTANCE, i], state[OFFSET, i], state[MOVING, i] = distance, offset, moving
    state[RAMP, i], state[INDEX, i] = driver.coasting, index
    state[MIN_RANGE, i], state[LANE_TTC, i], state[ANY_TTC, i] = range_, np.inf, _ttc(range_, closing)


@compiled
def skip(driver: Driver, state: NDArray, i: int) -> None:
    """Advance encounter ``i`` of the array ``state`` by all steps before the driver first perceives danger.

    This is possible if the other car is in the lane of the host, because speeds are constant until then.
    """
    if state[STEPS, i] > 0.0 and driver.lateral_speed == 0.0:  # these steps were skipped before
        return
    if state[WAITED, i] > 0.0 or state[WANTED, i] > 0.0:  # after the first danger, few steps could be skipped
        return
    lead, speed, distance = state[LEAD, i], state[SPEED, i], state[DISTANCE, i]
    gap, closing = distance - driver.length, speed - lead
    if abs(state[OFFSET, i]) >= driver.width or closing <= 0.0:
        return
    wake = _wake_gap(driver, speed, lead)
    if gap > 0.0 and gap > wake:
        left = STATES - 1.0 - state[STEPS, i]
        steps = max(0.0, min(np.floor((gap - wake) / (closing * STEP)), left))
        state[STEPS, i] += steps
        state[DISTANCE, i] -= steps * closing * STEP
        state[OFFSET, i] -= min(steps, max(state[MOVING, i], 0.0)) * driver.lateral_speed * STEP
        state[MOVING, i] -= steps


@compiled
def watch_outcomes(state: NDArray, count: int, driver: Driver) -> None:
    """Update smallest range and TTC of the first ``count`` encounters of ``state``; mark those that are over.

    An encounter is over after a crash, at the end of the simulated time, or if there can be no danger any
    more.
    """
    for i in range(count):
        distance, offset, steps = state[DISTANCE, i], state[OFFSET, i], state[STEPS, i]
        over, min_range = state[OVER, i] > 0.0, state[MIN_RANGE, i]
        lane_ttc, any_ttc = state[LANE_TTC, i], state[ANY_TTC, i]
        gap, lateral_gap = abs(distance) - driver.length, abs(offset) - driver.width
        closing = state[SPEED, i] - state[LEAD, i]
        behind, overlaps = distance > 0.0, (lateral_gap < 0.0) & ~over
        crash = overlaps & (gap <= 0.0)
        ttc = _ttc(gap, closing) if behind & ~over else np.inf
        dropped = (lateral_gap <= 0.0) & (abs(gap) > abs(closing) * driver.dropped_ttc)
        no_more = overlaps & (closing <= 0.0) if behind else (gap > 0.0) & (closing >= 0.0)
        state[MIN_RANGE, i] = min(min_range, gap) if overlaps & (behind | crash) else min_range
        state[LANE_TTC, i] = min(lane_ttc, ttc) if overlaps else lane_ttc
        state[ANY_TTC, i] = min(any_ttc, ttc)
        state[OVER, i] = 1.0 if over | crash | dropped | no_more | (steps + 1.0 >= STATES) else 0.0


@compiled
def decide(state: NDArray, count: int, driver: Driver) -> None:
    """Write the deceleration that the driver chooses [m/s^2] to the first ``count`` columns of ``state``.

    The deceleration is 0 without danger.
    """
    for i in range(count):
        distance, speed, lead, acceleration = (
            state[DISTANCE, i],
            state[SPEED, i],
            state[LEAD, i],
            state[ACCELERATION, i],
        )
        lateral = driver.lateral_speed if state[MOVING, i] > 0.0 else 0.0
        gap, lateral_gap = abs(distance) - driver.length, abs(state[OFFSET, i]) - driver.width
        if driver.rule == FSM_RULE:
            wanted = _fsm_wanted(driver, distance, gap, lateral_gap, speed, lead, lateral, acceleration)
        elif driver.rule == RSS_RULE:
            wanted = _rss_wanted(driver, gap, lateral_gap, speed, lead, lateral)
        else:
            wanted = _ttc_wanted(driver, gap, lateral_gap, speed - lead)
        state[WANTED, i] = wanted if distance >= 0.0 else 0.0


@compiled
def move_cars(state: NDArray, count: int, driver: Driver) -> None:
    """Advance the first ``count`` encounters of the array ``state`` by 0.1 s; ended ones do not change."""
    for i in range(count):
        wanted, ramp, waited, speed = state[WANTED, i], state[RAMP, i], state[WAITED, i], state[SPEED, i]
        moving, distance, offset = state[MOVING, i], state[DISTANCE, i], state[OFFSET, i]
        steps, runs = state[STEPS, i], state[OVER, i] == 0.0
        danger, reacts = wanted > 0.0, waited < driver.reaction_steps
        braking = min(ramp + driver.ramp_step, wanted)
        acceleration = (-driver.coasting if reacts else -braking) if danger else 0.0
        calm_ramp = 0.0 if driver.forgets_ramp else ramp
        new_speed = max(speed + acceleration * STEP, 0.0)
        new_distance = distance - (new_speed - state[LEAD, i]) * STEP
        new_offset = offset - driver.lateral_speed * STEP if moving > 0.0 else offset
        state[RAMP, i] = (ramp if reacts else braking) if danger else calm_ramp
        state[WAITED, i] = waited + 1.0 if danger & reacts else waited
        state[MOVING, i] = moving - 1.0
        state[ACCELERATION, i] = acceleration
        state[STEPS, i] = steps + 1.0 if runs else steps
        state[SPEED, i] = new_speed if runs else speed
        state[DISTANCE, i] = new_distance if runs else distance
        state[OFFSET, i] = new_offset if runs else offset


@compiled
def _follow_lead(state: NDArray, count: int, lead_speeds: NDArray, ahead: int) -> None:
    """Set the lead speed in the state of each encounter that is not over.

    It becomes the lead speed ``ahead`` steps after the step that the state has reached.
    """
    last = lead_speeds.shape[1] - 1
    for i in range(count):
        if state[OVER, i] == 0.0:
            state[LEAD, i] = lead_speeds[int(state[INDEX, i]), min(int(state[STEPS, i]) + ahead, last)]


@compiled
def _reopen(state: NDArray, count: int, last: int, driver: Driver) -> None:
    """Continue encounters without contact that `watch_outcomes` ended before the step ``last``.

    Until then the lead vehicle may change its speed, so that a host which does not close in can do so later.
    """
    for i in range(count):
        touches = abs(state[OFFSET, i]) < driver.width and abs(state[DISTANCE, i]) <= driver.length
        if not touches and state[STEPS, i] < min(last, STATES - 1):
            state[OVER, i] = 0.0


@compiled
def observe(state: NDArray, count: int, driver: Driver, lead_speeds: NDArray) -> None:
    """Update the first ``count`` encounters by what happens in a state, and let the drivers decide."""
    last = lead_speeds.shape[1] - 1
    if last > 0:
        _follow_lead(state, count, lead_speeds, 0)
    watch_outcomes(state, count, driver)
    if last > 0:
        _reopen(state, count, last, driver)
    decide(state, count, driver)


@compiled
def advance(state: NDArray, count: int, driver: Driver, lead_speeds: NDArray) -> None:
    """Advance the first ``count`` encounters by 0.1 s, at the speeds at the end of the step."""
    if lead_speeds.shape[1] > 1:
        _follow_lead(state, count, lead_speeds, 1)
    move_cars(state, count, driver)


@compiled
def _finish(state: NDArray, i: int, driver: Driver, outcomes: NDArray) -> None:
    """Write the outcomes of the encounter in lane ``i``, which is over."""
    index = int(state[INDEX, i])
    overlaps = abs(state[OFFSET, i]) < driver.width
    crash = overlaps and abs(state[DISTANCE, i]) <= driver.length
    min_ttc = state[LANE_TTC, i]
    outcomes[0, index], outcomes[1, index] = crash, state[MIN_RANGE, i]
    outcomes[2, index] = state[ANY_TTC, i] if crash and min_ttc == np.inf else min_ttc
    outcomes[3, index] = state[SPEED, i] - state[LEAD, i] if crash else 0.0


@compiled
def _exchange(
    state: NDArray,
    count: int,
    encounters: NDArray,
    upcoming: int,
    end: int,
    driver: Driver,
    is_moving: bool,
    outcomes: NDArray,
) -> tuple[int, int]:
    """Replace the encounters that are over by new ones.

    Return the number of lanes in use, and the column of the next new encounter.
    """
    i = 0
    while i < count or (count < LANES and upcoming < end):
        if i < count and state[OVER, i] == 0.0:
            if not is_moving:
                skip(driver, state, i)
            i += 1
            continue
        if i < count:
            _finish(state, i, driver, outcomes)
        if upcoming < end:
            start_encounter(driver, encounters[:, upcoming], upcoming, state, i)
            upcoming += 1
            count = max(count, i + 1)
            if not is_moving:
                skip(driver, state, i)
            i += 1
        else:
            count -= 1
            state[:, i] = state[:, count]
    return count, upcoming


@compiled
def follow_slice(
    encounters: NDArray, begin: int, end: int, driver: Driver, lead_speeds: NDArray, outcomes: NDArray
) -> None:
    """Simulate the columns ``begin`` to ``end`` of ``encounters``, excluding ``end``.

    The rows of ``encounters``, shape (3, n), are lead speed [m/s], range [m] and closing speed [m/s].
    ``lead_speeds`` [m/s] are those every 0.1 s, shape (n, states), or shape (n, 1) if the lead vehicles keep
    their speeds; after the last of them the lead vehicle keeps its speed. The outcomes crash (0 or 1),
    min_range [m], min_ttc [s] and impact_speed [m/s] are written to the columns of ``outcomes``, shape (4,
    n).
    """
    state, is_moving = np.empty((FIELDS, LANES)), lead_speeds.shape[1] > 1
    count, upcoming = 0, begin
    while True:
        count, upcoming = _exchange(state, count, encounters, upcoming, end, driver, is_moving, outcomes)
        if count == 0:
            return
        for _ in range(SWEEP):
            observe(state, count, driver, lead_speeds)
            advance(state, count, driver, lead_speeds)
