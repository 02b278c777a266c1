"""Laws that give the probability of an interval of one variable, along lines of it, for the explorer."""

from collections.abc import Callable
from pathlib import Path
from typing import Self

import numpy as np

from accelerated_evaluation.answer.candidates.fitted_records import FittedRecords
from accelerated_evaluation.answer.ways.by_scan import scanned_variable
from accelerated_evaluation.answer.ways.explored import TINY, Plane, PlaneCells, Sections
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.laws.draws import Draws, as_draws
from accelerated_evaluation.laws.files import read_law
from accelerated_evaluation.laws.protocol import log_slice_of
from accelerated_evaluation.scenarios.protocol import Scenario

# Distances from the end in which the events are, in units of the width of the variable.
STEPS = np.concatenate([np.linspace(1, 0.01, 150), np.geomspace(0.01, 1e-7, 50)[1:]])

MOST_LINES, STORED = 3072, 300_000  # lines, and lines times draws, which determine the size of the page
CHANGE = "Change the vehicle in the configuration, and compare the answers of the studies."


class SlicedSections(Sections):
    """Draws of laws in the form `SlicedLaw`; the base law is their proposal.

    Events are expected at small values of the scanned variable, unless they are upper sets in it.
    """

    depth, by_line = 14, True
    levels = (0, 1, 2, 3, 4, 5, 6, 8, 10, 12, 14)

    def __init__(self, draws: Draws, scenario: Scenario) -> None:
        """Keep the draws of the answer, whose laws must give probabilities of intervals of one variable.

        InputError is raised if the scenario names no such variable, or a law cannot do this.
        """
        self.scanned = k = scanned_variable(scenario, draws, CHANGE)
        if scenario.dimension != 3:
            raise InputError(
                f"explorer of the scenario {scenario.name}",
                seen=f"{scenario.dimension} variables",
                expected="three variables, of which the page draws two and has a slider for the third",
                change=CHANGE,
            )
        self.draws, box = draws, draws.proposal.box
        self.is_upper_set = scenario.upper_set_in == scenario.scanned
        self.names, self.member, self.answered = sorted(set(draws.names)), draws.member, draws.size
        self.lines = min(MOST_LINES, STORED // draws.size)
        self.weights = np.bincount(draws.member) / draws.size
        self.low, self.high = box.lower[k], box.upper[k]
        width = self.high - self.low
        self.grid = self.high - width * STEPS if self.is_upper_set else self.low + width * STEPS
        low, high = (tuple(np.delete(end, k).tolist()) for end in (box.lower, box.upper))
        self.plane = Plane(low, high)

    @classmethod
    def of(cls, records: FittedRecords, _: int, __: Callable[..., np.random.Generator], law: Path) -> Self:
        """Return the draws of the answer in a law file; see `CutInSections.of`."""
        return cls(as_draws(read_law(law)), records.scenario)

    def survival(self, cells: PlaneCells, *, few: bool = False) -> Array:
        """Return P(encounter in a cell, beyond each of the values) under the proposal, (cells, values)."""
        values = np.broadcast_to(self.grid, (len(cells.first), self.grid.size))
        return cells.area[:, None] * np.exp(self._log_beyond(cells, values))

    def log_ratios(self, cells: PlaneCells, levels: Array) -> Array:
        """Return the log of the ratio of each draw to the proposal, 0 where the proposal has none."""
        base, logs = (self._log_beyond(cells, levels, of_draws=each) for each in (False, True))
        return np.where(base > np.log(TINY), logs - np.maximum(base, np.log(TINY)), 0.0)

    def distance(self, cells: PlaneCells) -> Array:
        """Return twice the log of the ratio of the largest density of both variables to that of each point.

        For normal variables this is the sum of their squared normal scores.
        """
        logs = self._log_beyond(cells, np.full((len(cells.first), 1), self.grid[0]))[:, 0]
        return 2 * (logs.max() - logs)

    def _log_beyond(self, cells: PlaneCells, values: Array, *, of_draws: bool = False) -> Array:
        """Return the log of the density of the points of cells and of being beyond the values, (cells, m).

        It is that of the proposal, or of each draw, shape (K, cells, m).
        """
        first, second = (np.repeat(each, values.shape[1]) for each in cells.point)
        x = np.column_stack(self.encounters(first, second, values.ravel()))
        low, high = np.full(values.size, self.low), np.full(values.size, self.high)
        ends = (values.ravel(), high) if self.is_upper_set else (low, values.ravel())
        if of_draws:
            return self.draws.log_slices(self.scanned, x, *ends).reshape(-1, *values.shape)
        return log_slice_of(self.draws.proposal, self.scanned, x, *ends).reshape(values.shape)
