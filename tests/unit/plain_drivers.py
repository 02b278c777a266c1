"""The reference drivers in plain Python, one encounter at a time, step by step, with no short cut.

Written from the description of JRC-FSM, for the tests of the compiled drivers, and in other words than those.
"""

import math
from types import SimpleNamespace

DT, LENGTH, WIDTH = 0.1, 4.3, 1.9


def simulate(decide, lead, gap, closing, *, reaction=0.75, lateral_speed=0.0, crossing=3.5):
    """Return crash, smallest range, smallest TTC and impact speed; ``decide`` returns (unsafe, braking)."""
    s = SimpleNamespace(u=lead, v=lead + closing, acc=0.0, ramp=None, w=0.0, y=0.0, dx=gap + LENGTH)
    sideways = 0
    if lateral_speed:
        s.y = 3.5 - lateral_speed * DT
        s.dx += max(closing, 0) * (3.5 - crossing) / lateral_speed - closing * DT
        sideways = math.floor(35 / lateral_speed)
    delay, ranges, times = reaction, [gap], []
    approach = [gap / closing] if closing > 0 else []
    for _ in range(349):
        s.g, s.e, s.c = abs(s.dx) - LENGTH, abs(s.y) - WIDTH, s.v - s.u
        s.w = lateral_speed if sideways > 0 else 0.0
        if s.g > 0 and s.c > 0 and s.dx > 0:
            approach.append(s.g / s.c)
            times += [s.g / s.c] if s.e < 0 else []
        if s.e < 0 and s.g <= 0:
            return True, min(*ranges, s.g), min(times or approach), s.c
        if s.e < 0 and s.dx > 0:
            ranges.append(s.g)
        unsafe, deceleration = decide(s) if s.dx >= 0 else (False, None)
        if not unsafe:
            s.acc = 0.0
        elif delay > 0:
            delay, s.acc = delay - DT, -decide.coasting
        else:
            s.acc = -deceleration()
        s.v = max(s.v + s.acc * DT, 0.0)
        s.dx -= (s.v - s.u) * DT
        s.y -= lateral_speed * DT if sideways > 0 else 0.0
        sideways -= 1
    return False, min(ranges), min(times, default=math.inf), 0.0


def ramped(s, start):
    """Deceleration that grows by 12.65 m/s^3 to 0.774 g, and is remembered."""
    s.ramp = min((start if s.ramp is None else s.ramp) + 1.265, 0.774 * 9.81)
    return s.ramp


def cc_human(s):
    critical = s.c != 0 and abs(s.g / s.c) <= 2
    return s.e <= 0 and critical, lambda: ramped(s, 0.4)


def reg157(s):
    critical = s.c != 0 and abs(s.g / s.c) <= s.c / 12 + 0.45
    return s.e <= 0.5 and critical, lambda: 6.0


def rss(s):
    fast = s.v + 3 * 0.75
    along = s.v * 0.75 + 3 * 0.75**2 / 2 + fast**2 / 12 - s.u**2 / 12
    across = 0.3 + (2 * s.w + 0.75) * 0.75 / 2 + (s.w + 0.75) ** 2 / 2
    return s.g < along and s.e < across, lambda: ramped(s, 0.0)


def linear(value, zero, one):
    return 0.0 if value >= zero else 1.0 if value <= one else (value - zero) / (one - zero)


def fsm(s):
    if s.e > 0:
        time_to_pass = math.inf if s.c == 0 else (abs(s.dx) + LENGTH) / s.c
        if s.w <= 0 or s.e / s.w > time_to_pass + 0.1:
            return False, None
    shared = s.v * 0.75 - s.u**2 / 14
    pfs = linear(s.g - 2, shared + s.v**2 / 8 + 2, shared + s.v**2 / 12)
    cfs = fsm_critical(s) if s.c > 0 else 0.0
    wanted = 4 + 2 * cfs if cfs > 0 else 4 * pfs
    return pfs + cfs > 0, lambda: min(-s.acc + 1.265, 0.774 * 9.81, wanted)


def fsm_critical(s):
    slowing = max(s.acc, -4)
    if s.v + 0.75 * slowing < s.u:
        return 1.0 if s.g < s.c**2 / abs(2 * s.acc) else 0.0
    response = (s.c + slowing * 0.75 / 2) * 0.75
    left = (s.c + slowing * 0.75) ** 2
    return linear(s.g, response + left / 8, response + left / 12)


DECIDE = {"cc_human": cc_human, "reg157": reg157, "rss": rss, "fsm": fsm}
REACTION = {"cc_human": 0.75, "reg157": 0.35, "rss": 0.75, "fsm": 0.75}
for _decide in DECIDE.values():
    _decide.coasting = 0.4 if _decide is cc_human else 0.0
