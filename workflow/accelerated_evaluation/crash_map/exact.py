"""Exact probabilities of an event: integrals of the density of a law of cut-ins over a crash map.

On each line of the map, the probability of the event is a sum of exact interval probabilities of the closing
speed. The total probability is a sum over the cells: the probability of the cell times the mean of its lines.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.crash_map.maps import LINES_PER_CELL, CrashMap
from accelerated_evaluation.laws import StratifiedLaw, Stratum
from accelerated_evaluation.scenarios.events import Event
from accelerated_evaluation.vehicles.protocol import CRASH

ALL = "all"


@dataclass(frozen=True)
class Exact:
    """A probability from a crash map.

    Its standard error is caused by the random places of the lines in the cells.
    """

    probability: float
    standard_error: float


def capped_intervals(
    crash_map: CrashMap, event: Event, closing_speed_max: float
) -> tuple[Array, Array, Array]:
    """Return the intervals of closing speeds in which an event happens, for a law with a cap.

    Under the law, a closing speed above the cap is simulated as the cap itself. An interval that contains the
    cap is therefore extended to infinity, and intervals that begin above the cap are removed. The result is
    the index of the line of each interval, and its ends [m/s], shape (intervals,) each. A cap of infinity
    means no cap. InputError is raised if the largest closing speed of the map is below the cap.
    """
    top = crash_map.grid.closing_speed_max
    if closing_speed_max < np.inf and closing_speed_max > top:
        raise _outside("closing speed", f"up to the cap of {closing_speed_max:g} m/s", f"up to {top:g} m/s")
    intervals = crash_map.intervals(event)
    reached = intervals.start <= closing_speed_max
    end = np.where(intervals.end > closing_speed_max, np.inf, intervals.end)
    return intervals.line[reached], intervals.start[reached], end[reached]


def cell_weights(crash_map: CrashMap, stratum: Stratum) -> Array:
    """Return the probability of each cell of v_L and R^-1 in one stratum, shape (cells,).

    InputError is raised if some lead speeds, or some ranges, are outside of the map.
    """
    grid, speeds = crash_map.grid, stratum.lead_speed
    if speeds.lower < grid.lead_speed_min or speeds.upper >= grid.lead_speed_max:
        mapped = f"[{grid.lead_speed_min:g}, {grid.lead_speed_max:g}) m/s"
        raise _outside("v_L", f"{speeds.lower:g} to {speeds.upper:g} m/s", mapped)
    # The inverse of a range may differ in its last digit, depending on how it was computed.
    if stratum.range_max > grid.range_max * (1 + 1e-12):
        raise _outside("range", f"up to {stratum.range_max:g} m", f"up to {grid.range_max:g} m")
    return stratum.cell_probability(crash_map.cells.lead_speed, crash_map.cells.inverse_range)


def weighted_lines(
    crash_map: CrashMap, stratum: Stratum, closing_speed_max: float, event: Event = CRASH
) -> Array:
    """Return P(cell of a line) times P(event on the line), shape (cells, 2).

    The mean of the two lines of a cell estimates the probability that a cut-in is in the cell and ends in the
    event. ``closing_speed_max`` is the cap of the law [m/s].
    """
    weights = cell_weights(crash_map, stratum)
    line, start, end = capped_intervals(crash_map, event, closing_speed_max)
    met = weights[line // LINES_PER_CELL] > 0  # a segment of v_L covers only a part of the map
    line = line[met]
    probability = stratum.closing_speed_probability(
        crash_map.lead_speed[line], crash_map.inverse_range[line], start[met], end[met]
    )
    probability *= crash_map.weights[line]
    lines = np.bincount(line, probability, crash_map.inverse_range.size).reshape(-1, LINES_PER_CELL)
    return weights[:, None] * lines


def _outside(what: str, seen: str, mapped: str) -> InputError:
    change = "Compute the map for the limits of this law (configuration keys filters and crash_map)."
    return InputError(f"{what} of the law", seen=seen, expected=f"within the map: {mapped}", change=change)


def exact_probabilities(crash_map: CrashMap, law: StratifiedLaw, event: Event = CRASH) -> dict[str, Exact]:
    """Return the probability of an event in each stratum of a law, and over all strata as ``all``.

    The latter is the mean over the strata, weighted by their shares.
    """
    values = {
        name: weighted_lines(crash_map, stratum, law.closing_speed_max, event)
        for name, stratum in law.strata.items()
    }
    everything = sum(law.shares[name] * lines for name, lines in values.items())
    return {name: _summed(lines) for name, lines in (values | {ALL: everything}).items()}


def _summed(lines: Array) -> Exact:
    """Return the sum over cells of the mean of their two lines, shape (cells, 2), with its standard error.

    The variance of the mean of the two lines of a cell is estimated from their difference.
    """
    probability = float(lines.mean(axis=1).sum())
    # A sum of shares may exceed 1 by rounding.
    return Exact(min(probability, 1.0), float(np.sqrt(np.square(np.diff(lines)).sum()) / 2))


def exact_table(crash_maps: Mapping[str, CrashMap], laws: Mapping[str, StratifiedLaw]) -> pd.DataFrame:
    """Tabulate the crash probability under each law, computed with maps of different resolutions."""
    rows = [
        (model, segment, resolution, crash_map.lead_speed.size, value.probability, value.standard_error)
        for model, law in laws.items()
        for resolution, crash_map in crash_maps.items()
        for segment, value in exact_probabilities(crash_map, law).items()
    ]
    columns = ["model", "segment", "resolution", "lines", "probability", "standard_error"]
    return pd.DataFrame(rows, columns=columns)
