"""Crash maps from randomly drawn closing speeds."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from accelerated_evaluation.crash_map.maps import CrashMap, Intervals
from accelerated_evaluation.scenarios.events import Event
from accelerated_evaluation.vehicles.protocol import CRASH, Vehicle

ENCOUNTERS_AT_ONCE = 500_000  # number of encounters that are simulated at once, which need about 100 MB


def sample_crashes(
    vehicle: Vehicle,
    crash_map: CrashMap,
    generator: np.random.Generator,
    *,
    events: Sequence[Event] = (CRASH,),
    finer: int = 1,
) -> CrashMap:
    """Return a crash map on the lines of another map, computed with randomly drawn closing speeds.

    A scan misses stripes of crashes that are narrower than its steps, or shows them too wide if a point is in
    one. Here each line is divided into equal steps of the square root of the closing speed, and one closing
    speed is drawn at random in each step. If it ends in a crash, the whole step is mapped as a crash. The
    probability of this is the share of the step that ends in a crash. The expected value of a crash
    probability is therefore correct for stripes of any width, if the density of the law is nearly constant
    within a step.

    ``finer`` is the number of steps for each scan point of the other map, whose intervals are not used.
    """
    grid, lines = crash_map.grid, crash_map.lead_speed.size
    steps = finer * grid.closing_speed_points
    edges = grid.closing_speed_max * (np.arange(steps + 1) / steps) ** 2
    edges[-1] = np.inf  # the outcome does not change above the largest closing speed
    batch = max(1, ENCOUNTERS_AT_ONCE // steps)
    found: dict[Event, list[tuple]] = {event: [] for event in events}
    for first in range(0, lines, batch):
        line = np.arange(first, min(first + batch, lines))
        share = (np.arange(steps) + generator.random((line.size, steps))) / steps
        closing_speed = grid.closing_speed_max * share.ravel() ** 2
        outcomes = crash_map.simulate(vehicle, np.repeat(line, steps), closing_speed)
        for event, parts in found.items():
            row, step = np.nonzero(event.happens(outcomes).reshape(share.shape))
            parts.append((line[row], edges[step], edges[step + 1]))
    sampled = {event: _joined(parts) for event, parts in found.items()}
    return replace(crash_map, events=sampled)


def _joined(parts: list[tuple]) -> Intervals:
    row, start, end = (np.concatenate(column) for column in zip(*parts, strict=True))
    return Intervals(row.astype(np.int32), start, end)
