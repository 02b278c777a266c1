"""Impact speeds in the intervals of a crash map."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.crash_map.intervals import ENCOUNTERS_AT_ONCE
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.laws.smooth.conditional import SpeedLaw
from accelerated_evaluation.scenarios.cut_in import SPEED_LIMIT
from accelerated_evaluation.vehicles.protocol import Vehicle

# Ends of the parts of a wide interval of a crash map, above its start [m/s]. They are so narrow that the laws
# of all draws have nearly the same impact speeds in a part.
STEPS = 45 * (np.arange(1, 23) / 22) ** 1.5
POINTS = 4  # number of closing speeds that are simulated in a part
INSIDE = (np.arange(POINTS) + 0.5) / POINTS  # positions of these closing speeds in the part, from 0 to 1
FAR = 50.0  # largest cumulative hazard in a part, in place of an infinite one
DENSEST = 2**14  # largest number of closing speeds that are simulated in a part until one of them crashes


def with_impacts(lines: CrashLines, vehicle: Vehicle, law: SpeedLaw) -> tuple[CrashLines, Array]:
    """Divide the wide intervals of a crash map, and simulate the vehicle at some closing speeds in each part.

    With the divided map come the impact speeds [m/s] at `POINTS` closing speeds in each part, which are
    quantiles of the law there, NaN without a crash, shape (parts, POINTS).

    Every part contains a crash, but it may be a narrow stripe between these closing speeds. Such a part has
    the mean impact speed of the crashes at more and more closing speeds, until some are in the stripe.
    """
    if not lines.row.size:
        return lines, np.empty((0, POINTS))
    row, start, end, points = _divided(lines, law)
    # With few records, quantiles of the laws may exceed any speed that a vehicle accepts.
    points = np.minimum(points, SPEED_LIMIT)
    speed = _impact_speeds(lines, vehicle, row, points)
    width, count = np.where(np.isfinite(end), end, points[:, -1]) - start, POINTS
    while (count := 2 * count) <= DENSEST and (rest := np.flatnonzero(np.isnan(speed).all(axis=1))).size:
        inside = (np.arange(count) + 0.5) / count
        for part in np.array_split(rest, rest.size * count // ENCOUNTERS_AT_ONCE + 1):
            found = _impact_speeds(lines, vehicle, row[part], start[part, None] + width[part, None] * inside)
            speed[part, 0] = np.ma.masked_invalid(found).mean(axis=1).filled(np.nan)
    return replace(lines, row=row, start=start, end=end), speed


def _impact_speeds(lines: CrashLines, vehicle: Vehicle, row: NDArray[np.int_], points: Array) -> Array:
    """Return the impact speeds [m/s] at closing speeds on lines, NaN without a crash, (parts, points)."""
    outcomes = lines.simulate(vehicle, np.repeat(row, points.shape[1]), points.ravel())
    return np.where(outcomes.crash, outcomes.impact_speed, np.nan).reshape(points.shape)


def _divided(lines: CrashLines, law: SpeedLaw) -> tuple[NDArray[np.int_], Array, Array, Array]:
    """Return row, start, end and simulated closing speeds of each part of all intervals."""
    inner = np.minimum(lines.start[:, None] + STEPS, lines.end[:, None])
    edges = np.column_stack([lines.start, inner, lines.end])
    interval, part = np.nonzero(edges[:, :-1] < edges[:, 1:])
    row, low, high = lines.row[interval], edges[interval, part], edges[interval, part + 1]
    given = law.given(lines.places.only(row))
    start, end = given.cumulative(low), given.cumulative(high)
    start = np.where(np.isfinite(start), start, 0.0)  # the law may have no probability beyond a finite end
    levels = (start - np.log1p(share * np.expm1(start - end)) for share in INSIDE)
    points = [np.clip(given.inverse(np.minimum(level, start + FAR)), low, high) for level in levels]
    return row, low, high, np.column_stack(points)
