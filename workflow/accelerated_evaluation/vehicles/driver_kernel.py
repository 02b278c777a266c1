"""The compiled reference drivers: CC, Reg157, RSS and FSM of UN R157 and its literature, one loop for all four.

A driver sees each state, decides on a deceleration, and the state moves on by one step of 0.1 s. Distances are
between the centres of two cars of equal length and width; gaps are between their edges. All compiled code of
the drivers is in this file, because numba's cache on disk only notices an edit of the file itself.

No driver ever speeds up. The loop uses this twice: an encounter ends as soon as the host, behind a car in its
lane, no longer closes in; and while a driver sees no danger, the steps until it will are taken at once.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from accelerated_evaluation.vehicles.kernel import compiled

STEP = 0.1  # [s], part of the model: the drivers' constants allow for it
STATES = 349  # states of an encounter that are tested for contact, which is a horizon of 34.8 s

TTC_RULE, RSS_RULE, FSM_RULE = range(3)

# The columns of a trace, one row a state: between the centres along and across the road, speed, reacting or not.
DISTANCE, OFFSET, SPEED, REACTS = range(4)


class Driver(NamedTuple):
    """The numbers that the compiled code needs of a reference driver, in SI units.

    A driver uses the numbers of its own rule; the others keep their defaults. The modules of the drivers say
    what each number means and where it comes from.
    """

    rule: int
    reaction_steps: int
    deceleration: float
    ramp_step: float  # growth of the deceleration in one step [m/s^2]; infinite without a limit
    lateral_speed: float
    start_offset: float
    entry_offset: float
    length: float
    width: float
    coasting: float = 0.0  # deceleration during the reaction
    forgets_ramp: bool = False  # whether the deceleration starts from 0 again after a release
    dropped_ttc: float = np.inf  # a car that overlaps beyond this TTC is outside the model, and no crash
    lateral_gap: float = 0.0
    critical_ttc: float = 0.0
    ttc_slope: float = 0.0  # growth of the critical TTC with the closing speed [s^2/m]
    response_time: float = 0.0
    response_acceleration: float = 0.0
    lateral_acceleration: float = 0.0
    host_braking: float = 1.0
    host_comfort_braking: float = 1.0
    lead_braking: float = 1.0
    margin: float = 0.0
    safe_margin: float = 0.0


@compiled
def _ttc_danger(driver: Driver, gap: float, lateral_gap: float, closing: float) -> bool:
    """CC and Reg157: the cars overlap, or nearly so, and the time to collision is critical."""
    critical = driver.critical_ttc + driver.ttc_slope * closing
    return lateral_gap <= driver.lateral_gap and abs(gap / closing) <= critical


@compiled
def _rss_distance(driver: Driver, speed: float, lead: float) -> float:
    """RSS: the safe distance in the lane, with the worst that both cars may do."""
    time, end_speed = driver.response_time, speed + driver.response_acceleration * driver.response_time
    travelled = speed * time + driver.response_acceleration * time**2 / 2
    return travelled + end_speed**2 / (2 * driver.host_braking) - lead**2 / (2 * driver.lead_braking)


@compiled
def _rss_danger(
    driver: Driver, gap: float, lateral_gap: float, speed: float, lead: float, lateral: float
) -> bool:
    """RSS: the distance is unsafe in both directions."""
    time, end_speed = driver.response_time, lateral + driver.lateral_acceleration * driver.response_time
    lateral_safe = driver.lateral_gap + (lateral + end_speed) * time / 2
    lateral_safe += end_speed**2 / (2 * driver.lateral_acceleration)
    return gap < _rss_distance(driver, speed, lead) and lateral_gap < lateral_safe


@compiled
def _membership(gap: float, safe: float, unsafe: float) -> float:
    """Fuzzy number of danger: 0 above the safe gap, 1 below the unsafe one, linear between them."""
    if gap >= safe:
        return 0.0
    return 1.0 if gap < unsafe else (gap - safe) / (unsafe - safe)


@compiled
def _fsm_proactive(driver: Driver, speed: float, lead: float) -> tuple[float, float]:
    """PFS: the safe and the unsafe gap if the lead vehicle brakes hard now, both with the margin to keep."""
    shared = speed * driver.response_time - lead**2 / (2 * driver.lead_braking) + driver.margin
    safe = shared + speed**2 / (2 * driver.host_comfort_braking) + driver.safe_margin
    return safe, shared + speed**2 / (2 * driver.host_braking)


@compiled
def _fsm_critical(driver: Driver, closing: float, acceleration: float) -> tuple[float, float]:
    """CFS: the safe and the unsafe gap if the lead vehicle keeps its speed; closing in [m/s]."""
    time, slowing = driver.response_time, max(acceleration, -driver.host_comfort_braking)
    left = closing + time * slowing  # the closing speed at the end of the response
    if left < 0.0:
        gap = closing**2 / abs(2 * acceleration)
        return gap, gap
    travelled = (closing + slowing * time / 2) * time
    safe = travelled + left**2 / (2 * driver.host_comfort_braking)
    return safe, travelled + left**2 / (2 * driver.host_braking)


@compiled
def _fsm_wanted(driver: Driver, gap: float, speed: float, lead: float, acceleration: float) -> float:
    """FSM: the deceleration for the larger of both dangers, of which the critical one counts first."""
    comfort = driver.host_comfort_braking
    if speed > lead:
        safe, unsafe = _fsm_critical(driver, speed - lead, acceleration)
        critical = _membership(gap, safe, unsafe)
        if critical > 0.0:
            return comfort + (driver.host_braking - comfort) * critical
    safe, unsafe = _fsm_proactive(driver, speed, lead)
    return comfort * _membership(gap, safe, unsafe)


@compiled
def _fsm_passes(driver: Driver, distance: float, lateral_gap: float, closing: float, lateral: float) -> bool:
    """FSM: whether the host will have passed a car beside its lane before that car reaches it."""
    if lateral_gap <= 0.0:
        return False
    return lateral <= 0.0 or lateral_gap / lateral > (abs(distance) + driver.length) / closing + STEP


@compiled
def _wanted(
    driver: Driver,
    distance: float,
    lateral_gap: float,
    speed: float,
    lead: float,
    lateral: float,
    acceleration: float,
) -> float:
    """Deceleration that the driver wants in this state [m/s^2]; 0 where it sees no danger."""
    gap, closing = abs(distance) - driver.length, speed - lead
    if distance < 0.0:  # the host has passed
        return 0.0
    if driver.rule == FSM_RULE:
        if _fsm_passes(driver, distance, lateral_gap, closing, lateral):
            return 0.0
        return min(_fsm_wanted(driver, gap, speed, lead, acceleration), driver.deceleration)
    if driver.rule == RSS_RULE:
        danger = _rss_danger(driver, gap, lateral_gap, speed, lead, lateral)
    else:
        danger = _ttc_danger(driver, gap, lateral_gap, closing)
    return driver.deceleration if danger else 0.0


@compiled
def _calm_steps(driver: Driver, gap: float, speed: float, lead: float) -> float:
    """Steps without danger that follow a state without danger, at constant speeds in one lane; rounded down."""
    closing = speed - lead
    if driver.rule == FSM_RULE:
        wake = max(_fsm_proactive(driver, speed, lead)[0], _fsm_critical(driver, closing, 0.0)[0])
    elif driver.rule == RSS_RULE:
        wake = _rss_distance(driver, speed, lead)
    else:
        wake = closing * (driver.critical_ttc + driver.ttc_slope * closing)
    return np.floor((gap - wake) / (closing * STEP))


@compiled
def _start(driver: Driver, range_: float, closing: float) -> tuple[float, float, int]:
    """Distance, lateral offset and steps of lateral motion in the first state.

    With lateral motion this state is one step after the car began to move sideways. Where the range is given
    at a later offset, the car began earlier, and was farther away by what the host has closed in since.
    """
    if driver.lateral_speed == 0.0:
        return range_ + driver.length, 0.0, 0
    since = (driver.start_offset - driver.entry_offset) / driver.lateral_speed
    steps = int(min(np.floor(driver.start_offset / STEP / driver.lateral_speed), STATES))
    offset = driver.start_offset - driver.lateral_speed * STEP
    return range_ + driver.length + max(closing, 0.0) * since - closing * STEP, offset, steps


@compiled
def _is_over(driver: Driver, distance: float, lateral_gap: float, closing: float) -> bool:
    """Whether no crash can follow: the host behind in the lane closes in no more, or it is ahead and faster."""
    gap = abs(distance) - driver.length
    if lateral_gap <= 0.0 and abs(gap / closing) > driver.dropped_ttc:
        return True
    if distance > 0.0:
        return lateral_gap < 0.0 and closing <= 0.0
    return gap > 0.0 and closing >= 0.0


@compiled
def _ttc(gap: float, closing: float) -> float:
    """Time to collision [s]; infinite where the cars do not close in, or touch already."""
    return gap / closing if gap > 0.0 and closing > 0.0 else np.inf


@compiled
def _react(driver: Driver, wanted: float, ramp: float, waited: int) -> tuple[float, float, int]:
    """Acceleration of the next step [m/s^2], the deceleration to grow from, and the steps of reaction so far."""
    if wanted <= 0.0:
        return 0.0, 0.0 if driver.forgets_ramp else ramp, waited
    if waited < driver.reaction_steps:
        return -driver.coasting, ramp, waited + 1
    ramp = min(ramp + driver.ramp_step, wanted)
    return -ramp, ramp, waited


@compiled
def _smallest(
    minima: tuple[float, float, float], overlaps: bool, behind: bool, gap: float, closing: float
) -> tuple[float, float, float]:
    """Smallest range, smallest TTC in the lane, and smallest TTC at all, this state included."""
    range_, lane_ttc, any_ttc = minima
    ttc = _ttc(gap, closing) if behind else np.inf
    if not overlaps:
        return range_, lane_ttc, min(any_ttc, ttc)
    return min(range_, gap) if behind or gap <= 0.0 else range_, min(lane_ttc, ttc), min(any_ttc, ttc)


@compiled
def follow(
    driver: Driver, lead: float, range_: float, closing: float, trace: NDArray
) -> tuple[bool, float, float, float, int]:
    """Simulate one encounter; return crash, min_range, min_ttc, impact_speed and the number of its states.

    Arguments are the driver's numbers, lead speed [m/s], range [m], closing speed [m/s], and an array that
    receives the states, shape (STATES, 4), or of shape (0, 4) where nobody asks for them.
    """
    distance, offset, moving = _start(driver, range_, closing)
    speed, acceleration, ramp, waited, step = lead + closing, 0.0, driver.coasting, 0, 0
    minima = (range_, np.inf, _ttc(range_, closing))
    while True:
        gap, lateral_gap, closing = abs(distance) - driver.length, abs(offset) - driver.width, speed - lead
        overlaps, behind, lateral = lateral_gap < 0.0, distance > 0.0, driver.lateral_speed * (moving > 0)
        minima = _smallest(minima, overlaps, behind, gap, closing)
        crash = overlaps and gap <= 0.0
        wanted = _wanted(driver, distance, lateral_gap, speed, lead, lateral, acceleration)
        over = crash or step + 1 >= STATES or _is_over(driver, distance, lateral_gap, closing)
        steps = 1
        if wanted <= 0.0 and overlaps and behind and not over:
            steps = int(max(1.0, min(_calm_steps(driver, gap, speed, lead), STATES - 1.0 - step)))
        for k in range(steps if len(trace) else 0):
            trace[step + k, DISTANCE] = distance - k * closing * STEP
            trace[step + k, OFFSET] = offset - min(k, moving) * driver.lateral_speed * STEP
            trace[step + k, SPEED], trace[step + k, REACTS] = speed, wanted > 0.0
        if over:
            break
        acceleration, ramp, waited = _react(driver, wanted, ramp, waited)
        speed = max(speed + acceleration * STEP, 0.0)
        distance -= steps * (speed - lead) * STEP
        offset -= min(steps, moving) * driver.lateral_speed * STEP
        moving -= min(steps, moving)
        step += steps
    min_ttc = minima[2] if crash and minima[1] == np.inf else minima[1]
    return crash, minima[0], min_ttc, speed - lead if crash else 0.0, step + 1


@compiled
def follow_slice(encounters: NDArray, begin: int, end: int, driver: Driver, outcomes: NDArray) -> None:
    """Simulate the columns ``begin`` to ``end`` of ``encounters``; arguments as in `kernel.simulate_slice`."""
    trace = np.empty((0, 4))
    for i in range(begin, end):
        crash, min_range, min_ttc, impact_speed, _ = follow(
            driver, encounters[0, i], encounters[1, i], encounters[2, i], trace
        )
        outcomes[0, i] = crash
        outcomes[1, i], outcomes[2, i], outcomes[3, i] = min_range, min_ttc, impact_speed
