"""The car that meets a crossing target, written plainly and independently: fixed small steps, world frame."""

import math
from dataclasses import dataclass
from itertools import pairwise

STEPS = 200  # of a tick
KP, KI = -38.6252446973784, -1.35416845633818


@dataclass
class Controller:
    """The controller of the specification, one call a tick."""

    command: float = 0.0
    error: float = 0.0
    braking: bool = False
    timer: float = 0.0
    at_onset: float = 0.0
    acceleration: float = 0.0

    def tick(self, range_: float, rate: float, speed: float) -> float:
        ttc = -range_ / rate if rate else math.inf
        error = 1.0 - range_ / speed
        threshold = 0.955 if speed >= 40 / 3.6 else 0.49 + 0.03456 * (speed - 4.16667)
        was = self.braking
        if 0 < ttc <= threshold:
            self.braking = True
        elif ttc > 1 or ttc < 0:
            self.braking = False
        if not self.braking:
            last = self.error
            if was:
                last, self.timer = 0.0, 0.0
            command = self.command + KP * (error - last) + KI * 0.05 * (error + last)
            command = 0.0 if speed >= 90 / 2.236 and command > 0 else max(-3.5, min(3.5, command))
        else:
            self.at_onset = self.at_onset if was else self.command
            self.timer += 0.1
            command = max(-5.8, self.at_onset - 12 * self.timer)
        self.error, self.command = error, command
        wanted = max(-7.84, min(7.84, command))
        self.acceleration = max(self.acceleration - 2, min(self.acceleration + 2, wanted))
        return self.acceleration


def left_turn(speed, turning_speed, distance, true_sign=False):
    """Return the smallest distance of the centres, and the relative speed at the first contact or 0."""
    r, w = 6.0, 3.9
    alpha = math.acos((r - w) / r)
    beta = min(alpha, turning_speed / r)
    host = distance * math.sin(alpha) + speed * beta * r / turning_speed
    x, y = w - r * (1 - math.cos(alpha - beta)), -r + r * math.sin(alpha - beta)
    points = math.floor((r * math.pi / 2 + 2 * w) / turning_speed / 0.1) + 1
    turning = math.floor(math.pi / 2 * r / turning_speed / 0.1) + 1
    angles = [k * math.pi / 2 / (turning - 1) if k < turning else math.pi / 2 for k in range(points)]
    velocities = [(-turning_speed * math.sin(a), turning_speed * math.cos(a)) for a in angles]
    velocities = velocities[round((alpha - beta) * r / turning_speed / 0.1) :]
    sign = -1 if true_sign else 1
    return _drive(
        speed, (0.0, host), (0.0, -1.0), (x, y), velocities, host - y, sign, lambda p: math.hypot(*p) < 2.1
    )


def pedestrian(speed, walking_speed, distance):
    """Return the smallest distance, and the relative speed at the first contact or 0."""
    speed, walk = abs(speed), abs(walking_speed)
    time = 3.9 / walk
    velocities = [(walk, 0.0)] * (math.floor(time / 0.1) + 1)

    def contact(p):
        return math.hypot(*p) < 1 or (math.hypot(*p) < 2 and abs(math.degrees(math.atan2(p[1], p[0]))) < 22.5)

    host, target = (0.0, -speed * time / 2), (-1.95, distance)
    return _drive(speed, host, (0.0, 1.0), target, velocities, distance + speed * time / 2, 1, contact)


def _drive(speed, host, direction, target, velocities, range_, sign, contact):
    controller, smallest, impact = Controller(), math.inf, 0.0
    h = 0.1 / STEPS
    for now, then in pairwise(velocities):
        if speed <= 0:
            break
        acceleration = controller.tick(range_, sign * now[1] - speed, speed)
        for k in range(STEPS):
            middle = (k + 0.5) / STEPS
            velocity = [a + (b - a) * middle for a, b in zip(now, then, strict=True)]
            offset = [b - a for a, b in zip(host, target, strict=True)]
            smallest = min(smallest, math.hypot(*offset))
            if impact == 0.0 and contact(offset):
                impact = math.hypot(velocity[0], velocity[1] - direction[1] * speed)
            step = (speed + acceleration * h / 2) * h
            host = (host[0], host[1] + direction[1] * step)
            target = (target[0] + velocity[0] * h, target[1] + velocity[1] * h)
            range_ += sign * velocity[1] * h - step
            speed += acceleration * h
            if speed <= 0:
                break
    return smallest, impact
