"""The crash map: where in (v_L, R^-1, TTC^-1) a vehicle crashes, found once, for every probability model.

Lines of constant v_L and R^-1 are spread over a grid of cells, two at random in each. Along a line only the
closing speed varies: it is scanned from 0 to a top, and every change of an event is refined by bisection, so
what is left of a line is a list of intervals. TTC^-1 is closing speed times R^-1.
"""

import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from accelerated_evaluation.distributions.protocol import Array
from accelerated_evaluation.errors import InputError
from accelerated_evaluation.files import atomic_path
from accelerated_evaluation.vehicles.protocol import Outcomes, Vehicle

LINES_PER_CELL = 2  # their difference tells the error of the cell's mean
ENCOUNTERS_AT_ONCE = 500_000  # bounds the memory: about 100 MB


@dataclass(frozen=True, order=True)
class Event:
    """What may happen in an encounter.

    Attributes
    ----------
    quantity
        ``crash``; or ``min_range`` [m] or ``min_ttc`` [s], which happen at or below the threshold; or
        ``impact_speed`` [m/s], which happens above it.
    threshold
        In the unit of the quantity; a crash has none.
    """

    quantity: str
    threshold: float = 0.0

    def happens(self, outcomes: Outcomes) -> NDArray[np.bool_]:
        """Whether the event happened in each simulated encounter."""
        if self.quantity == "crash":
            return outcomes.crash
        values = getattr(outcomes, self.quantity)
        return values > self.threshold if self.quantity == "impact_speed" else values <= self.threshold


CRASH = Event("crash")


@dataclass(frozen=True)
class Intervals:
    """Where an event happens: on line ``line`` for closing speeds in [start, end) [m/s], shape (n,).

    An interval that reaches the top of the scan has an infinite end.
    """

    line: NDArray[np.int32]
    start: Array
    end: Array


@dataclass(frozen=True)
class Grid:
    """Cells of v_L, equal, and of R^-1, equal in the square root of the range; and how each line is scanned.

    Attributes
    ----------
    lead_speed_min, lead_speed_max
        Ends of the cells of v_L [m/s].
    range_max
        Largest range [m]; the cells of R^-1 go from its inverse to infinity.
    lead_speed_cells, range_cells
        How many cells.
    closing_speed_top
        Where the scan ends [m/s].
    closing_speed_points
        How many points it has, equal in the square root of the closing speed, as crashes at short ranges need
        but small ones. What is narrower than the distance of two points may be missed.
    """

    lead_speed_min: float
    lead_speed_max: float
    range_max: float
    lead_speed_cells: int
    range_cells: int
    closing_speed_top: float
    closing_speed_points: int

    @cached_property
    def lead_speed_edges(self) -> Array:
        """Edges of the cells of v_L [m/s], rising."""
        return np.linspace(self.lead_speed_min, self.lead_speed_max, self.lead_speed_cells + 1)

    @cached_property
    def inverse_range_edges(self) -> Array:
        """Edges of the cells of R^-1 [1/m], rising to infinity."""
        with np.errstate(divide="ignore"):
            return 1 / (self.range_max * np.linspace(1, 0, self.range_cells + 1) ** 2)

    @property
    def lines(self) -> int:
        """Number of lines, numbered by cell of v_L, then cell of R^-1, then place in the cell."""
        return self.lead_speed_cells * self.range_cells * LINES_PER_CELL

    def draw_lines(self, generator: np.random.Generator) -> tuple[Array, Array]:
        """Draw v_L [m/s] and R^-1 [1/m] of every line, uniformly in its cell, each of shape (lines,)."""
        shape = self.lead_speed_cells, self.range_cells, LINES_PER_CELL
        place = generator.random((2, *shape))
        cell = np.indices(shape)
        width = (self.lead_speed_max - self.lead_speed_min) / self.lead_speed_cells
        root = 1 - (cell[1] + place[1]) / self.range_cells  # square root of R / range_max, in (0, 1]
        return (self.lead_speed_min + width * (cell[0] + place[0])).ravel(), (1 / (self.range_max * root**2)).ravel()

    def refined(self, factor: float) -> "Grid":
        """Return the same grid with ``factor`` times as many cells of both kinds and points of the scan."""
        counts = ("lead_speed_cells", "range_cells", "closing_speed_points")
        return replace(self, **{name: max(1, round(getattr(self, name) * factor)) for name in counts})


@dataclass(frozen=True)
class CrashMap:
    """The lines of a grid with the intervals of every event.

    Attributes
    ----------
    lead_speed, inverse_range
        v_L [m/s] and R^-1 [1/m] of the lines, shape (lines,).
    events
        The intervals of each event.
    """

    grid: Grid
    lead_speed: Array
    inverse_range: Array
    events: Mapping[Event, Intervals]

    def smallest_inverse_ttc(self, event: Event = CRASH, closing_speed_max: float = np.inf) -> float:
        """Return the TTC^-1 [1/s] below which the event happens on no line; infinite if it never happens."""
        intervals = self.intervals(event)
        possible = intervals.start <= closing_speed_max
        return float(np.min((intervals.start * self.inverse_range[intervals.line])[possible], initial=np.inf))

    def intervals(self, event: Event) -> Intervals:
        """Return where an event happens.

        Raises
        ------
        InputError
            If the map was not made for the event.
        """
        if event not in self.events:
            raise InputError(
                "crash map",
                seen=f"{event}",
                expected=f"one of the map's events: {', '.join(map(str, self.events))}",
                change="Add the threshold to the configuration (key crash_map) and map anew.",
            )
        return self.events[event]


def map_crashes(
    vehicle: Vehicle, grid: Grid, events: Iterable[Event], generator: np.random.Generator, *, halvings: int = 10
) -> CrashMap:
    """Scan every line of the grid with the vehicle.

    Parameters
    ----------
    vehicle
        The car under test.
    grid
        Where to look, and how closely.
    events
        What to look for; crashes always are.
    generator
        Places the lines in their cells and the scans on their lines.
    halvings
        Bisections of a step of the scan.
    """
    events = sorted({CRASH, *events})
    lead_speed, inverse_range = grid.draw_lines(generator)
    offset = generator.random(grid.lines)
    found: dict[Event, list[Intervals]] = {event: [] for event in events}
    batch = max(1, ENCOUNTERS_AT_ONCE // grid.closing_speed_points)
    with tqdm(total=grid.lines, desc="crash map", unit=" lines") as progress:
        for first in range(0, grid.lines, batch):
            part = slice(first, min(first + batch, grid.lines))
            scan = _Scan(vehicle, lead_speed[part], 1 / inverse_range[part])
            points = _scan_points(offset[part], grid)
            for event, intervals in scan.find(points, events, halvings).items():
                found[event].append(Intervals(intervals.line + first, intervals.start, intervals.end))
            progress.update(part.stop - first)
    return CrashMap(grid, lead_speed, inverse_range, {event: _join(parts) for event, parts in found.items()})


def _scan_points(offset: Array, grid: Grid) -> Array:
    """Closing speeds [m/s] at which each line is scanned, shape (lines, points), rising; the last is the top."""
    steps = grid.closing_speed_points - 1
    share = np.column_stack([(np.arange(steps) + offset[:, None]) / steps, np.ones(offset.size)])
    return grid.closing_speed_top * share**2


def _join(parts: list[Intervals]) -> Intervals:
    columns = ([getattr(part, name) for part in parts] for name in ("line", "start", "end"))
    line, start, end = map(np.concatenate, columns)
    return Intervals(line.astype(np.int32), start, end)


@dataclass(frozen=True)
class _Scan:
    """The lines of one batch: v_L [m/s] and range [m], shape (lines,)."""

    vehicle: Vehicle
    lead_speed: Array
    range_: Array

    def find(self, points: Array, events: list[Event], halvings: int) -> dict[Event, Intervals]:
        """Return the intervals of each event, its lines numbered from 0."""
        every = np.repeat(np.arange(len(points)), points.shape[1])
        outcomes = self._simulate(every, points.ravel())
        flags = [event.happens(outcomes).reshape(points.shape) for event in events]
        changes = [np.nonzero(flag[:, 1:] != flag[:, :-1]) for flag in flags]
        refined = self._bisect(points, events, flags, changes, halvings)
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
        halvings: int,
    ) -> list[Array]:
        """Return the closing speed of each change of each event, all events bisected in one batch."""
        ends = np.cumsum([0, *(change[0].size for change in changes)])
        line, index = (np.concatenate(place) for place in zip(*changes, strict=True))
        low, high = points[line, index], points[line, index + 1]
        begins = np.concatenate([~flag[change] for flag, change in zip(flags, changes, strict=True)])
        for _ in range(halvings if line.size else 0):
            middle = (low + high) / 2
            outcomes = self._simulate(line, middle)
            happens = np.empty(line.size, dtype=bool)
            for event, first, last in zip(events, ends, ends[1:], strict=False):
                happens[first:last] = event.happens(outcomes)[first:last]
            low, high = np.where(happens == begins, low, middle), np.where(happens == begins, middle, high)
        return np.split((low + high) / 2, ends[1:-1])

    def _simulate(self, line: NDArray, closing_speed: Array) -> Outcomes:
        return self.vehicle.simulate(self.lead_speed[line], self.range_[line], closing_speed)


def _pair(flag: NDArray[np.bool_], line: NDArray, begins: NDArray[np.bool_], where: Array) -> Intervals:
    """Pair the closing speeds at which an event begins with those at which it ends, line by line."""
    at_bottom, at_top = np.flatnonzero(flag[:, 0]), np.flatnonzero(flag[:, -1])
    starts = np.concatenate([line[begins], at_bottom]), np.concatenate([where[begins], np.zeros(at_bottom.size)])
    ends = np.concatenate([line[~begins], at_top]), np.concatenate([where[~begins], np.full(at_top.size, np.inf)])
    order, order_of_ends = np.lexsort(starts[::-1]), np.lexsort(ends[::-1])
    return Intervals(starts[0][order].astype(np.int32), starts[1][order], ends[1][order_of_ends])


def write_crash_map(path: str | os.PathLike, crash_map: CrashMap) -> None:
    """Write a map as a compressed NumPy archive, atomically; equal maps give equal bytes."""
    arrays = {"grid": np.array(json.dumps(asdict(crash_map.grid)))}
    arrays |= {"lead_speed": crash_map.lead_speed, "inverse_range": crash_map.inverse_range}
    for event, intervals in crash_map.events.items():
        for name, values in vars(intervals).items():
            arrays[f"{event.quantity} {event.threshold!r} {name}"] = values
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **arrays)


def read_crash_map(path: str | os.PathLike) -> CrashMap:
    """Read what `write_crash_map` wrote.

    Raises
    ------
    InputError
        If the file is missing or no crash map.
    """
    try:
        with np.load(path) as archive:
            arrays = dict(archive)
        grid = Grid(**json.loads(str(arrays.pop("grid"))))
        lead_speed, inverse_range = arrays.pop("lead_speed"), arrays.pop("inverse_range")
        columns: dict[Event, dict[str, NDArray]] = {}
        for key, values in arrays.items():
            quantity, threshold, name = key.split()
            columns.setdefault(Event(quantity, float(threshold)), {})[name] = values
        events = {event: Intervals(**parts) for event, parts in columns.items()}
    except (OSError, ValueError, KeyError, TypeError, BadZipFile) as error:
        seen, expected = f"{type(error).__name__}: {error}", "a crash map"
        raise InputError(str(path), seen=seen, expected=expected, change="Map the crashes anew.") from error
    return CrashMap(grid, lead_speed, inverse_range, events)
