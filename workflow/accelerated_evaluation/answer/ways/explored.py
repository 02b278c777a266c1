"""Lines from which the explorer of the book computes the answer for any vehicle in a fraction of a second.

A scenario with three variables has lines along one of them: lead speed and range of a cut-in, for example,
are a line along which the closing speed varies. The explorer needs few lines, and these must be suitable for
every vehicle that a reader can choose. They are drawn with a probability proportional to the crash
probability of some pilot vehicles on them. Along a line, the coordinate of a value is its cumulative hazard
under a base law, Lambda = -log P(beyond the value), so that values which are unlikely in the tail of the
events are resolved as well as others. A vehicle is simulated at equidistant values of Lambda. The probability
of the event under the base law is then a sum over lines and points.

The probability under a single draw of the law is computed from the same points; see `log_ratios`. What the
law gives along lines is `Sections`, which `explored_cut_ins` and `explored_slices` provide.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from accelerated_evaluation.base.arrays import Array

CELLS = 60  # number of intervals of the coordinate of each of the two other variables, for drawing lines
EVEN = 0.1  # share of the lines that are drawn from the law of the two other variables alone
TINY = np.finfo(float).tiny
COARSE = (14, 12)  # numbers of stored nodes of the two other variables
FINE = (19, 16)  # numbers of nodes between which the ratios are interpolated
LEVELS = (0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 14, 17, 20, 24, 28)  # stored cumulative hazards
# Limits of the stored logarithms. Smaller ratios are almost 0, and no draw with a relevant weight has larger
# ones.
LIMITS = (-12.0, 8.0)

Simulate = Callable[..., NDArray[np.bool_]]
"""Function that takes the three variables of n encounters, and returns whether a pilot vehicle crashes."""


@dataclass(frozen=True)
class Plane:
    """The two variables that are constant on a line, each as a function of a coordinate from 0 to 1."""

    low: tuple[float, float]  # limits of the two variables, in their units
    high: tuple[float, float]

    def at(self, first: Array, second: Array) -> tuple[Array, Array]:
        """Return both variables at two coordinates; the second one is denser near its lower limit."""
        width = np.subtract(self.high, self.low)
        return self.low[0] + width[0] * first, self.low[1] + width[1] * second**2

    def coordinates(self, first: Array, second: Array) -> tuple[Array, Array]:
        """Return the coordinates of values of both variables."""
        width = np.subtract(self.high, self.low)
        return (first - self.low[0]) / width[0], np.sqrt((second - self.low[1]) / width[1])


@dataclass(frozen=True)
class PlaneCells:
    """Rectangular cells of the coordinates of a plane, and one point in each of them."""

    plane: Plane
    first: Array  # both ends of the first coordinate, (n, 2)
    second: Array  # both ends of the second coordinate, the larger one first, (n, 2)
    across: Array | float = 0.5  # position of the point between the ends of the first coordinate, (n,)
    along: Array | float = 0.5  # and of the second one

    @classmethod
    def all(cls, plane: Plane) -> Self:
        """Return all cells of a plane, ordered so that consecutive cells are neighbours."""
        row, column = np.divmod(np.arange(CELLS**2), CELLS)
        column = np.where(row % 2, CELLS - 1 - column, column)
        first, second = np.column_stack([row, row + 1]), CELLS - np.column_stack([column, column + 1])
        return cls(plane, first / CELLS, second / CELLS)

    def only(self, chosen: NDArray[np.intp]) -> Self:
        """Return the cells with some indices, each with its centre."""
        return replace(self, first=self.first[chosen], second=self.second[chosen], across=0.5, along=0.5)

    @property
    def point(self) -> tuple[Array, Array]:
        """The values of both variables at the point of each cell, shape (n,) each."""
        first, second = (
            ends[:, 0] + share * np.diff(ends)[:, 0]
            for ends, share in ((self.first, self.across), (self.second, self.along))
        )
        return self.plane.at(first, second)

    @property
    def area(self) -> Array:
        """The product of the widths of both variables in each cell, shape (n,), for small cells."""
        middle = self.second[:, 0] + self.along * np.diff(self.second)[:, 0]
        widths = np.abs(np.diff(self.first)[:, 0] * np.diff(self.second)[:, 0]) * 2 * middle
        return widths * np.prod(np.subtract(self.plane.high, self.plane.low))


class Sections(ABC):
    """Draws of a law along lines, with a base law to which they are compared."""

    plane: Plane
    # Values of the variable along lines at which laws are tabulated, in the order of the cumulative hazard:
    # the first one has the hazard 0. They decrease if the events are in the lower tail.
    grid: Array
    depth: int  # largest cumulative hazard; values beyond it have the conditional probability exp(-depth)
    scanned: int  # index of the variable along lines among the variables of the scenario
    is_upper_set: bool  # whether an event that happens at a value happens at all values beyond it
    lines: int  # number of lines of a page
    # Whether ratios are stored for every line, because they vary too much for interpolation between lines.
    by_line: bool = False
    shown: float | None = None  # largest value on the map; None for the largest one of the records
    member: NDArray[np.int_]  # index of the candidate of each draw, (K,)
    names: Sequence[str]  # of the candidates
    weights: Array  # mean weight of each candidate
    answered: int  # number of draws of the answer, which come first

    @abstractmethod
    def survival(self, cells: PlaneCells, *, few: bool = False) -> Array:
        """Return P(encounter in a cell, beyond each value of the grid) under the base law, (cells, values).

        The law is evaluated at the points of the cells, and with ``few`` perhaps less exactly.
        """

    @abstractmethod
    def log_ratios(self, cells: PlaneCells, levels: Array) -> Array:
        """Return the log of the ratio of each draw to the base law, shape (K, cells, levels).

        It is the ratio of the probabilities of a cell and of values beyond its ``levels``, (cells, levels).
        """

    @abstractmethod
    def distance(self, cells: PlaneCells) -> Array:
        """Return how far the points of the cells are from the middle of the law, as squared normal scores."""

    levels: tuple[int, ...] = LEVELS  # cumulative hazards at which ratios are stored, up to the depth

    @property
    def nodes(self) -> Array:
        """Cumulative hazards at which the values of lines are stored.

        They are denser near 0, where the value is a strongly curved function of the hazard.
        """
        return np.arange(self.depth + 1) ** 2 / self.depth

    def along(self, survival: Array, hazards: Array) -> Array:
        """Return the values, (n, k), at k cumulative hazards, by linear interpolation; see `survival`.

        In a cell that has no probability, which no line represents, the value is the first one.
        """
        hazard = -np.log(np.maximum(survival / np.maximum(survival[:, :1], TINY), TINY))
        return np.array([np.interp(hazards, own, self.grid) for own in hazard])

    def encounters(self, first: Array, second: Array, along: Array) -> list[Array]:
        """Return the columns of encounters in the order of the scenario's variables."""
        columns = [first, second]
        columns.insert(self.scanned, along)
        return columns


@dataclass(frozen=True)
class ExploredLines:
    """Lines on which any vehicle is simulated, with the base law along them; arrays of shape (lines,)."""

    cells: PlaneCells  # whose points are the lines
    probability: Array  # probability under the base law that each line represents
    distance: Array  # sum of the squared normal scores of the two variables
    along: Array  # values of the third variable at the cumulative hazards `Sections.nodes`

    @property
    def positions(self) -> tuple[Array, Array]:
        """Where the two variables of each line are between the finer nodes, counted from 0."""
        first, second = self.cells.plane.coordinates(*self.cells.point)
        lowest = _roots(FINE[1])[0]
        return first * (FINE[0] - 1), (second - lowest) / (1 - lowest) * (FINE[1] - 1)


def explored_lines(
    law: Sections, pilots: Sequence[Simulate], generator: np.random.Generator
) -> ExploredLines:
    """Draw the lines of the explorer, and tabulate the base law of the answer along them.

    More lines are drawn where the pilots crash, by a systematic sample with a random start.
    """
    cells = PlaneCells.all(law.plane)
    chance = _chances(law, cells, pilots)
    steps = np.floor(np.cumsum(law.lines * chance) + generator.random()).astype(int)
    chosen = np.repeat(np.arange(chance.size), np.diff(steps, prepend=0))
    number = np.arange(chosen.size)[:, None]
    # Additive recurrence with the plastic number (Roberts 2018): the points fill the cells evenly.
    across, along = ((0.5 + number / 1.324717957244746 ** np.array([1, 2])) % 1).T
    own = replace(cells.only(chosen), across=across, along=along)
    survival = law.survival(own)
    probability = survival[:, 0] / (law.lines * chance[chosen])
    return ExploredLines(own, probability, law.distance(own), law.along(survival, law.nodes))


def _chances(law: Sections, cells: PlaneCells, pilots: Sequence[Simulate]) -> Array:
    """Return the share of the lines in each cell, from the crashes of the pilots at its centre."""
    survival, edges = law.survival(cells, few=True), np.arange(law.depth + 1)
    values = law.along(survival, edges)
    middles = (values[:, 1:] + values[:, :-1]) / 2
    encounters = law.encounters(*(np.repeat(value, law.depth) for value in cells.point), middles.ravel())
    crashing = [np.zeros(survival.shape[0])]
    for pilot in pilots:
        mass = survival[:, 0] * (pilot(*encounters).reshape(middles.shape) @ -np.diff(np.exp(-edges)))
        crashing.append(mass / max(mass.sum(), TINY))
    even = survival[:, 0] / survival[:, 0].sum()
    needed = np.sum(crashing, axis=0)
    if not needed.any():
        return even
    return EVEN * even + (1 - EVEN) * needed / needed.sum()


def log_ratios(law: Sections, lines: ExploredLines) -> Array:
    """Return the logarithms of the ratio of each draw to the base law of the answer, where they are stored.

    The axes are draws, the coordinates of the two variables, and the cumulative hazard. Ratios by line have
    an axis of length 1 and one of lines in place of the coordinates.
    """
    if law.by_line:
        levels = law.along(law.survival(lines.cells), np.array(law.levels))
        return np.clip(law.log_ratios(lines.cells, levels), *LIMITS)[:, None]
    first, second = np.linspace(0, 1, COARSE[0]), _roots(COARSE[1])
    node, root = (values.ravel() for values in np.meshgrid(first, second, indexing="ij"))
    # Where a law has no density, the probability of a cell around each node represents it, up to a constant.
    sides = np.column_stack([np.minimum(root + second[0], 1.0), root - second[0]])
    share = (root - sides[:, 0]) / (sides[:, 1] - sides[:, 0])
    cells = PlaneCells(law.plane, np.column_stack([node, node]), sides, 0.0, share)
    levels = law.along(law.survival(cells), np.array(law.levels))
    return np.clip(law.log_ratios(cells, levels), *LIMITS).reshape(-1, *COARSE, len(law.levels))


def refinements(law: Sections) -> tuple[Array, Array, Array]:
    """Return the matrices of spline interpolation from the stored to the finer nodes.

    There is one matrix for each coordinate: those of the two variables, and Lambda. Each has the shape (finer
    nodes, stored nodes).
    """
    sides = (
        (np.linspace(0, 1, COARSE[0]), np.linspace(0, 1, FINE[0])),
        (_roots(COARSE[1]), _roots(FINE[1])),
        (np.array(law.levels, dtype=float), np.arange(law.depth + 1)),
    )
    first, second, third = (make_interp_spline(a, np.eye(a.size), k=3)(b) for a, b in sides)
    return first, second, third


def _roots(count: int) -> Array:
    """Return equidistant nodes of the second coordinate, from half a step above 0 to 1."""
    return (2 * np.arange(count) + 1) / (2 * count - 1)
