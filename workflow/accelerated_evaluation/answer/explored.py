"""Lines of closing speeds with which a page can compute the answer for any vehicle in a fraction of a second.

A crash map answers for one vehicle with tens of thousands of lines. A page that a reader changes needs fewer
lines, and they have to serve every vehicle that the reader may set. Here a line is a pair of lead speed and
range, drawn with a probability in proportion to the crash probability there of some pilot vehicles. Along a
line, the coordinate of a closing speed c is its cumulative hazard under the mean law of the answer,
Lambda(c) = -log P(C > c | v_L, R). A vehicle is simulated at points of equal distances of Lambda. The
probability of the event under the mean law is then a sum over lines and points.

The probability under a single draw of the law is computed from the same sum; see `explored_ratios`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri
from tqdm import tqdm

from accelerated_evaluation.answer.posterior import drawn_laws
from accelerated_evaluation.answer.weighted_family import WeightedLaws
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.smooth.conditional import Places, SpeedLaw
from accelerated_evaluation.laws.smooth.smooth_hazard import SmoothHazard
from accelerated_evaluation.laws.smooth.support import Support
from accelerated_evaluation.vehicles.protocol import Vehicle

LINES = 12_288
CELLS = 60  # of lead speed and of the root of the range, in which lines are drawn
DEPTH = 28  # largest cumulative hazard: a probability of 7e-13 given lead speed and range lies beyond
# Cumulative hazards at which closing speeds are stored: closest near 0, where closing speeds bend most.
NODES = np.arange(DEPTH + 1) ** 2 / DEPTH
EVEN = 0.1  # share of the lines that are drawn from the law of lead speed and range alone
PILOT_DRAWS = 20  # laws whose mean places the lines
FEWEST = 20  # draws of each member, so that a reader can ask for one member alone
PART = 256  # lines whose tables stay in the processor's cache
# Closing speeds [m/s] at which laws are tabulated: bins of the body, and wider steps where tails are smooth.
SPEEDS = np.concatenate([np.arange(0, 24, 0.5), np.arange(24, 60, 1.0), np.arange(60, 241, 4.0)])


@dataclass(frozen=True)
class DrawnLaws:
    """Draws of the law of cut-ins: those of the answer, and more of the members that it drew rarely.

    Attributes
    ----------
    laws
        Distributions of the range and of the closing speed.
    member
        Index of the member of the family of each, shape (draws,).
    answered
        Number of draws of the answer, which come first.
    """

    laws: Sequence[tuple[SmoothHazard, SpeedLaw]]
    member: NDArray[np.int_]
    answered: int

    @classmethod
    def of(
        cls, weighted: WeightedLaws, answered: np.random.Generator, more: np.random.Generator
    ) -> "DrawnLaws":
        """Draw the laws.

        Parameters
        ----------
        weighted
            The family with its weights.
        answered
            The generator of the answer, in the state in which the answer drew its laws.
        more
            Source of the further draws.
        """
        family, members = weighted.family, weighted.members
        drawn = list(drawn_laws(family, members, weighted.weights, answered))
        counts = np.bincount([place for place, _, _ in drawn], minlength=len(members))
        for place, count in enumerate(counts):
            for _ in range(FEWEST - count):
                ranges = family.ranges.drawn(more)
                drawn.append((place, ranges, family.law(members[place]).drawn(more)))
        laws = [(ranges, law) for _, ranges, law in drawn]
        return cls(laws, np.array([place for place, _, _ in drawn]), len(weighted.weights))


@dataclass(frozen=True)
class Cell:
    """Cells of lead speed and range, or one for each line: their ends, and the share of the lead speeds.

    Attributes
    ----------
    lead_speed
        Lower and upper end [m/s], shape (n, 2).
    root
        Roots of R / R_max at the farther and the nearer end, shape (n, 2).
    share
        Share of the recorded lead speeds between the ends, shape (n,).
    support
        Limits of the records.
    """

    lead_speed: Array
    root: Array
    share: Array
    support: Support

    @classmethod
    def all(cls, lead_speeds: Array, support: Support) -> "Cell":
        """Return the cells with recorded lead speeds, in an order in which neighbours follow each other."""
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
        """Return the cells selected by an index array or a mask."""
        return Cell(self.lead_speed[chosen], self.root[chosen], self.share[chosen], self.support)

    def at(self, across: Array | float, along: Array | float) -> tuple[Array, Array]:
        """Return lead speed [m/s] and range [m] at shares of the sides of the cells."""
        speed = self.lead_speed[:, 0] + across * np.diff(self.lead_speed)[:, 0]
        return speed, self.support.range_max * (self.root[:, 0] + along * np.diff(self.root)[:, 0]) ** 2

    def probability(self, places: Places, ranges: SmoothHazard) -> Array:
        """Return the probability of lead speeds and ranges in each cell, with the law of R at a place."""
        cumulative, touches = places.range_hazards(ranges), self.root[:, 1] > 0
        far = cumulative.at(-2 * np.log(self.root[:, 0]))
        near = cumulative.at(-2 * np.log(np.where(touches, self.root[:, 1], 1.0)))
        inside = np.where(touches, -np.expm1(np.minimum(far - near, 0.0)), 1.0)
        return self.share * np.exp(-far) * inside


@dataclass(frozen=True)
class ExploredLines:
    """Lines on which any vehicle is simulated, with the mean law along them; shape (lines,) if not stated.

    Attributes
    ----------
    lead_speed, range_
        Places of the lines [m/s], [m].
    probability
        Probability of the mean law that each line stands for.
    distance
        Squared distance of each line from the median in normal scores of v_L, and of R given v_L.
    closing_speed
        Closing speeds [m/s] at the cumulative hazards `NODES`, shape (lines, DEPTH + 1).
    """

    lead_speed: Array
    range_: Array
    probability: Array
    distance: Array
    closing_speed: Array


def explored_lines(
    drawn: DrawnLaws,
    lead_speeds: Array,
    support: Support,
    pilots: Sequence[Vehicle],
    generator: np.random.Generator,
) -> ExploredLines:
    """Draw lines for a page, and tabulate the mean law of the answer along them.

    Parameters
    ----------
    drawn
        Draws of the law.
    lead_speeds
        The recorded lead speeds [m/s].
    support
        Limits of the records.
    pilots
        Vehicles whose crashes say where lines are needed.
    generator
        Random start of the systematic sample of lines.
    """
    cells = Cell.all(lead_speeds, support)
    chance = _chances(cells, drawn.laws[: drawn.answered : max(1, drawn.answered // PILOT_DRAWS)], pilots)
    steps = np.floor(np.cumsum(LINES * chance) + generator.random()).astype(int)
    chosen = np.repeat(np.arange(chance.size), np.diff(steps, prepend=0))
    number = np.arange(chosen.size)[:, None]
    # Additive recurrence with the plastic number (Roberts 2018): places that fill the cells evenly.
    across, along = ((0.5 + number / 1.324717957244746 ** np.array([1, 2])) % 1).T
    own, drawn_times = cells.only(chosen), LINES * chance[chosen]
    lead_speed, range_ = own.at(across, along)
    survival = mean_law(own, Places.of(lead_speed, range_, support), drawn.laws[: drawn.answered])
    probability = survival[:, 0] / drawn_times
    distance = _distance(lead_speed, range_, np.sort(lead_speeds), drawn, support)
    return ExploredLines(lead_speed, range_, probability, distance, closing_speeds(survival, NODES))


def _distance(lead_speed: Array, range_: Array, recorded: Array, drawn: DrawnLaws, support: Support) -> Array:
    """Return the squared distance of places from the median, in normal scores of v_L and of R given v_L."""
    rank = (np.searchsorted(recorded, lead_speed) + 0.5) / (recorded.size + 1)
    places, logarithm = Places.of(lead_speed, range_, support), np.log(support.range_max / range_)
    tail = np.zeros(range_.size)
    for ranges, _ in drawn.laws[: drawn.answered]:
        tail += np.exp(-places.range_hazards(ranges).at(logarithm)) / drawn.answered
    return ndtri(rank) ** 2 + ndtri(tail) ** 2


def _chances(cells: Cell, laws: Sequence[tuple[SmoothHazard, SpeedLaw]], pilots: Sequence[Vehicle]) -> Array:
    """Return the share of the lines in each cell, from crashes of the pilots at the middle of the cells."""
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
        crashing.append(mass / max(mass.sum(), np.finfo(float).tiny))
    even = survival[:, 0] / survival[:, 0].sum()
    needed = np.sum(crashing, axis=0)
    if not needed.any():
        return even
    return EVEN * even + (1 - EVEN) * needed / needed.sum()


def mean_law(cells: Cell, places: Places, laws: Sequence[tuple[SmoothHazard, SpeedLaw]]) -> Array:
    """Return the mean over laws of P(cell and C > c) at `SPEEDS`, shape (cells, speeds)."""
    count = cells.share.size
    parts = [slice(first, first + PART) for first in range(0, count, PART)]
    total = np.zeros((SPEEDS.size, count))
    for ranges, law in tqdm(laws, desc="mean law", unit=" draws", disable=len(laws) < PILOT_DRAWS * 2):
        given, probability = law.given(places), cells.probability(places, ranges)
        for part in parts:
            total[:, part] += probability[part] * np.exp(-given.cumulative_at(SPEEDS, part))
    return np.ascontiguousarray(total.T) / len(laws)


def closing_speeds(survival: Array, hazards: Array) -> Array:
    """Return the closing speeds [m/s] at cumulative hazards, shape (n, hazards)."""
    hazard = -np.log(np.maximum(survival / survival[:, :1], np.finfo(float).tiny))
    return np.array([np.interp(hazards, own, SPEEDS) for own in hazard])
