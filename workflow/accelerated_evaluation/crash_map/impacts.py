"""Impact speeds in the intervals of a crash map."""

from dataclasses import replace

import numpy as np

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.laws.smooth.conditional import SpeedLaw
from accelerated_evaluation.scenarios.cut_in import SPEED_LIMIT
from accelerated_evaluation.vehicles.protocol import Vehicle

PARTS = 8  # number of parts of a wide interval of a crash map
POINTS = 4  # number of closing speeds that are simulated in a part
INSIDE = (np.arange(POINTS) + 0.5) / POINTS  # positions of these closing speeds in the part, from 0 to 1
NARROW = 0.5  # [m/s], intervals up to this width are not divided
TAIL = 4  # exponent by which the parts at large closing speeds have smaller probabilities
FAR = 50.0  # largest cumulative hazard in a part, in place of an infinite one


def with_impacts(lines: CrashLines, vehicle: Vehicle, law: SpeedLaw) -> tuple[CrashLines, Array]:
    """Divide the wide intervals of a crash map, and simulate the vehicle at some closing speeds in each part.

    Quantiles of the law of the closing speed determine the ends of the parts. With the divided map come the
    impact speeds [m/s] at `POINTS` closing speeds in each part, NaN without a crash, shape (parts, POINTS).
    """
    if not lines.row.size:
        return lines, np.empty((0, POINTS))
    wide = lines.end - lines.start > NARROW
    divided = _whole(_only(lines, ~wide)), _divided(_only(lines, wide), law)
    row, start, end, points = (np.concatenate(column) for column in zip(*divided, strict=True))
    # With few records, quantiles of the laws may exceed any speed that a vehicle accepts.
    points = np.minimum(points, SPEED_LIMIT)
    outcomes = lines.simulate(vehicle, np.repeat(row, POINTS), points.ravel())
    speed = np.where(outcomes.crash, outcomes.impact_speed, np.nan).reshape(points.shape)
    return replace(lines, row=row, start=start, end=end), speed


def _only(lines: CrashLines, chosen: Array) -> CrashLines:
    return replace(lines, row=lines.row[chosen], start=lines.start[chosen], end=lines.end[chosen])


def _whole(lines: CrashLines) -> tuple[Array, Array, Array, Array]:
    """Return row, start, end and simulated closing speeds of intervals that are not divided."""
    points = lines.start[:, None] + (lines.end - lines.start)[:, None] * INSIDE
    return lines.row, lines.start, lines.end, points


def _divided(lines: CrashLines, law: SpeedLaw) -> tuple[Array, Array, Array, Array]:
    """Return row, start, end and simulated closing speeds of each part of all intervals."""
    given = law.given(lines.places.only(lines.row))
    start, end = given.cumulative(lines.start), given.cumulative(lines.end)
    start = np.where(np.isfinite(start), start, 0.0)  # the law may have no probability beyond a finite end

    def above(share: float) -> Array:
        """Return the closing speed above which a given share of the probability of each interval lies."""
        level = start - np.log1p((1 - share) * np.expm1(start - end))
        return np.clip(given.inverse(np.minimum(level, start + FAR)), lines.start, lines.end)

    shares = (1 - np.arange(PARTS + 1) / PARTS) ** TAIL
    edges = np.column_stack([lines.start, *(above(share) for share in shares[1:-1]), lines.end])
    inside = shares[:-1, None] + np.diff(shares)[:, None] * INSIDE
    points = np.column_stack([above(share) for share in inside.ravel()]).reshape(-1, POINTS)
    return np.repeat(lines.row, PARTS), edges[:, :-1].ravel(), edges[:, 1:].ravel(), points
