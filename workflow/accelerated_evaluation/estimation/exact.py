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
from accelerated_evaluation.distributions.lane_change_model import LaneChangeModel
from accelerated_evaluation.distributions.protocol import Array
from accelerated_evaluation.errors import InputError
from accelerated_evaluation.estimation.crash_map import CRASH, LINES_PER_CELL, CrashMap, Event, Grid
from accelerated_evaluation.sampling.cut_in import Proposal

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


def line_probabilities(
    crash_map: CrashMap, inverse_ttc: Distribution, event: Event = CRASH, closing_speed_max: float = np.inf
) -> Array:
    """Return the probability of an event on each line of the map, shape (lines,), under a law of TTC^-1.

    Parameters
    ----------
    closing_speed_max
        Closing speeds above are capped at this [m/s] before simulating: all are as at the cap. Without a cap
        all above the map's top are as at the top.

    Raises
    ------
    InputError
        If the cap lies above the top of the map.
    """
    top = crash_map.grid.closing_speed_top
    if top < closing_speed_max < np.inf:
        raise InputError(
            "closing-speed cap",
            seen=f"{closing_speed_max:g} m/s",
            expected=f"at most {top:g} m/s, to which the crash map was made",
            change="Raise crash_map.closing_speed_top in the configuration.",
        )
    intervals = crash_map.intervals(event)
    reached = intervals.start <= closing_speed_max
    line, start, end = intervals.line[reached], intervals.start[reached], intervals.end[reached]
    end = np.where(end > closing_speed_max, np.inf, end)
    inverse_range = crash_map.inverse_range[line]
    probability = interval_probability(inverse_ttc, start * inverse_range, end * inverse_range)
    return np.bincount(line, probability, crash_map.grid.lines)


def cell_weights(grid: Grid, lead_speeds: ArrayLike, inverse_range: Distribution) -> Array:
    """Return the probability of each cell of v_L and R^-1, shape (v_L cells, R^-1 cells); v_L is empirical.

    Raises
    ------
    InputError
        If a lead speed or a share of R^-1 lies outside the grid.
    """
    lead_speeds = np.asarray(lead_speeds, dtype=float)
    edges, range_edges = grid.lead_speed_edges, grid.inverse_range_edges
    if lead_speeds.min() < edges[0] or lead_speeds.max() > edges[-1]:
        raise _outside(
            "v_L", f"{lead_speeds.min():g} to {lead_speeds.max():g} m/s", f"{edges[0]:g} to {edges[-1]:g} m/s"
        )
    # The same inverse written two ways may differ in the last digit.
    if inverse_range.lower < range_edges[0] * (1 - 1e-12):
        raise _outside("R^-1", f"{inverse_range.lower:g} 1/m and more", f"{range_edges[0]:g} 1/m and more")
    speeds = np.histogram(lead_speeds, edges)[0] / lead_speeds.size
    return np.outer(speeds, interval_probability(inverse_range, range_edges[:-1], range_edges[1:]))


def _outside(what: str, seen: str, mapped: str) -> InputError:
    change = "Make the map for the limits of this model (configuration keys filters and crash_map)."
    return InputError(f"{what} of the model", seen=seen, expected=f"within the crash map: {mapped}", change=change)


def exact_probabilities(
    crash_map: CrashMap,
    model: LaneChangeModel,
    encounters: pd.DataFrame,
    event: Event = CRASH,
    closing_speed_max: float = np.inf,
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
    closing_speed_max
        Cap on closing speeds [m/s], as in `CutIn`.
    """
    speeds = encounters.groupby("segment")["lead_speed"]
    values = {}
    for segment in model.segments:
        weights = cell_weights(crash_map.grid, speeds.get_group(segment), model.inverse_range)
        lines = line_probabilities(crash_map, model.inverse_ttc[segment], event, closing_speed_max)
        values[segment] = weighed_lines(weights, lines)
    everything = sum(model.share(segment) * lines for segment, lines in values.items())
    return {segment: summed(lines) for segment, lines in (values | {ALL: everything}).items()}


def weighed_lines(weights: Array, lines: Array) -> Array:
    """Multiply the lines of each cell by its weight: shape (v_L cells, R^-1 cells, lines per cell)."""
    return weights[..., None] * lines.reshape(*weights.shape, LINES_PER_CELL)


def summed(lines: Array) -> Exact:
    """Add up the means of all cells; the two lines of a cell tell the variance of their mean."""
    probability = float(lines.mean(axis=-1).sum())
    return Exact(probability, float(np.sqrt(np.square(lines[..., 0] - lines[..., 1]).sum()) / 2))
