"""Compute a crash map: scan its lines with simulations, and refine the ends of intervals by bisection."""

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter
from tqdm import tqdm

from accelerated_evaluation.base.arguments import one_of
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.checking import checked
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.randomness import A_GENERATOR
from accelerated_evaluation.crash_map.maps import LINES_PER_CELL, Cells, CrashMap, Grid, Intervals
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.scenarios.events import Event
from accelerated_evaluation.vehicles.loading import as_vehicle, checked_vehicle, identity_of
from accelerated_evaluation.vehicles.protocol import (
    CRASH,
    EVENTS,
    Outcomes,
    RandomVehicle,
    Vehicle,
    event_named,
    repeats_itself,
)

STANDSTILL = 1e-6  # first point of a scan, as a share of the square root of the largest closing speed
HALVINGS = 10  # number of bisections of a step of the scan
MARGIN = 2  # number of steps of the coarse scan that are added on both sides of the changes of the outcome
LEAST_EFFORT = 1 / 8  # smallest effort for a row of v_L, relative to the row with the most crashes
ENCOUNTERS_AT_ONCE = 500_000  # number of encounters that are simulated at once, which need about 100 MB


@checked(grid=one_of(Grid, words="a grid"), events=EVENTS, generator=A_GENERATOR)
def map_crashes(
    vehicle: Vehicle, grid: Grid, events: Iterable[Event | str], generator: np.random.Generator | int
) -> CrashMap:
    """Compute the crash map of a vehicle.

    First, a coarse map is computed, which determines how finely each cell is divided. The final map then has
    new random lines.

    Parameters
    ----------
    vehicle
        The car under test, or its name.
    grid
        Cells and resolution of the map.
    events
        Events to map, or texts such as ``impact_speed=5``; crashes are always included.
    generator
        Source of the random places of the lines in their cells, and of the scan points on the lines; or a
        seed.

    Returns
    -------
    CrashMap
        The map, with the intervals of closing speeds of each event.

    Raises
    ------
    InputError
        If the outcomes of the vehicle are not valid, or if they are random and it is not a `RandomVehicle`,
        because it then has no crash map.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> limits = {"lead_speed_min": 5, "lead_speed_max": 35, "range_max": 75}
    >>> cells = {"lead_speed_cells": 2, "range_cells": 3, "refinement": 2}
    >>> grid = ae.Grid(**limits, **cells, closing_speed_max=60, closing_speed_points=40)
    >>> crash_map = ae.map_crashes("acc_aeb", grid, ["impact_speed=5"], 1)
    """
    vehicle = checked_vehicle(as_vehicle(vehicle, CUT_IN, "map_crashes, argument vehicle"), CUT_IN)
    events = [event_named(each) if isinstance(each, str) else each for each in events]
    _require_repeating(vehicle)
    whole = grid.cells(np.ones((grid.lead_speed_cells, grid.range_cells), dtype=int))
    coarse = _map_cells(vehicle, grid, whole, [CRASH], generator)
    _require_repeating(vehicle)  # the simulations so far may have shown that the outcomes are random
    return _map_cells(vehicle, grid, grid.cells(_parts(coarse)), sorted({CRASH, *events}), generator)


def _require_repeating(vehicle: Vehicle) -> None:
    """Raise InputError if the vehicle is known to have random outcomes, but is not a `RandomVehicle`."""
    if repeats_itself(vehicle) is False and not isinstance(vehicle, RandomVehicle):
        raise InputError(
            "crash map of the vehicle",
            seen="a vehicle whose outcomes are random",
            expected="a vehicle with deterministic outcomes: a map has one outcome for each encounter",
            change="Use `accelerated-evaluation estimate`, which also accepts vehicles with random outcomes.",
        )


def _parts(coarse: CrashMap) -> NDArray[np.int_]:
    """Return the number of parts into which the sides of each cell are divided, from a coarse map.

    With k x k parts, the error of a cell is proportional to 1 / k^2, and the number of lines to k^2. The
    optimal k is therefore proportional to the cube root of the difference between the two lines of the cell.
    Of each cell and its neighbours, the largest difference is used, because the crash set may extend into a
    cell in which no crash was found. Rows of v_L with few crashes are divided less, but not below a limit.
    """
    grid, crash = coarse.grid, coarse.intervals(CRASH)
    inverse_range = coarse.inverse_range[crash.line]
    mass = np.exp(-crash.start * inverse_range / grid.reference_inverse_ttc)
    mass -= np.exp(-crash.end * inverse_range / grid.reference_inverse_ttc)
    lines = np.bincount(crash.line, mass, coarse.inverse_range.size).reshape(-1, LINES_PER_CELL)
    low, high = np.exp(-coarse.cells.inverse_range.T / grid.reference_inverse_range)
    spread = np.ptp(lines, axis=1) * (low - high)
    spread = maximum_filter(spread.reshape(grid.lead_speed_cells, grid.range_cells), size=3)
    row = spread.max(axis=1, keepdims=True)
    if not row.any():
        return np.ones(spread.shape, dtype=int)
    share = np.divide(spread, row, out=np.zeros_like(spread), where=row > 0)
    share *= np.maximum(row / row.max(), LEAST_EFFORT)
    return np.maximum(np.ceil(grid.refinement * np.cbrt(share)), 1).astype(int)


def _map_cells(
    vehicle: Vehicle,
    grid: Grid,
    cells: Cells,
    events: list[Event],
    generator: np.random.Generator,
) -> CrashMap:
    """Scan two lines in each cell, in batches that limit the memory."""
    lead_speed, inverse_range = cells.draw_lines(generator)
    lines = lead_speed.size
    offset = generator.random(lines)
    inner = vehicle.draw_inner(lines, generator) if isinstance(vehicle, RandomVehicle) else None
    empty = CrashMap(grid, cells, lead_speed, inverse_range, {}, inner, identity_of(vehicle))
    found: dict[Event, list[Intervals]] = {event: [] for event in events}
    batch = max(1, ENCOUNTERS_AT_ONCE // grid.closing_speed_points)
    with tqdm(total=lines, desc="crash map", unit=" lines") as progress:
        for first in range(0, lines, batch):
            part = slice(first, min(first + batch, lines))
            scan = _Scan(vehicle, empty, first)
            for event, intervals in scan.find(*scan.points(offset[part], grid), events).items():
                found[event].append(Intervals(intervals.line + first, intervals.start, intervals.end))
            progress.update(part.stop - first)
    joined = {event: _join(parts) for event, parts in found.items()}
    return replace(empty, events=joined)


def _join(parts: list[Intervals]) -> Intervals:
    columns = ([getattr(part, name) for part in parts] for name in ("line", "start", "end"))
    line, start, end = map(np.concatenate, columns)
    return Intervals(line.astype(np.int32), start, end)


@dataclass(frozen=True)
class _Scan:
    """The scan of one batch of lines of a map, whose first line has the index ``first``."""

    vehicle: Vehicle
    lines: CrashMap
    first: int

    def points(self, offset: Array, grid: Grid) -> tuple[Array, Outcomes]:
        """Return the closing speeds [m/s] to scan on each line, and their simulated outcomes.

        A quarter of the points cover the whole line. The others are placed near the closing speeds at which
        crashes begin and end, because most holes and islands of the crash set are there. If the outcome does
        not change along the line, they are placed where the smallest range was observed. The first array has
        the shape (lines, points), with closing speeds in increasing order.
        """
        coarse = grid.closing_speed_points // 4
        fine = grid.closing_speed_points - coarse
        offset, ends = np.maximum(offset, STANDSTILL)[:, None], np.ones((offset.size, 1))
        # Shares of the square root of the largest closing speed.
        inner = (np.arange(coarse - 2) + offset) / (coarse - 2)
        share = np.hstack([STANDSTILL * ends, inner, ends])
        on_line = self._simulate(*self._flat(grid.closing_speed_max * share**2))
        crash = on_line.crash.reshape(share.shape)
        changes = crash[:, 1:] != crash[:, :-1]
        nearest = np.argmin(on_line.min_range.reshape(share.shape), axis=1)
        some = changes.any(axis=1)
        first = np.where(some, np.argmax(changes, axis=1), nearest) - MARGIN
        last = np.where(some, coarse - 1 - np.argmax(changes[:, ::-1], axis=1), nearest) + MARGIN
        low, high = (
            np.take_along_axis(share, np.clip(end, 0, coarse - 1)[:, None], axis=1) for end in (first, last)
        )
        between = low + (high - low) * (np.arange(fine) + offset) / fine
        near_changes = self._simulate(*self._flat(grid.closing_speed_max * between**2))
        share = np.hstack([share, between])
        order = np.argsort(share, axis=1, kind="stable")  # fast, because both parts are in order
        outcomes = (
            np.hstack([getattr(part, one.name).reshape(offset.size, -1) for part in (on_line, near_changes)])
            for one in fields(Outcomes)
        )
        return (
            grid.closing_speed_max * np.take_along_axis(share, order, axis=1) ** 2,
            Outcomes(*(np.take_along_axis(values, order, axis=1).ravel() for values in outcomes)),
        )

    def find(self, points: Array, outcomes: Outcomes, events: list[Event]) -> dict[Event, Intervals]:
        """Return the intervals of closing speeds of each event, from the scanned points and their outcomes.

        The index of a line is counted from the first line of the batch.
        """
        flags = [event.happens(outcomes).reshape(points.shape) for event in events]
        changes = [np.nonzero(flag[:, 1:] != flag[:, :-1]) for flag in flags]
        refined = self._bisect(points, events, flags, changes)
        return {
            event: _pair(flag, change[0], flag[change[0], change[1] + 1], where)
            for event, flag, change, where in zip(events, flags, changes, refined, strict=True)
        }

    def _bisect(
        self,
        points: Array,
        events: list[Event],
        flags: list[NDArray[np.bool_]],
        changes: list[tuple[NDArray, NDArray]],
    ) -> list[Array]:
        """Return the closing speed of each change of each event, by a bisection of all events at once."""
        ends = np.cumsum([0, *(change[0].size for change in changes)])
        line, index = (np.concatenate(place) for place in zip(*changes, strict=True))
        low, high = points[line, index], points[line, index + 1]
        begins = np.concatenate([~flag[change] for flag, change in zip(flags, changes, strict=True)])
        for _ in range(HALVINGS if line.size else 0):
            middle = ((np.sqrt(low) + np.sqrt(high)) / 2) ** 2
            outcomes = self._simulate(line, middle)
            happens = np.empty(line.size, dtype=bool)
            for event, first, last in zip(events, ends, ends[1:], strict=False):
                happens[first:last] = event.happens(outcomes)[first:last]
            low, high = np.where(happens == begins, low, middle), np.where(happens == begins, middle, high)
        return np.split((low + high) / 2, ends[1:-1])

    @staticmethod
    def _flat(points: Array) -> tuple[NDArray[np.int_], Array]:
        """Return the line and the closing speed of each point."""
        return np.repeat(np.arange(len(points)), points.shape[1]), points.ravel()

    def _simulate(self, line: NDArray, closing_speed: Array) -> Outcomes:
        return self.lines.simulate(self.vehicle, self.first + line, closing_speed)


def _pair(flag: NDArray[np.bool_], line: NDArray, begins: NDArray[np.bool_], where: Array) -> Intervals:
    """Pair the closing speeds at which an event begins with those at which it ends, line by line."""
    at_bottom, at_top = np.flatnonzero(flag[:, 0]), np.flatnonzero(flag[:, -1])

    def in_order(chosen: NDArray[np.bool_], edge: NDArray, value: float) -> tuple[NDArray, Array]:
        lines = np.concatenate([line[chosen], edge])
        speeds = np.concatenate([where[chosen], np.full(edge.size, value)])
        order = np.lexsort([speeds, lines])
        return lines[order], speeds[order]

    (lines, start), (_, end) = in_order(begins, at_bottom, 0.0), in_order(~begins, at_top, np.inf)
    return Intervals(lines.astype(np.int32), start, end)
