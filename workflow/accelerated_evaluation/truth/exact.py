"""Exact probabilities: a crash map weighed with a lane-change model.

Along a line of the map the probability of an event is a sum of exact interval probabilities of TTC^-1; over
the lines it is a mean weighed with the probabilities of the cells.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from accelerated_evaluation.distributions import Distribution, Mixture
from accelerated_evaluation.distributions.protocol import Array
from accelerated_evaluation.errors import InputError
from accelerated_evaluation.laws.lane_change_model import LaneChangeModel
from accelerated_evaluation.truth.crash_map import LINES_PER_CELL, CrashMap
from accelerated_evaluation.vehicles.events import CRASH, Event

ALL = "all"


@dataclass(frozen=True)
class Exact:
    """A probability, and the standard error that the random places of the lines leave."""

    probability: float
    standard_error: float


def interval_probability(law: Distribution, start: ArrayLike, end: ArrayLike) -> Array:
    """P(start <= X < end), element by element, without a difference of nearly equal numbers.

    A mixture is summed component by component, over those alone that reach into an interval.
    """
    start, end = np.broadcast_arrays(np.asarray(start, dtype=float), np.asarray(end, dtype=float))
    if not isinstance(law, Mixture):
        low = law.logsf(start)
        with np.errstate(invalid="ignore"):
            return np.where(np.isneginf(low), 0.0, np.exp(low) * -np.expm1(law.logsf(end) - low))
    total = np.zeros(start.shape)
    for weight, component in zip(law.weights, law.components, strict=True):
        reached = (start < component.upper) & (end > component.lower)
        total[reached] += weight * interval_probability(component, start[reached], end[reached])
    return total


def line_probabilities(crash_map: CrashMap, inverse_ttc: Distribution, event: Event = CRASH) -> Array:
    """Return the probability of an event on the lines of each cell, shape (cells, 2), for a law of TTC^-1."""
    intervals = crash_map.intervals(event)
    inverse_range = crash_map.inverse_range[intervals.line]
    probability = interval_probability(
        inverse_ttc, intervals.start * inverse_range, intervals.end * inverse_range
    )
    return np.bincount(intervals.line, probability, crash_map.inverse_range.size).reshape(-1, LINES_PER_CELL)


def cell_shares(crash_map: CrashMap, lead_speeds: ArrayLike) -> Array:
    """Return the share of the lead speeds in each cell, shape (cells,).

    Raises
    ------
    InputError
        If one lies outside the map.
    """
    speeds, grid = np.sort(lead_speeds), crash_map.grid
    if speeds[0] < grid.lead_speed_min or speeds[-1] >= grid.lead_speed_max:
        mapped = f"[{grid.lead_speed_min:g}, {grid.lead_speed_max:g}) m/s"
        raise _outside("v_L", f"{speeds[0]:g} to {speeds[-1]:g} m/s", mapped)
    return np.diff(np.searchsorted(speeds, crash_map.cells.lead_speed), axis=1)[:, 0] / speeds.size


def cell_weights(crash_map: CrashMap, lead_speeds: ArrayLike, inverse_range: Distribution) -> Array:
    """Return the probability of each cell of v_L, which is empirical, and R^-1, shape (cells,).

    Raises
    ------
    InputError
        If a lead speed or a share of R^-1 lies outside the map.
    """
    range_max = crash_map.grid.range_max
    # The same inverse written in two ways may differ in the last digit.
    if inverse_range.lower * range_max < 1 - 1e-12:
        mapped = f"{1 / range_max:g} 1/m and more"
        raise _outside("R^-1", f"{inverse_range.lower:g} 1/m and more", mapped)
    shares = cell_shares(crash_map, lead_speeds)
    return shares * interval_probability(inverse_range, *crash_map.cells.inverse_range.T)


def _outside(what: str, seen: str, mapped: str) -> InputError:
    change = "Make the map for the limits of this model (configuration key filters)."
    return InputError(f"{what} of the model", seen=seen, expected=f"within the map: {mapped}", change=change)


def exact_probabilities(
    crash_map: CrashMap,
    model: LaneChangeModel,
    encounters: pd.DataFrame,
    event: Event = CRASH,
) -> dict[str, Exact]:
    """Return the probability of an event in each segment of the model, and in ``all`` by their shares.

    Parameters
    ----------
    crash_map
        Of the vehicle under test.
    model
        f.
    encounters
        Encounter table; the lead speeds of each segment are taken from it.
    event
        One of the map's.
    """
    speeds = encounters.groupby("segment")["lead_speed"]
    values = {}
    for segment in model.segments:
        weights = cell_weights(crash_map, speeds.get_group(segment), model.inverse_range)
        lines = line_probabilities(crash_map, model.inverse_ttc[segment], event)
        values[segment] = weights[:, None] * lines
    everything = sum(model.share(segment) * lines for segment, lines in values.items())
    return {segment: summed(lines) for segment, lines in (values | {ALL: everything}).items()}


def summed(lines: Array) -> Exact:
    """Add up the means of all cells; the two lines of a cell tell the variance of their mean."""
    probability = float(lines.mean(axis=1).sum())
    return Exact(probability, float(np.sqrt(np.square(np.diff(lines)).sum()) / 2))


def exact_table(
    crash_maps: Mapping[str, CrashMap], models: Mapping[str, LaneChangeModel], encounters: pd.DataFrame
) -> pd.DataFrame:
    """Tabulate the crash probability of each model by maps of different resolution.

    Returns
    -------
    pandas.DataFrame
        Columns ``model``, ``segment``, ``resolution`` (name of the map), ``lines``, ``probability`` and
        ``standard_error``.
    """
    rows = [
        (model, segment, resolution, crash_map.lead_speed.size, value.probability, value.standard_error)
        for model, law in models.items()
        for resolution, crash_map in crash_maps.items()
        for segment, value in exact_probabilities(crash_map, law, encounters).items()
    ]
    columns = ["model", "segment", "resolution", "lines", "probability", "standard_error"]
    return pd.DataFrame(rows, columns=columns)
