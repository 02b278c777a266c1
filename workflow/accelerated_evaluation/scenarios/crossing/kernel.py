"""Compiled simulation of an ACC + AEB car (the host) whose path a target crosses: a car or a pedestrian.

The host drives straight ahead. The target may first turn, and then crosses the path of the host at a right
angle. Its speed is constant. Positions of the target are relative to the host: ``ahead`` along the path of
the host, and ``aside`` across it, which decreases while the target crosses.

Controller and actuator act at the ticks of a clock, every 0.1 s. Between two ticks, the acceleration of the
host is constant and the velocity of the target is linear in time. Both coordinates are then polynomials of
the second degree, and the squared distance is a polynomial of the fourth degree, whose minimum is found
exactly.

If the target is very slow, the host creeps for minutes, and rounding errors decide whether it stops in time.
Speed and range are therefore integrated with the first steps of the authors' solver, ode45, and in its order
of summation.

For some targets, contact depends on the direction. The sector to the side is the set of target positions that
are beyond the host's path, on the side to which the target moves, within the angle arctan(side_slope) from
the direction across the path. In this sector, host and target touch at the distance side_contact.

Most functions concern the time between two ticks. Their parameter ``path`` is the position of the target as a
function of the time since the first of these ticks (`Path`), and their times t, ``begin`` and ``end`` are
measured from this tick [s]. ``car`` has the parameters of the simulation (`CarParameters`).

All functions of the compiled code are in this file, because numba's cache on disk only notices changes of the
file itself.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from accelerated_evaluation.scenarios.parameters import compiled

TICK = 0.1  # [s], period of the controller's clock, and time between the points of the target's velocity

# Rows of the encounters: speed of the host, position of the target at the start, speed of the target, first
# point of its velocity, number of points in which it turns, number of ticks of a run.
SPEED, AHEAD, ASIDE, TARGET, FIRST, TURNING, TICKS = range(7)
# Rows of the outcomes, in the order of `CrossingOutcomes`.
CRASH, ENDED, MIN_DISTANCE, CLEARANCE, IMPACT_SPEED, RUN_TIME, ENCROACHMENT = range(7)
TRACED = 6  # columns of a trace: time, ahead, aside, speed, acceleration, whether the AEB is on
# Elements of the state of the solver: speed of the host, range that the controller measures, and step.
V, RANGE, STEP = range(3)

# The Runge-Kutta formulas of Dormand and Prince, as in ode45: nodes and stages.
NODES = np.array([0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0, 1.0])
STAGES = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [1 / 5, 0.0, 0.0, 0.0, 0.0, 0.0],
        [3 / 40, 9 / 40, 0.0, 0.0, 0.0, 0.0],
        [44 / 45, -56 / 15, 32 / 9, 0.0, 0.0, 0.0],
        [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729, 0.0, 0.0],
        [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656, 0.0],
        [35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84],
    ]
)
TOLERANCE, SMALL = 1e-3, 1e-3  # relative tolerance, and smallest size of a state in a relative error


class CarParameters(NamedTuple):
    """Parameters of controller, actuator and contact, as floats in SI units."""

    headway: float
    kp: float
    ki_half_step: float
    acc_limit: float
    acc_top_speed: float
    threshold_base: float
    threshold_slope: float
    threshold_speed: float
    threshold_top: float
    threshold_top_speed: float
    release_ttc: float
    aeb_deceleration: float
    aeb_jerk: float
    friction_limit: float
    acceleration_step: float
    contact: float  # distance of the centres below which host and target touch, in any direction
    side_contact: float  # this distance in a sector to the side to which the target moves; 0 without a sector
    side_slope: float  # tangent of half the sector's angle
    most_ticks: float  # largest number of ticks of a run


class Path(NamedTuple):
    """Position of the target relative to the host between two ticks, as polynomials of time.

    The coordinate along the path of the host is ahead + ahead_1 t + ahead_2 t^2; the one across it is
    similar.
    """

    ahead: float
    ahead_1: float
    ahead_2: float
    aside: float
    aside_1: float
    aside_2: float


@compiled
def control(car: CarParameters, range_: float, rate: float, speed: float, memory: tuple) -> tuple:
    """Return the state of the controller (ACC and AEB) after a tick, from its state at the last tick.

    The state is the commanded acceleration [m/s^2], the error of the time headway [s], the time since the AEB
    switched on [s] (0 if the AEB is off), and the command when the AEB switched on [m/s^2]. Range [m] and
    range rate [m/s] are those that the controller measures.
    """
    command, error, timer, onset = memory
    ttc = -range_ / rate
    threshold = car.threshold_base + car.threshold_slope * (speed - car.threshold_speed)
    threshold = car.threshold_top if speed >= car.threshold_top_speed else threshold
    was_on = timer > 0.0
    new_error = car.headway - range_ / speed
    if 0.0 < ttc <= threshold or (was_on and not (ttc > car.release_ttc or ttc < 0.0)):
        onset = onset if was_on else command
        timer += TICK
        return max(-car.aeb_deceleration, onset - car.aeb_jerk * timer), new_error, timer, onset
    error = 0.0 if was_on else error
    acc = command + car.kp * (new_error - error) + car.ki_half_step * (new_error + error)
    acc = min(max(acc, -car.acc_limit), 0.0 if speed >= car.acc_top_speed else car.acc_limit)
    return acc, new_error, 0.0, onset


@compiled
def actuate(car: CarParameters, command: float, acceleration: float) -> float:
    """Return the new acceleration [m/s^2], which follows the command within limits of friction and jerk.

    ``command`` and ``acceleration`` are the commanded and the present acceleration [m/s^2]. ``car`` contains
    the limits.
    """
    wanted = min(max(command, -car.friction_limit), car.friction_limit)
    return min(max(wanted, acceleration - car.acceleration_step), acceleration + car.acceleration_step)


@compiled
def velocity(encounter: NDArray, tick: float) -> tuple[float, float]:
    """Return the velocity of the target at a tick [m/s]: towards the host, and across the host's path.

    ``encounter`` is the initial state of the encounter, shape (7,), and ``tick`` the number of the tick.
    """
    point, turning, speed = encounter[FIRST] + tick, encounter[TURNING], encounter[TARGET]
    if point >= turning:
        return 0.0, speed
    angle = point * (np.pi / 2) / (turning - 1.0) if turning > 1.0 else np.pi / 2
    return speed * np.cos(angle), speed * np.sin(angle)


@compiled
def position(path: Path, t: float) -> tuple[float, float]:
    """Return the target's coordinates along and across the host's path [m] at time t [s] after the tick."""
    ahead = path.ahead + t * (path.ahead_1 + t * path.ahead_2)
    return ahead, path.aside + t * (path.aside_1 + t * path.aside_2)


@compiled
def squared(path: Path, t: float) -> float:
    """Return the squared distance of host and target [m^2] on a path, at time t [s] after the tick."""
    ahead, aside = position(path, t)
    return ahead * ahead + aside * aside


@compiled
def parting(path: Path, t: float) -> float:
    """Return half the time derivative of the squared distance [m^2/s] at time t [s] after the tick."""
    ahead, aside = position(path, t)
    return ahead * (path.ahead_1 + 2.0 * t * path.ahead_2) + aside * (path.aside_1 + 2.0 * t * path.aside_2)


@compiled
def curvature(path: Path) -> tuple[float, float, float]:
    """Return the second derivative of the squared distance, divided by 2, as coefficients of a quadratic.

    The quadratic, the derivative of `parting`, is square t^2 + 2 half t + constant.
    """
    _, b, c, _, e, f = path
    constant = b * b + e * e + 2.0 * (path.ahead * c + path.aside * f)
    return 6.0 * (c * c + f * f), 3.0 * (b * c + e * f), constant


@compiled
def roots(square: float, half: float, constant: float, begin: float, end: float) -> tuple[float, float]:
    """Return the two roots of square t^2 + 2 half t + constant in increasing order, clipped to [begin, end].

    Both are ``end`` if there are no two real roots. The formula does not subtract nearly equal numbers.
    """
    discriminant = half * half - square * constant
    if discriminant <= 0.0:
        return end, end
    larger = -half - np.sqrt(discriminant) if half > 0.0 else -half + np.sqrt(discriminant)
    one = larger / square if square != 0.0 else end
    one, two = min(max(one, begin), end), min(max(constant / larger, begin), end)
    return min(one, two), max(one, two)


@compiled
def closest(path: Path, begin: float, end: float) -> float:
    """Return the time [s] at which the distance of host and target is smallest, in [``begin``, ``end``].

    The derivative of the squared distance is a cubic. It is monotone between the roots of its own derivative,
    a quadratic. Each monotone piece in which the cubic changes from negative to positive has one local
    minimum, which bisection finds. The result is the best of these minima and of the two ends.
    """
    best = begin if squared(path, begin) <= squared(path, end) else end
    square, half, constant = curvature(path)
    low, high = roots(square, half, constant, begin, end)
    left, falls = begin, parting(path, begin) < 0.0
    for right in (low, high, end):
        fell, falls = falls, parting(path, right) < 0.0
        if left < right and fell and not falls:
            t = minimum(path, left, right)
            best = t if squared(path, t) < squared(path, best) else best
        left = right
    return best


@compiled
def minimum(path: Path, left: float, right: float) -> float:
    """Return the time [s] in [``left``, ``right``] at which the distance of host and target stops decreasing.

    After 30 bisections, the error of the time is below 1e-10 s. The error of the distance is of the order of
    its square.
    """
    for _ in range(30):
        middle = (left + right) / 2
        falls = parting(path, middle) < 0.0
        left, right = middle if falls else left, right if falls else middle
    return left


@compiled
def adds_nothing(path: Path, end: float, reach: float, nearest: float) -> bool:
    """Return whether the time between two ticks cannot change the outcomes, so that it can be skipped.

    This is so if the squared distance is convex, the distance is above ``reach`` [m] at both ends, and it
    either decreases until the end, or increases from a distance of at least ``nearest`` [m].
    """
    _, half, constant = curvature(path)
    first = squared(path, 0.0)
    if constant < 2.0 * abs(half) * end or min(first, squared(path, end)) <= reach * reach:
        return False
    return parting(path, end) < 0.0 or (parting(path, 0.0) > 0.0 and first >= nearest * nearest)


@compiled
def in_sector(car: CarParameters, path: Path, t: float) -> bool:
    """Return whether the target is in the sector to the side of the host, t seconds after the tick.

    The sector is defined at the top of the module.
    """
    ahead, aside = position(path, t)
    return abs(ahead) < -car.side_slope * aside


@compiled
def touches(car: CarParameters, path: Path, t: float) -> bool:
    """Return whether host and target touch at time t [s] after the tick."""
    square = squared(path, t)
    side = square < car.side_contact * car.side_contact and in_sector(car, path, t)
    return side or square < car.contact * car.contact


@compiled
def closest_to_the_side(car: CarParameters, path: Path, end: float) -> float:
    """Return the time [s] before ``end`` at which the distance is smallest while the target is in the sector.

    The result is -1 if the target is not in the sector to the side at any of these times. The times at which
    the target crosses one of the two edges of the sector are roots of quadratic equations.
    """
    cuts = np.array([0.0, end, end, end, end, end])
    for i, edge in enumerate((-car.side_slope, car.side_slope)):
        constant, linear = path.ahead + edge * path.aside, path.ahead_1 + edge * path.aside_1
        square = path.ahead_2 + edge * path.aside_2
        cuts[2 * i + 1], cuts[2 * i + 2] = roots(square, linear / 2, constant, 0.0, end)
    cuts.sort()
    best = -1.0
    for i in range(5):
        if in_sector(car, path, (cuts[i] + cuts[i + 1]) / 2):
            t = closest(path, cuts[i], cuts[i + 1])
            best = t if best < 0.0 or squared(path, t) < squared(path, best) else best
    return best


@compiled
def _observe(car: CarParameters, path: Path, end: float, outcome: NDArray) -> None:
    """Update the outcomes of a run with the motion between a tick and the time ``end`` [s] after it.

    The updated elements of ``outcome`` are the smallest distance and the clearance [m], and the impact speed
    [m/s] at the first contact.
    """
    reach = max(car.contact, car.side_contact)
    if adds_nothing(path, end, reach, outcome[MIN_DISTANCE]):
        return
    t = closest(path, 0.0, end)
    distance = np.sqrt(squared(path, t))
    clearance = distance - car.contact
    if distance < car.side_contact:
        side = closest_to_the_side(car, path, end)
        if side >= 0.0 and np.sqrt(squared(path, side)) - car.side_contact < clearance:
            t, clearance = side, np.sqrt(squared(path, side)) - car.side_contact
    if clearance < 0.0 <= outcome[CLEARANCE]:
        t = first_contact(car, path, t)
        ahead_speed, aside_speed = (
            path.ahead_1 + 2.0 * t * path.ahead_2,
            path.aside_1 + 2.0 * t * path.aside_2,
        )
        outcome[IMPACT_SPEED] = np.hypot(ahead_speed, aside_speed)
    outcome[MIN_DISTANCE] = min(outcome[MIN_DISTANCE], distance)
    outcome[CLEARANCE] = min(outcome[CLEARANCE], clearance)


@compiled
def crossing(path: Path, end: float) -> float:
    """Return the time [s] before ``end`` at which the target crosses the path of the host, by bisection."""
    before, after = 0.0, end
    for _ in range(40):
        middle = (before + after) / 2
        is_beyond = position(path, middle)[1] <= 0.0
        before, after = before if is_beyond else middle, middle if is_beyond else after
    return after


@compiled
def first_contact(car: CarParameters, path: Path, within: float) -> float:
    """Return the time [s] at which a contact began, by bisection; 0 if the contact exists at the tick.

    ``within`` is a time [s] at which host and target touch.
    """
    before = 0.0
    for _ in range(40):
        middle = (before + within) / 2
        contact = touches(car, path, middle)
        before, within = before if contact else middle, middle if contact else within
    return within


@compiled
def ode45_increments(
    speed: float, acceleration: float, rate: float, growth: float, h: float
) -> tuple[float, float]:
    """Return the increments of speed [m/s] and range [m] over a step h [s], in the summation order of ode45.

    ``rate`` is the speed of the target in the range that the controller measures [m/s] at the start of the
    step, and ``growth`` its increase over the step.
    """
    gain, change = 0.0, 0.0
    for stage in range(7):
        gain = 0.0
        for j in range(stage):
            gain += acceleration * (h * STAGES[stage, j])
        if stage < 6:
            change += (rate + growth * NODES[stage] - (speed + gain)) * (h * STAGES[6, stage])
    return gain, change


@compiled
def first_step(car: CarParameters, path: Path, speed: float, acceleration: float, rate: float) -> float:
    """Return the length [s] of the first step that the solver ode45 tries.

    It follows from the relative derivatives of the states of the authors' simulation: speed, range, and the
    distances driven and the integral of the indicator of contact, which begin at 0. ``speed`` [m/s] and
    ``acceleration`` [m/s^2] are those of the host, and ``rate`` is the speed of the target in the range that
    the controller measures [m/s].
    """
    fastest = max(speed, abs(rate), abs(path.aside_1), 1.0 if touches(car, path, 0.0) else 0.0) / SMALL
    fastest = max(fastest, abs(acceleration) / max(speed, SMALL), abs(rate - speed) / max(path.ahead, SMALL))
    return 1.0 / (fastest * (1.25 / TOLERANCE**0.2))


@compiled
def integrate(acceleration: float, rate: float, growth: float, tick: float, state: NDArray) -> float:
    """Integrate the state from a tick to the next one, or until the host stops; return the duration [s].

    A step ends at a tick at the latest, and the next one is five times as long. ``rate`` is the speed of the
    target in the range that the controller measures [m/s] at the tick, and ``growth`` its increase until the
    next tick. ``state``, shape (3,), has speed, range and the length of the step, and is updated.
    """
    begin, end = tick * TICK, (tick + 1.0) * TICK
    t, stops = begin, False
    while t < end and not stops:
        step = min(state[STEP], TICK)
        last = 1.1 * step >= end - t
        step = end - t if last else step
        new_t = end if last else t + step
        h, now = new_t - t, rate + growth * ((t - begin) / TICK)
        rise, change = ode45_increments(state[V], acceleration, now, growth * (h / TICK), h)
        stops = state[V] + rise <= 0.0
        if stops:
            h = -state[V] / acceleration
            rise, change = ode45_increments(state[V], acceleration, now, growth * (h / TICK), h)
            new_t = t + h
        state[V] = 0.0 if stops else state[V] + rise
        state[RANGE] += change
        state[STEP] = step / 0.2
        t = new_t
    return t - begin if stops else TICK


@compiled
def run(encounter: NDArray, car: CarParameters, state: NDArray, outcome: NDArray, trace: NDArray) -> None:
    """Simulate one encounter, and write its outcomes.

    A run ends when the host stops, when the time of the run is over, or when host and target cannot come
    closer any more. The post-encroachment time assumes that both then keep their speeds. ``encounter`` is the
    initial state, shape (7,), and ``state``, shape (3,), the working memory of the solver. ``outcome``, shape
    (7,), receives the outcomes in the order of `CrossingOutcomes`, and ``trace``, shape (n, 6), the states at
    the first n ticks.
    """
    memory, acceleration, tick, end, passed = (0.0, 0.0, 0.0, 0.0), 0.0, 0.0, 0.0, False
    ahead, aside, ticks = encounter[AHEAD], encounter[ASIDE], encounter[TICKS]
    state[V], state[RANGE] = encounter[SPEED], ahead
    outcome[:], outcome[MIN_DISTANCE], outcome[CLEARANCE] = 0.0, np.inf, np.inf
    towards, across = velocity(encounter, 0.0)
    # Time at which the target crosses the path of the host [s], and the way of the host to this point [m].
    crossed, left = np.inf, 0.0
    while True:
        over = passed or state[V] <= 0.0 or tick >= ticks
        outcome[RUN_TIME] = max(tick - 1.0, 0.0) * TICK + end
        if tick < len(trace):
            row = trace[int(tick)]
            row[0], row[1], row[2], row[3] = outcome[RUN_TIME], ahead, aside, state[V]
            row[4], row[5] = acceleration, memory[2] > 0.0
        if over or tick >= car.most_ticks or ahead == np.inf:
            break
        rate = towards - state[V]  # the sign of the target's speed is wrong, as in the authors' model
        memory = control(car, state[RANGE], rate, state[V], memory)
        acceleration = actuate(car, memory[0], acceleration)
        new_towards, new_across = velocity(encounter, tick + 1.0)
        growth, turn = new_towards - towards, (new_across - across) / TICK / 2
        ahead_2 = -(growth / TICK + acceleration) / 2
        path = Path(ahead, -(towards + state[V]), ahead_2, aside, -across, -turn)
        if tick == 0.0:
            state[STEP] = first_step(car, path, state[V], acceleration, towards)
        before = state[V]
        end = integrate(acceleration, towards, growth, tick, state)
        _observe(car, path, end, outcome)
        if crossed < np.inf:
            left -= (before + state[V]) / 2 * end
        elif aside > 0.0 >= position(path, end)[1]:
            t = crossing(path, end)
            speed = before + (state[V] - before) * t / end
            crossed, left = tick * TICK + t, position(path, t)[0] - (speed + state[V]) / 2 * (end - t)
        ahead, aside = position(path, end)
        towards, across = new_towards, new_across
        reach = max(outcome[MIN_DISTANCE], car.contact, car.side_contact)
        passed = -ahead > reach or -aside > reach
        tick += 1.0
    outcome[MIN_DISTANCE] = min(outcome[MIN_DISTANCE], np.hypot(ahead, aside))
    outcome[CLEARANCE] = min(outcome[CLEARANCE], outcome[MIN_DISTANCE] - car.contact)
    outcome[CRASH] = outcome[CLEARANCE] < 0.0
    outcome[ENDED] = over
    if crossed == np.inf and across > 0.0:
        crossed = outcome[RUN_TIME] + aside / across
        left = ahead - towards * aside / across
    outcome[ENCROACHMENT] = np.inf
    if outcome[CRASH] > 0.0:
        outcome[ENCROACHMENT] = 0.0
    elif crossed < np.inf and state[V] > 0.0:
        outcome[ENCROACHMENT] = abs(outcome[RUN_TIME] + left / state[V] - crossed)


@compiled
def simulate_crossings(
    encounters: NDArray, begin: int, end: int, car: CarParameters, outcomes: NDArray
) -> None:
    """Simulate the columns ``begin`` to ``end`` of ``encounters``, shape (7, n), independently of each other.

    The outcomes are written to ``outcomes``, shape (7, n). The rows of both arrays are listed in the module.
    """
    state, outcome, trace = np.empty(3), np.empty(7), np.empty((0, TRACED))
    for i in range(begin, end):
        run(encounters[:, i].copy(), car, state, outcome, trace)
        outcomes[:, i] = outcome


@compiled
def trace_run(encounter: NDArray, car: CarParameters, trace: NDArray) -> None:
    """Simulate one encounter, shape (7,), and write its first n states to ``trace``, shape (n, 6)."""
    run(encounter, car, np.empty(3), np.empty(7), trace)
