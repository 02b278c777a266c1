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
def wanted(numbers: HumanNumbers, traits: NDArray, margin: float, range_: float, closing: float) -> float:
    """Return the deceleration [m/s^2] that the driver intends, given range [m] and closing speed [m/s].

    It is the deceleration that ends the approach at a range equal to ``margin`` [m]. If this deceleration is
    at least ``hard_braking``, the driver brakes with the largest deceleration that this driver uses.
    """
    if closing <= 0.0:
        return 0.0
    left = range_ - margin
    if left <= 0.0 or closing * closing >= 2.0 * left * numbers.hard_braking:
        return traits[BRAKING]
    return min(closing * closing / (2.0 * left), traits[BRAKING])


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
def follow(
    numbers: HumanNumbers,
    encounter: NDArray,
    lead_speeds: NDArray,
    traits: NDArray,
    outcome: NDArray,
    course: NDArray,
) -> int:
    """Simulate one encounter, and return the number of states that were written to ``course``.

    A driver who has responded keeps watching the lead vehicle, and brakes again if a new approach begins.
    After the last of the ``lead_speeds`` [m/s] at 0, 0.1, ... s, the lead vehicle keeps its speed. The
    simulation ends when the approach has ended and no change of the lead speed is left to be seen, or after
    34.8 s, when a very slow approach may still go on.

    ``outcome``, shape (5,), receives crash, smallest range [m], smallest time to collision [s], impact speed
    [m/s] and largest deceleration [m/s^2]. ``course``, shape (states, 5), receives time [s], range [m],
    closing speed [m/s], deceleration [m/s^2] and lateral distance [m], unless it has no rows.
    """
    range_, speed, closing = encounter[1], encounter[0] + encounter[2], encounter[2]
    margin = min(numbers.margin, range_ / 2.0)
    onset = response_time(numbers, traits, range_, closing) - head_start(numbers, traits)
    braking = min(traits[JERK] * max(-onset, 0.0), wanted(numbers, traits, margin, range_, closing))
    outcome[0], outcome[1], outcome[2], outcome[3], outcome[4] = 0.0, range_, np.inf, 0.0, braking
    time, target, written, recorded = 0.0, 0.0, 0, course.shape[0] > 0
    settled = STEP * (lead_speeds.size - 1.0) + numbers.delay  # time when the driver has seen all changes
    for _ in range(STEPS):
        closing = speed - lead_at(lead_speeds, time)
        if closing > 0.0:
            outcome[2] = min(outcome[2], range_ / closing)
        if recorded:
            sideways = numbers.car_width - overlap(numbers, traits, time, time - onset)
            course[written] = (time, range_, closing, braking, sideways)
            written += 1
        if closing <= 0.0 and time >= settled:
            break
        step = min(STEP, onset - time) if time < onset else STEP
        if time >= onset:
            seen = speed - lead_at(lead_speeds, time - numbers.delay)
            needed = wanted(numbers, traits, margin, range_, seen)
            # Once begun, hard braking continues until the approach ends.
            target = max(needed, target) if needed > 0.0 else 0.0
        ahead = min(braking + traits[JERK] * step, target)
        mean = ahead
        if ahead > braking:  # the quotient by the jerk is the time during which the deceleration increases
            mean -= (ahead - braking) * ((ahead - braking) / traits[JERK]) / (2.0 * step)
        new_speed = max(speed - mean * step, 0.0)
        new_closing = new_speed - lead_at(lead_speeds, time + step)
        # Within a step the range is smallest at the end of the step, or when the approach ends.
        until = closing / (closing - new_closing) if new_closing < 0.0 < closing else 1.0
        nearest = (closing + max(new_closing, 0.0)) / 2.0 * until * step
        if nearest >= range_:
            share = range_ / nearest * until
            time += share * step
            closing += share * (new_closing - closing)
            outcome[4] = max(outcome[4], ahead)
            if overlap(numbers, traits, time, time - onset) > 0.0:
                outcome[0], outcome[1], outcome[2] = 1.0, 0.0, min(outcome[2], STEP)
                outcome[3] = max(closing, 0.0)
            if recorded:
                course[written] = (time, 0.0, closing, ahead, 0.0)
                written += 1
            break
        outcome[1], outcome[4] = min(outcome[1], range_ - nearest), max(outcome[4], ahead)
        range_ -= (closing + new_closing) / 2.0 * step
        time, speed, braking = time + step, new_speed, ahead
    return written


@compiled
def follow_all(
    numbers: HumanNumbers, encounters: NDArray, lead_speeds: NDArray, traits: NDArray, outcomes: NDArray
) -> None:
    """Simulate the columns of ``encounters``, shape (3, n), each with the driver in a row of ``traits``.

    ``lead_speeds`` [m/s] are those every 0.1 s, shape (n, states), or shape (n, 1) if the lead vehicles keep
    their speeds. The outcomes are written to ``outcomes``, shape (5, n), with the rows crash, smallest range
    [m], smallest time to collision [s], impact speed [m/s] and largest deceleration [m/s^2].
    """
    nothing, outcome = np.empty((0, 5)), np.empty(5)
    for i in range(encounters.shape[1]):
        follow(numbers, encounters[:, i], lead_speeds[i], traits[i], outcome, nothing)
        outcomes[:, i] = outcome
