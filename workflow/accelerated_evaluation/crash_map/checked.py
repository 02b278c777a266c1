"""Crash maps from randomly drawn closing speeds, and the check of a map by such simulations.

The scan of a line assumes that the outcome does not change between two neighbouring points. If it does
change, the map has an error that is not included in the standard error of an exact probability, because this
contains only the effect of the random places of the lines. The check draws some lines of the map, divides
each into steps, and simulates one closing speed in each step, drawn from the reference law. The sum of the
probabilities of the steps with a crash is an unbiased estimate of the crash probability of the line, for
crash sets of any shape. If the map is correct, its difference from the probability of the intervals of the
map has the expected value 0.
"""

import sys
from dataclasses import dataclass

import numpy as np

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.crash_map.maps import CrashMap
from accelerated_evaluation.crash_map.sampled import sample_crashes
from accelerated_evaluation.vehicles.protocol import CRASH, Vehicle

LINES = 2000  # number of drawn lines, but at most twice the number of lines of the map
EVEN = 0.5  # share of the lines that are drawn by the probability of their cell, independently of crashes
FINER = 4  # number of steps of a map with random closing speeds for each point of a scan
CRITICAL = 4.0  # critical number of standard errors; a correct map exceeds it in one of 16,000 cases


@dataclass(frozen=True)
class MapCheck:
    """The result of a check, under the reference law of the grid."""

    mapped: float  # crash probability from the map, up to a constant factor
    difference: float  # simulated crash probability minus `mapped`
    standard_error: float

    @property
    def contradicts(self) -> bool:
        """Whether the difference exceeds `CRITICAL` standard errors in either direction."""
        return abs(self.difference) > CRITICAL * self.standard_error

    @property
    def in_words(self) -> str:
        """A sentence that reports the difference between the map and the simulations."""
        size = f"{self.difference / self.mapped:+.1%}" if self.mapped else "infinitely many percent"
        return (
            f"The crash map is contradicted by simulations at random closing speeds: the crash "
            f"probability differs by {size} ({self.difference / self.standard_error:.1f} standard errors)."
        )


def check_map(vehicle: Vehicle, crash_map: CrashMap, generator: np.random.Generator) -> MapCheck:
    """Compare the crash probability from a map with simulations at random closing speeds on some lines."""
    grid, intervals = crash_map.grid, crash_map.intervals(CRASH)
    rate = crash_map.inverse_range / grid.reference_inverse_ttc  # of the exponential law of the closing speed
    start, end = (np.exp(-rate[intervals.line] * edge) for edge in (intervals.start, intervals.end))
    mapped = np.bincount(intervals.line, start - end, rate.size)
    weight = crash_map.reference
    chance = EVEN * weight / weight.sum()
    if mapped.any():
        chance += (1 - EVEN) * weight * mapped / (weight @ mapped)
    count = min(LINES, 2 * rate.size)
    chosen = generator.choice(rate.size, count, p=chance / chance.sum())
    simulated = _simulated(vehicle, crash_map, chosen, rate[chosen], generator)
    ratio = weight[chosen] / (count * chance[chosen] / chance.sum())
    differences = ratio * (simulated - mapped[chosen])
    error = np.std(differences, ddof=1) * np.sqrt(count)
    return MapCheck(float(weight @ mapped), float(differences.sum()), float(error))


def require_right_map(vehicle: Vehicle, crash_map: CrashMap, generator: np.random.Generator) -> CrashMap:
    """Return a crash map, or a map with random closing speeds if simulations contradict the crash map.

    InputError is raised if the map with random closing speeds is contradicted as well.
    """
    check = check_map(vehicle, crash_map, generator)
    if not check.contradicts:
        return crash_map
    print(f"{check.in_words} A map with random closing speeds takes its place.", file=sys.stderr)
    events = list(crash_map.events)
    sampled = sample_crashes(vehicle, crash_map, generator, events=events, finer=FINER)
    check = check_map(vehicle, sampled, generator)
    if check.contradicts:
        raise InputError(
            "crash map of the vehicle",
            seen=check.in_words,
            expected="a map whose crash probability random simulations confirm",
            change="Refine the grid (crash_map.grid, answer.grid), above all closing_speed_points.",
        )
    return sampled


def _simulated(
    vehicle: Vehicle, crash_map: CrashMap, chosen: Array, rate: Array, generator: np.random.Generator
) -> Array:
    """Return unbiased estimates of the crash probabilities of lines, shape (lines,).

    Closing speeds above the largest one of the grid are simulated with the largest one, as in the map.
    """
    grid = crash_map.grid
    steps = grid.closing_speed_points
    edges = grid.closing_speed_max * (np.arange(steps + 1) / steps) ** 2
    beyond = np.exp(-rate[:, None] * edges)  # probability of a closing speed beyond each edge
    drawn = beyond[:, :-1] + generator.random((chosen.size, steps)) * np.diff(beyond, axis=1)
    with np.errstate(divide="ignore"):
        speed = np.where(drawn > 0, -np.log(drawn) / rate[:, None], grid.closing_speed_max)
    speed = np.hstack([np.clip(speed, edges[:-1], edges[1:]), np.full((chosen.size, 1), edges[-1])])
    outcomes = crash_map.simulate(vehicle, np.repeat(chosen, steps + 1), speed.ravel())
    probability = np.hstack([-np.diff(beyond, axis=1), beyond[:, -1:]])
    return (outcomes.crash.reshape(speed.shape) * probability).sum(axis=1)
