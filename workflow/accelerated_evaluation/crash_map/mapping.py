"""Compute a crash map: scan its lines with simulations, and refine the ends of intervals by bisection."""

from collections.abc import Callable, Iterable
from dataclasses import fields, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter
from scipy.special import softmax

from accelerated_evaluation.base.arguments import one_of
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.checking import checked
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.randomness import A_GENERATOR
from accelerated_evaluation.crash_map.intervals import ENCOUNTERS_AT_ONCE, Intervals, in_batches, intervals_on
from accelerated_evaluation.crash_map.maps import LINES_PER_CELL, Cells, CrashMap, Grid
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
    simulate_inner,
)

STANDSTILL = 1e-6  # first point of a scan, as a share of the square root of the largest closing speed
MARGIN = 2  # number of steps of the coarse scan that are added on both sides of the changes of the outcome
LEAST_EFFORT = 1 / 8  # smallest effort for a row of v_L, relative to the row with the most events
OTHER_EVENTS = 0.5  # parts of the sides of cells for other events, relative to those for crashes
WITH_INNER = 0.75  # the same for random vehicles, whose lines differ however small the cell is
# Number of draws of the inner variables of a random vehicle from which those of a line are chosen, bisections
# to find the closing speed at which each begins to crash, and share that is chosen without regard to it.
CANDIDATES, BISECTIONS, EVEN = 24, 4, 0.2


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
    named = {event_named(each) if isinstance(each, str) else each for each in events}
    mapped = sorted({CRASH} | named)
    _require_repeating(vehicle)
    whole = grid.cells(np.ones((grid.lead_speed_cells, grid.range_cells), dtype=int))
    coarse = _map_cells(vehicle, grid, whole, mapped, generator)
    _require_repeating(vehicle)  # the simulations so far may have shown that the outcomes are random
    parts = np.maximum.reduce([_parts(coarse, each) for each in mapped])
    return _map_cells(vehicle, grid, grid.cells(parts), mapped, generator)


def _require_repeating(vehicle: Vehicle) -> None:
    """Raise InputError if the vehicle is known to have random outcomes, but is not a `RandomVehicle`."""
    if repeats_itself(vehicle) is False and not isinstance(vehicle, RandomVehicle):
        raise InputError(
            "crash map of the vehicle",
            seen="a vehicle whose outcomes are random",
            expected="a vehicle with deterministic outcomes: a map has one outcome for each encounter",
            change="Use `accelerated-evaluation estimate`, which also accepts vehicles with random outcomes.",
        )


def _parts(coarse: CrashMap, event: Event) -> NDArray[np.int_]:
    """Return the number of parts into which the sides of each cell are divided for an event.

    With k x k parts, the error of a cell is proportional to 1 / k^2, and the number of lines to k^2. The
    optimal k is therefore proportional to the cube root of the difference between the two lines of the cell.
    The lines differ in the event and in the density of their ranges, which matters even where the event
    always happens. Of each cell and its neighbours, the largest difference is used, because the event may
    extend into a cell in which it was not found. Rows of v_L with few events are divided less, but not below
    a limit.
    """
    grid, found, inverse_range = coarse.grid, coarse.intervals(event), coarse.inverse_range
    start, end = (
        np.exp(-speed * inverse_range[found.line] / grid.reference_inverse_ttc)
        for speed in (found.start, found.end)
    )
    lines = np.bincount(found.line, start - end, inverse_range.size) * coarse.reference
    spread = np.ptp(lines.reshape(-1, LINES_PER_CELL), axis=1)
    spread = maximum_filter(spread.reshape(grid.lead_speed_cells, grid.range_cells), size=3)
    row = spread.max(axis=1, keepdims=True)
    if not row.any():
        return np.ones(spread.shape, dtype=int)
    share = np.divide(spread, row, out=np.zeros_like(spread), where=row > 0)
    share *= np.maximum(row / row.max(), LEAST_EFFORT)
    effort = (1 if event == CRASH else OTHER_EVENTS) * (1 if coarse.inner is None else WITH_INNER)
    return np.maximum(np.ceil(effort * grid.refinement * np.cbrt(share)), 1).astype(int)


def _map_cells(
    vehicle: Vehicle,
    grid: Grid,
    cells: Cells,
    events: list[Event],
    generator: np.random.Generator,
) -> CrashMap:
    """Scan two lines in each cell."""
    lead_speed, inverse_range = cells.draw_lines(generator)
    lines = lead_speed.size
    offset = generator.random(lines)
    empty = CrashMap(grid, cells, lead_speed, inverse_range, {}, vehicle=identity_of(vehicle))
    points = grid.closing_speed_points
    if isinstance(vehicle, RandomVehicle):
        empty = _with_inner(vehicle, empty, generator)
        # The search for the drivers is paid for by fewer points on each line.
        points = max(points - CANDIDATES * BISECTIONS, points // 2)

    def simulate(line: NDArray, share: Array) -> Outcomes:
        return empty.simulate(vehicle, line, grid.closing_speed_max * share**2)

    def find(line: NDArray) -> dict[Event, Intervals]:
        share, outcomes = _points(simulate, line, offset[line], points)
        found = intervals_on(line, share, outcomes, events, (0.0, np.inf), simulate)
        return {
            event: Intervals(each.line, *(grid.closing_speed_max * end**2 for end in (each.start, each.end)))
            for event, each in found.items()
        }

    return replace(empty, events=in_batches(lines, points, find, "crash map"))


def _with_inner(vehicle: RandomVehicle, empty: CrashMap, generator: np.random.Generator) -> CrashMap:
    """Return the lines of a map, each with one of `CANDIDATES` draws of the inner variables and its weight.

    Few drivers cause most crashes, so the draws that crash at small closing speeds are chosen more often, in
    proportion to the reference probability of such a closing speed on the line. The weight is the inverse of
    the probability of the choice, and integrals over the inner variables remain unbiased.
    """
    grid, lines, found = empty.grid, np.arange(empty.lead_speed.size), []
    for line in np.array_split(lines, lines.size * CANDIDATES // ENCOUNTERS_AT_ONCE + 1):
        row = np.repeat(line, CANDIDATES)
        inner = vehicle.draw_inner(row.size, generator)
        low, high = np.zeros(row.size), np.ones(row.size)  # shares of the root of the largest closing speed
        for _ in range(BISECTIONS):
            middle = (low + high) / 2
            cut_ins = *empty.place(row), grid.closing_speed_max * middle**2
            crash = simulate_inner(vehicle, cut_ins, inner).crash
            low, high = np.where(crash, low, middle), np.where(crash, middle, high)
        beyond = -grid.closing_speed_max * ((low + high) / 2) ** 2 * empty.inverse_range[row]
        shape = line.size, CANDIDATES
        danger = softmax(beyond.reshape(shape) / grid.reference_inverse_ttc, axis=1)
        chance = EVEN / CANDIDATES + (1 - EVEN) * danger
        below = chance.cumsum(axis=1) < generator.random((line.size, 1))
        chosen = np.arange(line.size), below.sum(axis=1).clip(max=CANDIDATES - 1)
        found.append((inner.reshape(*shape, -1)[chosen], 1 / (CANDIDATES * chance[chosen])))
    inner, weight = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return replace(empty, inner=inner, inner_weight=weight)


def _points(
    simulate: Callable[[NDArray, Array], Outcomes], line: NDArray, offset: Array, points: int
) -> tuple[Array, Outcomes]:
    """Return the closing speeds to scan on lines, and their simulated outcomes.

    A quarter of the points cover the whole line. The others are placed near the closing speeds at which
    crashes begin and end, because most holes and islands of the crash set are there. If the outcome does not
    change along the line, they are placed where the smallest range was observed. The first array has the
    shape (lines, points); it has shares of the square root of the largest closing speed, in increasing order.
    """
    coarse = max(points // 4, 3)  # the ends and one between, however coarse the grid is
    fine = max(points - coarse, 1)
    offset, ends = np.maximum(offset, STANDSTILL)[:, None], np.ones((offset.size, 1))
    inner = (np.arange(coarse - 2) + offset) / (coarse - 2)
    share = np.hstack([STANDSTILL * ends, inner, ends])
    on_line = simulate(np.repeat(line, coarse), share.ravel())
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
    near_changes = simulate(np.repeat(line, fine), between.ravel())
    share = np.hstack([share, between])
    order = np.argsort(share, axis=1, kind="stable")  # fast, because both parts are in order
    outcomes = (
        np.hstack([getattr(part, one.name).reshape(offset.size, -1) for part in (on_line, near_changes)])
        for one in fields(Outcomes)
    )
    return (
        np.take_along_axis(share, order, axis=1),
        Outcomes(*(np.take_along_axis(values, order, axis=1).ravel() for values in outcomes)),
    )
