"""Crash maps from randomly drawn closing speeds."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from accelerated_evaluation.crash_map.intervals import Intervals, in_batches
from accelerated_evaluation.crash_map.maps import CrashMap
from accelerated_evaluation.scenarios.events import Event
from accelerated_evaluation.vehicles.protocol import CRASH, Vehicle


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

    def find(line: NDArray) -> dict[Event, Intervals]:
        share = (np.arange(steps) + generator.random((line.size, steps))) / steps
        closing_speed = grid.closing_speed_max * share.ravel() ** 2
        outcomes = crash_map.simulate(vehicle, np.repeat(line, steps), closing_speed)
        places = {event: np.nonzero(event.happens(outcomes).reshape(share.shape)) for event in events}
        return {
            event: Intervals(line[row], edges[step], edges[step + 1]) for event, (row, step) in places.items()
        }

    return replace(crash_map, events=in_batches(lines, steps, find))
