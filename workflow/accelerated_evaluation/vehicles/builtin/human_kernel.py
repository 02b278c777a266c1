"""Compiled simulation of cut-ins with a human driver: response, braking and swerving.

The time is 0 when the other car crosses the lane marking. The range is the distance of the bumpers. Until the
driver responds, the host keeps its speed.

In all functions ``numbers`` are the parameters that all drivers share (`HumanNumbers`), ``traits`` are the
traits of the driver, shape (traits,), and ``range_`` [m] and ``closing`` [m/s] are range and closing speed.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from accelerated_evaluation.scenarios.parameters import compiled

# The traits of a driver, which differ from driver to driver:
# - RESPONSE: factor of the response time;
# - NOTICE: share of the way from the earliest to the latest drift at which the driver notices the other car;
# - DURATION: duration of the other car's lane change [s];
# - BRAKING, JERK: largest deceleration that the driver uses [m/s^2], and rate at which it increases [m/s^3];
# - SWERVE, SWERVE_WIDTH: lateral acceleration of a swerve [m/s^2], 0 for a driver who does not swerve, and
#   lateral displacement of the swerve [m].
TRAITS = RESPONSE, NOTICE, DURATION, BRAKING, JERK, SWERVE, SWERVE_WIDTH = range(7)
STEP = 0.1  # [s], as for the other vehicles
STEPS = 348  # number of steps, for 34.8 s as for the reference drivers
LANES = 256  # number of encounters in a block; their state stays in the level-1 cache
SWEEP = 8  # number of steps after which encounters that are over are removed
ENDED, CONTACT = 1.0, 2.0  # why an encounter is over
# The rows of the state of a block. The columns (lanes) are encounters, as in `kernel`.
TIME, RANGE, SPEED, CLOSING, BRAKES, TARGET, ONSET, MARGIN, STRONGEST, RISE = range(10)
NOW, SEEN, NEXT, OVER, MIN_RANGE, MIN_TTC, HARDEST = range(10, 17)
FIELDS = 17


class HumanNumbers(NamedTuple):
    """The parameters that all drivers share, in SI units; they are explained in `human.Human`."""

    urgent_response: float
    calm_response: float
    urgency_slope: float
    earliest_drift: float
    latest_drift: float
    lane_width: float
    car_width: float
    margin: float
    hard_braking: float
    delay: float


@compiled
def head_start(numbers: HumanNumbers, traits: NDArray) -> float:
    """Return the time [s] between noticing the other car's drift and its crossing of the lane marking.

    The lateral path of the lane change is half a period of a cosine, and the crossing is in its middle.
    """
    drift = numbers.earliest_drift + traits[NOTICE] * (numbers.latest_drift - numbers.earliest_drift)
    return traits[DURATION] * (0.5 - math.acos(1.0 - 2.0 * drift / numbers.lane_width) / math.pi)


@compiled
def response_time(numbers: HumanNumbers, traits: NDArray, range_: float, closing: float) -> float:
    """Return the response time [s] of a driver, given range [m] and closing speed [m/s] at the crossing.

    The mean response time is an exponential function of the inverse time to collision.
    """
    urgency = math.exp(-numbers.urgency_slope * max(closing, 0.0) / range_)
    mean = numbers.urgent_response + (numbers.calm_response - numbers.urgent_response) * urgency
    return mean * traits[RESPONSE]


@compiled
def wanted(numbers: HumanNumbers, strongest: float, margin: float, range_: float, closing: float) -> float:
    """Return the deceleration [m/s^2] that the driver intends, given range [m] and closing speed [m/s].

    It is the deceleration that ends the approach at a range equal to ``margin`` [m]. If this deceleration is
    at least ``hard_braking``, the driver brakes with the ``strongest`` deceleration that this driver uses.
    """
    left, square = range_ - margin, closing * closing
    is_hard = (left <= 0.0) | (square >= 2.0 * left * numbers.hard_braking)
    needed = strongest if is_hard else min(square / (2.0 * left), strongest)
    return needed if closing > 0.0 else 0.0


@compiled
def overlap(numbers: HumanNumbers, traits: NDArray, time: float, since_response: float) -> float:
    """Return the lateral overlap of the two cars [m], which a swerve of the host reduces.

    ``time`` [s] is the time since the crossing, and ``since_response`` [s] the time since the response.
    """
    phase = math.pi * min(time / traits[DURATION], 0.5)
    offset = numbers.lane_width / 2.0 * (1.0 - math.sin(phase))
    since = max(since_response, 0.0)
    swerved = min(traits[SWERVE] * since * since / 2.0, traits[SWERVE_WIDTH])
    return numbers.car_width - offset - swerved


@compiled
def lead_at(lead_speeds: NDArray, time: float) -> float:
    """Return the lead speed [m/s] at a time [s], interpolated between the speeds at 0, 0.1, ... s.

    After the last of these times, the lead speed is constant. A single speed is that of a lead vehicle that
    keeps its speed.
    """
    last = lead_speeds.size - 1
    if last == 0:
        return lead_speeds[0]
    place = min(max(time / STEP, 0.0), float(last))
    before = int(place)
    return lead_speeds[before] + (place - before) * (lead_speeds[min(before + 1, last)] - lead_speeds[before])


@compiled
def start(
    numbers: HumanNumbers, encounter: NDArray, lead_speeds: NDArray, traits: NDArray, state: NDArray, i: int
) -> None:
    """Write the initial state of an encounter to lane ``i`` of the array ``state``."""
    range_, closing = encounter[1], encounter[2]
    margin = min(numbers.margin, range_ / 2.0)
    onset = response_time(numbers, traits, range_, closing) - head_start(numbers, traits)
    braking = min(traits[JERK] * max(-onset, 0.0), wanted(numbers, traits[BRAKING], margin, range_, closing))
    state[:, i] = 0.0
    state[RANGE, i] = state[MIN_RANGE, i] = range_
    state[SPEED, i], state[CLOSING, i] = encounter[0] + closing, closing
    state[NOW, i] = state[SEEN, i] = state[NEXT, i] = lead_speeds[0]
    state[BRAKES, i] = state[HARDEST, i] = braking
    state[ONSET, i], state[MARGIN, i], state[MIN_TTC, i] = onset, margin, np.inf
    state[STRONGEST, i], state[RISE, i] = traits[BRAKING], traits[JERK]


@compiled
def step_of(time: float, onset: float) -> float:
    """Return the duration of a step [s], which ends at the latest when the driver responds."""
    return min(STEP, onset - time) if time < onset else STEP


@compiled
def watch_lead(numbers: HumanNumbers, lead_speeds: NDArray, state: NDArray, i: int) -> None:
    """Write the lead speed now, the one that the driver sees, and that after the step to lane ``i``."""
    time, now = state[TIME, i], state[NEXT, i]
    state[NOW, i] = now
    state[SEEN, i] = lead_at(lead_speeds, time - numbers.delay) if numbers.delay > 0.0 else now
    state[NEXT, i] = lead_at(lead_speeds, time + step_of(time, state[ONSET, i]))


@compiled
def advance(numbers: HumanNumbers, state: NDArray, count: int, last: int) -> None:
    """Advance the encounters in the first ``count`` lanes of ``state`` by a step, unless they are over.

    A driver who has responded keeps watching the lead vehicle, and brakes again if a new approach begins. An
    encounter is over with the contact, or when the approach has ended and no change of the lead speed, of
    which there are ``last``, is left to be seen.
    """
    settled = STEP * last + numbers.delay
    for i in range(count):
        time, range_, speed, braking = state[TIME, i], state[RANGE, i], state[SPEED, i], state[BRAKES, i]
        target, jerk, over, onset = state[TARGET, i], state[RISE, i], state[OVER, i], state[ONSET, i]
        min_ttc, min_range, hardest = state[MIN_TTC, i], state[MIN_RANGE, i], state[HARDEST, i]
        last_closing = state[CLOSING, i]
        closing = speed - state[NOW, i]
        is_open = over == 0.0
        ttc = range_ / closing
        min_ttc = min(min_ttc, ttc) if is_open & (closing > 0.0) else min_ttc
        runs = is_open & ((closing > 0.0) | (time < settled))
        step = step_of(time, onset)
        needed = wanted(numbers, state[STRONGEST, i], state[MARGIN, i], range_, speed - state[SEEN, i])
        # Once begun, hard braking continues until the approach ends.
        aware = max(needed, target) if needed > 0.0 else 0.0
        target = target if time < onset else aware
        ahead = min(braking + jerk * step, target)
        rising = ahead - braking
        # The quotient by the jerk is the time during which the deceleration increases.
        mean = ahead - rising * (rising / jerk) / (2.0 * step) if ahead > braking else ahead
        new_speed = max(speed - mean * step, 0.0)
        new_closing = new_speed - state[NEXT, i]
        # Within a step the range is smallest at the end of the step, or when the approach ends.
        until = closing / (closing - new_closing) if (new_closing < 0.0) & (closing > 0.0) else 1.0
        nearest = (closing + max(new_closing, 0.0)) / 2.0 * until * step
        touches = nearest >= range_
        share = range_ / nearest * until if touches else 1.0
        moves = runs & ~touches
        new_range = 0.0 if touches else range_ - (closing + new_closing) / 2.0 * step
        state[OVER, i] = over if not is_open else ENDED if not runs else CONTACT if touches else 0.0
        state[CLOSING, i] = closing + share * (new_closing - closing) if runs else last_closing
        state[HARDEST, i] = max(hardest, ahead) if runs else hardest
        state[MIN_RANGE, i] = min(min_range, range_ - nearest) if moves else min_range
        state[MIN_TTC, i], state[TARGET, i] = min_ttc, target
        state[RANGE, i] = new_range if runs else range_
        state[TIME, i] = time + share * step if runs else time
        state[SPEED, i] = new_speed if moves else speed
        state[BRAKES, i] = ahead if runs else braking


@compiled
def finish(numbers: HumanNumbers, traits: NDArray, state: NDArray, i: int, outcome: NDArray) -> None:
    """Write the ``outcome`` of the encounter in lane ``i``, shape (5,); see `follow_all`."""
    outcome[0], outcome[1], outcome[2] = 0.0, state[MIN_RANGE, i], state[MIN_TTC, i]
    outcome[3], outcome[4] = 0.0, state[HARDEST, i]
    time = state[TIME, i]
    if state[OVER, i] == CONTACT and overlap(numbers, traits, time, time - state[ONSET, i]) > 0.0:
        outcome[0], outcome[1], outcome[2] = 1.0, 0.0, min(outcome[2], STEP)
        outcome[3] = max(state[CLOSING, i], 0.0)


@compiled
def follow_all(
    numbers: HumanNumbers, encounters: NDArray, lead_speeds: NDArray, traits: NDArray, outcomes: NDArray
) -> None:
    """Simulate the columns of ``encounters``, shape (3, n), each with the driver in a row of ``traits``.

    ``lead_speeds`` [m/s] are those every 0.1 s, shape (n, states), or shape (n, 1) if the lead vehicles keep
    their speeds. The outcomes are written to ``outcomes``, shape (5, n), with the rows crash, smallest range
    [m], smallest time to collision [s], impact speed [m/s] and largest deceleration [m/s^2]. A simulation
    ends after 34.8 s at the latest, when a very slow approach may still go on.
    """
    state, index, last = np.empty((FIELDS, LANES)), np.empty(LANES, np.int64), lead_speeds.shape[1] - 1
    for first in range(0, encounters.shape[1], LANES):
        count, step = min(LANES, encounters.shape[1] - first), 0
        for i in range(count):
            index[i] = first + i
            start(numbers, encounters[:, first + i], lead_speeds[first + i], traits[first + i], state, i)
        while count > 0:
            step += 1
            if last > 0:
                for i in range(count):
                    watch_lead(numbers, lead_speeds[index[i]], state, i)
            advance(numbers, state, count, last)
            if step % SWEEP > 0 and step < STEPS:
                continue
            i = 0
            while i < count:
                if state[OVER, i] == 0.0 and step < STEPS:
                    i += 1
                    continue
                finish(numbers, traits[index[i]], state, i, outcomes[:, index[i]])
                count -= 1
                index[i] = index[count]
                state[:, i] = state[:, count]
