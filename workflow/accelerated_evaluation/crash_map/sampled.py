"""A crash map by random closing speeds, for vehicles whose crashes lie in stripes too narrow for a scan.

A scan takes what lies between two of its points for known, so that stripes narrower than its steps are missed
or, where a point meets one, taken for wider than they are. Here each line is cut into equal steps of the
square root of the closing speed, and in each step one closing speed is drawn. If it crashes, the whole step
counts as a crash. A step counts as often as the share of it that crashes, so the mean of the map is right
however narrow the stripes are, but for how much the law's density changes within a step.
"""

import numpy as np

from accelerated_evaluation.crash_map.maps import CrashMap, Intervals
from accelerated_evaluation.vehicles.events import CRASH
from accelerated_evaluation.vehicles.protocol import Vehicle

ENCOUNTERS_AT_ONCE = 500_000  # bounds the memory: about 100 MB


def sample_crashes(vehicle: Vehicle, crash_map: CrashMap, generator: np.random.Generator) -> CrashMap:
    """Return a map on the lines of another, whose crashes are steps in which a random closing speed crashes.

    Parameters
    ----------
    vehicle
        The vehicle of the other map.
    crash_map
        That map. It gives the lines and the number of steps, and its intervals are not used.
    generator
        Draws the closing speeds.
    """
    grid, lines = crash_map.grid, crash_map.lead_speed.size
    steps = grid.closing_speed_points
    edges = grid.closing_speed_max * (np.arange(steps + 1) / steps) ** 2
    edges[-1] = np.inf  # above the last closing speed nothing changes any more
    batch, found = max(1, ENCOUNTERS_AT_ONCE // steps), []
    for first in range(0, lines, batch):
        line = np.arange(first, min(first + batch, lines))
        share = (np.arange(steps) + generator.random((line.size, steps))) / steps
        outcomes = vehicle.simulate(
            np.repeat(crash_map.lead_speed[line], steps),
            np.repeat(1 / crash_map.inverse_range[line], steps),
            grid.closing_speed_max * share.ravel() ** 2,
        )
        row, step = np.nonzero(outcomes.crash.reshape(share.shape))
        found.append((line[row], edges[step], edges[step + 1]))
    row, start, end = (np.concatenate(column) for column in zip(*found, strict=True))
    crashes = {CRASH: Intervals(row.astype(np.int32), start, end)}
    return CrashMap(grid, crash_map.cells, crash_map.lead_speed, crash_map.inverse_range, crashes)
