"""The crash map: the set of (v_L, R^-1, closing speed) in which a vehicle crashes, for use with any law.

The plane of v_L and R^-1 is divided into cells, and each cell contains two random lines along which only the
closing speed varies. Each line is scanned from 0 to a largest closing speed, and every change of an event is
refined by bisection. The result for a line is a list of intervals of closing speeds. TTC^-1 is the closing
speed times R^-1.

If the outcomes of the vehicle depend on random inner variables that can be drawn (`RandomVehicle`), each line
also has its own values of the inner variables, drawn at random like its place, and weighted (`_with_inner` in
`crash_map.mapping`). The integral over the map then includes an integral over the inner variables, and the
difference between the two lines of a cell contains the errors of both.
"""

import json
import os
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from accelerated_evaluation.base.arguments import a_number
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.checking import checked
from accelerated_evaluation.base.errors import DAMAGE, InputError, readable
from accelerated_evaluation.base.files import read_arrays, write_arrays
from accelerated_evaluation.crash_map.intervals import Intervals
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.scenarios.events import Event
from accelerated_evaluation.vehicles.protocol import CRASH, Outcomes, Vehicle, simulate_inner

TAIL = 4  # index of the Pareto reference distribution of R^-1
LINES_PER_CELL = 2  # the standard error of the mean of a cell is estimated from the difference of its lines
POSITIVE, COUNT = a_number(1e-9, 1e9), a_number(1, 100_000, whole=True)


@checked(
    lead_speed_min=a_number(0, 1e9),
    lead_speed_max=POSITIVE,
    range_max=POSITIVE,
    lead_speed_cells=COUNT,
    range_cells=COUNT,
    refinement=COUNT,
    closing_speed_max=POSITIVE,
    closing_speed_points=COUNT,
    reference_inverse_range=POSITIVE,
    reference_inverse_ttc=POSITIVE,
)
@dataclass(frozen=True, kw_only=True)
class Grid:
    """Cells and resolution of a crash map.

    At first, the plane is divided into equal cells of v_L and of the square root of the range. Each cell is
    then divided into up to ``refinement`` by ``refinement`` parts, most finely where the probability of
    crashes on lines varies most under a reference law, and half as finely for other events. The reference law
    only controls the resolution. It influences the errors of the computed probabilities, but not their
    expected values.

    Attributes
    ----------
    lead_speed_min, lead_speed_max
        Smallest and largest v_L of the map [m/s]; the upper end is excluded.
    range_max
        Largest range [m]; the cells of R^-1 cover the interval from its inverse to infinity.
    lead_speed_cells, range_cells, refinement
        Initial numbers of cells of v_L and of the range, and largest number of parts of their sides.
    closing_speed_max
        Upper end of the scan of a line [m/s]. If the law has a cap on closing speeds, this is the cap;
        otherwise it is a speed above which the outcome no longer changes.
    closing_speed_points
        Number of scan points, equally spaced in the square root of the closing speed, because crashes at
        short ranges occur at small closing speeds. Intervals that are narrower than the distance between two
        points may be missed.
    reference_inverse_range, reference_inverse_ttc
        Scale of the reference distribution of R^-1 [1/m], which is a Pareto distribution, and mean of that of
        TTC^-1 [1/s], which is exponential; that of v_L is uniform.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> limits = {"lead_speed_min": 5, "lead_speed_max": 35, "range_max": 75}
    >>> cells = {"lead_speed_cells": 6, "range_cells": 8, "refinement": 4}
    >>> grid = ae.Grid(**limits, **cells, closing_speed_max=60, closing_speed_points=40)
    """

    lead_speed_min: float
    lead_speed_max: float
    range_max: float
    lead_speed_cells: int
    range_cells: int
    refinement: int
    closing_speed_max: float
    closing_speed_points: int
    reference_inverse_range: float = 0.025
    reference_inverse_ttc: float = 0.05

    def __post_init__(self) -> None:
        if self.lead_speed_min >= self.lead_speed_max:
            raise InputError(
                "Grid",
                seen=f"lead speeds from {self.lead_speed_min:g} to {self.lead_speed_max:g} m/s",
                expected="lead_speed_min below lead_speed_max",
                change="Correct the arguments.",
            )

    def cells(self, parts: NDArray[np.int_]) -> "Cells":
        """Return the cells of the grid after dividing the sides of each initial cell into parts.

        Parameters
        ----------
        parts
            Number of parts for each initial cell, shape (v_L cells, range cells).
        """
        count = parts.ravel() ** 2
        side = np.repeat(parts.ravel(), count)
        place = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        row, column = np.divmod(np.repeat(np.arange(parts.size), count), self.range_cells)
        width = (self.lead_speed_max - self.lead_speed_min) / self.lead_speed_cells
        # All edges are computed by the same expression, so that neighbours have exactly equal edges.
        speeds = [self.lead_speed_min + width * (row + (place // side + end) / side) for end in (0, 1)]
        roots = [1 - (column + (place % side + end) / side) / self.range_cells for end in (0, 1)]
        roots[1][np.isclose(roots[1], 0, atol=1e-12)] = 0
        return Cells(np.column_stack(speeds), np.column_stack(roots), self.range_max)

    def refined(self, factor: float) -> "Grid":
        """Return the grid with a finer or coarser resolution of lead speed, range and scan.

        Parameters
        ----------
        factor
            Factor of the numbers of cells of v_L, of cells of the range, and of scan points.
        """
        counts = ("lead_speed_cells", "range_cells", "closing_speed_points")
        return replace(self, **{name: max(2, round(getattr(self, name) * factor)) for name in counts})


@dataclass(frozen=True)
class Cells:
    """Cells of v_L and of the square root of the range."""

    lead_speed: Array  # lower and upper v_L of each cell [m/s], (cells, 2)
    root: Array  # square roots of R / range_max at the farther and the nearer end, (cells, 2)
    range_max: float  # m

    @property
    def inverse_range(self) -> Array:
        """Lower and upper R^-1 of each cell [1/m], shape (cells, 2); infinite for a range of 0."""
        with np.errstate(divide="ignore"):
            return 1 / (self.range_max * self.root**2)

    def draw_lines(self, generator: np.random.Generator) -> tuple[Array, Array]:
        """Draw v_L [m/s] and R^-1 [1/m] of two random lines in each cell, shape (2 cells,).

        The two lines of a cell follow each other.
        """
        place = generator.random((2, len(self.root), LINES_PER_CELL))
        lead_speed, root = (
            ends[:, :1] + (ends[:, 1:] - ends[:, :1]) * share
            for ends, share in zip((self.lead_speed, self.root), place, strict=True)
        )
        return lead_speed.ravel(), (1 / (self.range_max * root**2)).ravel()


class Lines(ABC):
    """Lines along which only the closing speed varies."""

    inner: Array | None  # inner variables, (lines, variables), for a vehicle whose outcomes are random

    @abstractmethod
    def place(self, line: NDArray) -> tuple[Array, Array]:
        """Return the lead speeds [m/s] and ranges [m] of the n lines with the given indices."""

    def simulate(self, vehicle: Vehicle, line: NDArray, closing_speed: Array) -> Outcomes:
        """Return the outcomes of cut-ins on lines, simulated with the lines' inner variables if any."""
        inner = None if self.inner is None else self.inner[line]
        return simulate_inner(vehicle, (*self.place(line), closing_speed), inner)


@dataclass(frozen=True)
class CrashMap(Lines):
    """A crash map: two lines in each cell, with the intervals of every event."""

    grid: Grid
    cells: Cells
    lead_speed: Array  # v_L [m/s] of the lines, (2 cells,)
    inverse_range: Array  # R^-1 [1/m] of the lines, (2 cells,)
    events: Mapping[Event, Intervals]  # the intervals of each event
    # Inner variables of the lines, (2 cells, variables), for a vehicle whose outcomes are random.
    inner: Array | None = None
    inner_weight: Array | None = None  # importance weights of these inner variables, (2 cells,)
    # Class and parameters of the vehicle (`vehicles.loading.identity_of`); None if they are unknown.
    vehicle: str | None = None

    def place(self, line: NDArray) -> tuple[Array, Array]:
        """Return the lead speeds [m/s] and ranges [m] of the n lines with the given indices."""
        return self.lead_speed[line], 1 / self.inverse_range[line]

    def intervals(self, event: Event) -> Intervals:
        """Return the intervals in which an event happens; InputError is raised if the map lacks the event."""
        if event not in self.events:
            raise InputError(
                "crash map",
                seen=f"{event}",
                expected=f"one of the map's events: {', '.join(map(str, self.events))}",
                change="Add the threshold to the configuration (key crash_map) and compute the map again.",
            )
        return self.events[event]

    @property
    def weights(self) -> Array:
        """The weights of the inner variables of the lines, 1 without such variables, (2 cells,)."""
        return np.ones(self.lead_speed.size) if self.inner_weight is None else self.inner_weight

    @property
    def reference(self) -> Array:
        """The weight of each line under the reference law of lead speed and range, (2 cells,).

        It is the density at the range of the line times the area of the cell, up to a constant factor.
        Recorded ranges are short more often than an exponential distribution of R^-1 allows.
        """
        area = np.diff(self.cells.lead_speed)[:, 0] * -np.diff(self.cells.root)[:, 0]
        scale, slope = (
            TAIL * self.grid.reference_inverse_range,
            self.inverse_range**1.5,
        )  # of R^-1 in the root
        density = (1 + self.inverse_range / scale) ** -(TAIL + 1) * slope
        return self.weights * density * np.repeat(area, LINES_PER_CELL)

    def smallest_inverse_ttc(self) -> float:
        """Return the smallest TTC^-1 [1/s] at which there is a crash; infinite if there is none."""
        intervals = self.intervals(CRASH)
        return float(np.min(intervals.start * self.inverse_range[intervals.line], initial=np.inf))


def write_crash_map(path: str | os.PathLike, crash_map: CrashMap) -> None:
    """Write a crash map as a compressed NumPy archive, atomically; equal maps give equal bytes."""
    arrays: dict[str, Any] = {"grid": np.array(json.dumps(asdict(crash_map.grid)))}
    arrays |= {"lead_speed": crash_map.lead_speed, "inverse_range": crash_map.inverse_range}
    arrays |= {"lead_speed_cells": crash_map.cells.lead_speed, "root_cells": crash_map.cells.root}
    if crash_map.inner is not None:
        arrays |= {"inner": crash_map.inner, "inner_weight": crash_map.weights}
    if crash_map.vehicle is not None:
        arrays["vehicle"] = np.array(crash_map.vehicle)
    for event, intervals in crash_map.events.items():
        for name, values in vars(intervals).items():
            arrays[f"{event.quantity} {event.threshold!r} {name}"] = values
    write_arrays(path, arrays)


def read_crash_map(path: str | os.PathLike) -> CrashMap:
    """Return the crash map in a file of `write_crash_map`; InputError is raised if it is none."""
    with readable(str(path), "a crash map", "Compute the map again.", (*DAMAGE, OSError)):
        arrays = read_arrays(path)
        grid = Grid(**json.loads(str(arrays.pop("grid"))))
        lead_speed, inverse_range = arrays.pop("lead_speed"), arrays.pop("inverse_range")
        inner, weight, vehicle = (arrays.pop(name, None) for name in ("inner", "inner_weight", "vehicle"))
        cells = Cells(arrays.pop("lead_speed_cells"), arrays.pop("root_cells"), grid.range_max)
        columns: dict[Event, dict[str, NDArray]] = {}
        for key, values in arrays.items():
            quantity, threshold, name = key.split()
            columns.setdefault(CUT_IN.event(quantity, float(threshold)), {})[name] = values
        events = {event: Intervals(**parts) for event, parts in columns.items()}
    vehicle = None if vehicle is None else str(vehicle)
    return CrashMap(grid, cells, lead_speed, inverse_range, events, inner, weight, vehicle)
