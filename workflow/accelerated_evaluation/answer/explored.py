"""Lines from which the explorer of the book computes the answer for any vehicle in a fraction of a second.

A crash map consists of tens of thousands of lines, which are made for one vehicle. The explorer needs fewer
lines, and these must be suitable for every vehicle that a reader can choose. A line is a pair of lead speed
and range. The lines are drawn with a probability proportional to the crash probability of some pilot vehicles
at this pair. Along a line, the coordinate of a closing speed c is its cumulative hazard under the mean law of
the answer, Lambda(c) = -log P(C > c | v_L, R). A vehicle is simulated at equidistant values of Lambda. The
probability of the event under the mean law is then a sum over lines and points.

The probability under a single draw of the law is computed from the same points; see `explored_ratios`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline
from scipy.special import ndtri
from tqdm import tqdm

from accelerated_evaluation.answer.law_study import LawStudy
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.smooth.conditional import Places, SpeedLaw
from accelerated_evaluation.laws.smooth.mean import MeanLaw
from accelerated_evaluation.laws.smooth.smooth_hazard import SmoothHazard
from accelerated_evaluation.laws.smooth.splines import Support
from accelerated_evaluation.vehicles.protocol import Vehicle

LINES = 12_288
CELLS = 60  # number of intervals of the lead speed, and of the square root of the range, for drawing lines
DEPTH = 28  # largest cumulative hazard; closing speeds beyond it have the conditional probability 7e-13
# Cumulative hazards at which closing speeds are stored. They are denser near 0, where the closing speed is a
# strongly curved function of the hazard.
NODES = np.arange(DEPTH + 1) ** 2 / DEPTH
EVEN = 0.1  # share of the lines that are drawn from the law of lead speed and range alone
PILOT_DRAWS = 20  # number of draws of the law with whose mean the lines are drawn
FEWEST = 20  # smallest number of draws of each member, so that a reader can select a single member
PART = 256  # number of lines whose tables fit into the cache of a processor
# Closing speeds [m/s] at which laws are tabulated, with wider steps in the tail, where the laws are smooth.
SPEEDS = np.concatenate([np.arange(0, 24, 0.5), np.arange(24, 60, 1.0), np.arange(60, 241, 4.0)])
TINY = np.finfo(float).tiny


@dataclass(frozen=True)
class ExplorerDraws:
    """Draws of the law of cut-ins: the draws of the answer, and further draws of rarely drawn members."""

    # Distributions of range and closing speed of each draw; those of the answer come first.
    laws: Sequence[tuple[SmoothHazard, SpeedLaw]]
    member: NDArray[np.int_]  # index of the member of the family for each draw, (draws,)
    answered: int  # number of draws of the answer

    @classmethod
    def of(cls, study: LawStudy, draws: MeanLaw, more: np.random.Generator) -> "ExplorerDraws":
        """Add draws to those of the answer, such that every smooth law has at least `FEWEST` draws."""
        smooth, own = study.smooth, draws.draws
        laws = [(own.ranges[shared], law) for shared, law in zip(own.shared, own.laws, strict=True)]
        member = [smooth.names.index(name) for name in own.names]
        for place, count in enumerate(np.bincount(member, minlength=len(smooth.names))):
            for _ in range(FEWEST - count):
                ranges, law = (
                    smooth.family.ranges.drawn(more),
                    smooth.family.drawn(smooth.members[place], more),
                )
                laws.append((ranges, law))
                member.append(place)
        return cls(laws, np.array(member), own.size)


@dataclass(frozen=True)
class Cell:
    """Rectangular cells of lead speed and square root of the range."""

    lead_speed: Array  # lower and upper end [m/s], (n, 2)
    root: Array  # square roots of R / R_max at the farther and the nearer end, (n, 2)
    share: Array  # share of the recorded lead speeds between the ends, (n,)
    support: Support

    @classmethod
    def all(cls, lead_speeds: Array, support: Support) -> "Cell":
        """Return all cells with recorded lead speeds, ordered so that consecutive cells are neighbours."""
        row, column = np.divmod(np.arange(CELLS**2), CELLS)
        column = np.where(row % 2, CELLS - 1 - column, column)
        edges = np.linspace(*support.lead_speeds, CELLS + 1)
        recorded = np.sort(lead_speeds)
        below = np.searchsorted(recorded, edges[:-1])
        share = np.diff(np.append(below, recorded.size)) / recorded.size
        ends = np.column_stack([edges[row], edges[row + 1]])
        root = 1 - np.column_stack([column, column + 1]) / CELLS
        cells = cls(ends, root, share[row], support)
        return cells.only(share[row] > 0)

    def only(self, chosen: Array) -> "Cell":
        """Return the cells that are selected by an array of indices or by a mask, as a new `Cell`."""
        return Cell(self.lead_speed[chosen], self.root[chosen], self.share[chosen], self.support)

    def at(self, across: Array | float, along: Array | float) -> tuple[Array, Array]:
        """Return the lead speed [m/s] and range [m] of a point in each cell, shape (n,) each.

        Its position is given as a share of the side of the cell, from 0 to 1: across for the lead speed, and
        along for the square root of the range, where 0 is the farther end.
        """
        speed = self.lead_speed[:, 0] + across * np.diff(self.lead_speed)[:, 0]
        return speed, self.support.range_max * (self.root[:, 0] + along * np.diff(self.root)[:, 0]) ** 2

    def probability(self, places: Places, ranges: SmoothHazard) -> Array:
        """Return the probability of each cell, shape (n,).

        The distribution of the range is evaluated at one place in each cell.
        """
        cumulative, touches = places.range_hazards(ranges), self.root[:, 1] > 0
        far = cumulative.at(-2 * np.log(self.root[:, 0]))
        near = cumulative.at(-2 * np.log(np.where(touches, self.root[:, 1], 1.0)))
        inside = np.where(touches, -np.expm1(np.minimum(far - near, 0.0)), 1.0)
        return self.share * np.exp(-far) * inside


@dataclass(frozen=True)
class ExploredLines:
    """Lines on which any vehicle is simulated, with the mean law along them; arrays of shape (lines,)."""

    lead_speed: Array  # m/s
    range_: Array  # m
    probability: Array  # probability under the mean law that each line represents
    distance: Array  # sum of the squared normal scores of v_L, and of R given v_L
    closing_speed: Array  # m/s at the cumulative hazards `NODES`, (lines, DEPTH + 1)


def explored_lines(
    drawn: ExplorerDraws,
    lead_speeds: Array,
    support: Support,
    pilots: Sequence[Vehicle],
    generator: np.random.Generator,
) -> ExploredLines:
    """Draw the lines of the explorer, and tabulate the mean law of the answer along them.

    More lines are drawn where the pilots crash, by a systematic sample with a random start.
    """
    cells = Cell.all(lead_speeds, support)
    chance = _chances(cells, drawn.laws[: drawn.answered : max(1, drawn.answered // PILOT_DRAWS)], pilots)
    steps = np.floor(np.cumsum(LINES * chance) + generator.random()).astype(int)
    chosen = np.repeat(np.arange(chance.size), np.diff(steps, prepend=0))
    number = np.arange(chosen.size)[:, None]
    # Additive recurrence with the plastic number (Roberts 2018): the points fill the cells evenly.
    across, along = ((0.5 + number / 1.324717957244746 ** np.array([1, 2])) % 1).T
    own, drawn_times = cells.only(chosen), LINES * chance[chosen]
    lead_speed, range_ = own.at(across, along)
    survival = mean_law(own, Places.of(lead_speed, range_, support), drawn.laws[: drawn.answered])
    probability = survival[:, 0] / drawn_times
    distance = _distance(lead_speed, range_, np.sort(lead_speeds), drawn, support)
    return ExploredLines(lead_speed, range_, probability, distance, closing_speeds(survival, NODES))


def _distance(
    lead_speed: Array, range_: Array, recorded: Array, drawn: ExplorerDraws, support: Support
) -> Array:
    """Return the sum of the squared normal scores of v_L and of R given v_L, for pairs of both."""
    rank = (np.searchsorted(recorded, lead_speed) + 0.5) / (recorded.size + 1)
    places, logarithm = Places.of(lead_speed, range_, support), np.log(support.range_max / range_)
    tail = np.zeros(range_.size)
    for ranges, _ in drawn.laws[: drawn.answered]:
        tail += np.exp(-places.range_hazards(ranges).at(logarithm)) / drawn.answered
    return ndtri(rank) ** 2 + ndtri(tail) ** 2


def _chances(cells: Cell, laws: Sequence[tuple[SmoothHazard, SpeedLaw]], pilots: Sequence[Vehicle]) -> Array:
    """Return the share of the lines in each cell, from the crashes of the pilots at its centre."""
    lead_speed, range_ = cells.at(0.5, 0.5)
    survival = mean_law(cells, Places.of(lead_speed, range_, cells.support), laws)
    edges = np.arange(DEPTH + 1)
    speeds = closing_speeds(survival, edges)
    middles = (speeds[:, 1:] + speeds[:, :-1]) / 2
    crashing = [np.zeros(survival.shape[0])]
    for pilot in pilots:
        encounters = np.repeat(lead_speed, DEPTH), np.repeat(range_, DEPTH), middles.ravel()
        crash = pilot.simulate(*encounters).crash.reshape(middles.shape)
        mass = survival[:, 0] * (crash @ -np.diff(np.exp(-edges)))
        crashing.append(mass / max(mass.sum(), TINY))
    even = survival[:, 0] / survival[:, 0].sum()
    needed = np.sum(crashing, axis=0)
    if not needed.any():
        return even
    return EVEN * even + (1 - EVEN) * needed / needed.sum()


def mean_law(cells: Cell, places: Places, laws: Sequence[tuple[SmoothHazard, SpeedLaw]]) -> Array:
    """Return P(cut-in in a cell, closing speed above each of `SPEEDS`), averaged over laws, (cells, speeds).

    The laws are evaluated at one place in each cell.
    """
    count = cells.share.size
    parts = [slice(first, first + PART) for first in range(0, count, PART)]
    total = np.zeros((SPEEDS.size, count))
    for ranges, law in tqdm(laws, desc="mean law", unit=" draws", disable=len(laws) < PILOT_DRAWS * 2):
        given, probability = law.given(places), cells.probability(places, ranges)
        for part in parts:
            total[:, part] += probability[part] * np.exp(-given.cumulative_at(SPEEDS, part))
    return np.ascontiguousarray(total.T) / len(laws)


def closing_speeds(survival: Array, hazards: Array) -> Array:
    """Return the closing speeds [m/s], (n, k), at k cumulative hazards, by linear interpolation.

    The survival probabilities at `SPEEDS` have the shape (n, speeds); see `mean_law`. The speeds are 0 in a
    cell that has no probability, which no line represents.
    """
    hazard = -np.log(np.maximum(survival / np.maximum(survival[:, :1], TINY), TINY))
    return np.array([np.interp(hazards, own, SPEEDS) for own in hazard])


COARSE = (14, 12)  # numbers of stored nodes of the lead speed and of the square root of the range
FINE = (19, 16)  # numbers of nodes between which the ratios are interpolated
LEVELS = (0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 14, 17, 20, 24, DEPTH)  # stored cumulative hazards
# Limits of the stored logarithms. Smaller ratios are almost 0, and no draw with a relevant weight has larger
# ones.
LIMITS = (-12.0, 8.0)


def log_ratios(drawn: ExplorerDraws, support: Support) -> Array:
    """Return the logarithms of the ratio of each draw to the mean law of the answer, at the stored nodes.

    The axes are draws, v_L, square root of R, and cumulative hazard.
    """
    speeds, roots = (
        np.linspace(*support.lead_speeds, COARSE[0]),
        _roots(COARSE[1]) * np.sqrt(support.range_max),
    )
    lead_speed, root = (nodes.ravel() for nodes in np.meshgrid(speeds, roots, indexing="ij"))
    places = Places.of(lead_speed, root**2, support)
    # The density of the range is represented, up to a constant, by the probability of a cell at each node.
    width = roots[0]
    sides = np.column_stack([np.minimum(root + width, roots[-1]), root - width]) / roots[-1]
    cells = Cell(np.column_stack([lead_speed, lead_speed]), sides, np.ones(root.size), support)
    survival = mean_law(cells, places, drawn.laws[: drawn.answered])
    levels = closing_speeds(survival, np.array(LEVELS))
    row = np.repeat(np.arange(root.size), len(LEVELS))
    logs = np.empty((len(drawn.laws), root.size, len(LEVELS)))
    for own, (ranges, law) in zip(logs, drawn.laws, strict=True):
        hazard = law.given(places).cumulative(levels.ravel(), row).reshape(own.shape)
        # The ratio is 1 if there are no cut-ins under any draw, for example between ranges rounded to 10 m.
        own[:] = np.log(np.maximum(cells.probability(places, ranges), TINY))[:, None] - hazard
    mean = np.log(np.mean(np.exp(logs[: drawn.answered]), axis=0))
    return np.clip(logs - mean, *LIMITS).reshape(-1, *COARSE, len(LEVELS))


def refinements() -> tuple[Array, Array, Array]:
    """Return the matrices of spline interpolation from the stored to the finer nodes.

    There is one matrix for each coordinate: v_L, the square root of R, and Lambda. Each has the shape (finer
    nodes, stored nodes).
    """
    sides = (
        (np.linspace(0, 1, COARSE[0]), np.linspace(0, 1, FINE[0])),
        (_roots(COARSE[1]), _roots(FINE[1])),
        (np.array(LEVELS, dtype=float), np.arange(DEPTH + 1)),
    )
    first, second, third = (make_interp_spline(a, np.eye(a.size), k=3)(b) for a, b in sides)
    return first, second, third


def _roots(count: int) -> Array:
    """Return equidistant nodes of the square root of R / R_max, from half a step above 0 to 1."""
    return (2 * np.arange(count) + 1) / (2 * count - 1)
