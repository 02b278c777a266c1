"""The answer from scans of lines: one variable of a scenario is integrated exactly, and the others are drawn.

The lines are drawn from the proposal of the draws of the law, by quasi-random numbers (Sobol points with
random scrambling, Owen 1997), which fill the space of the other variables evenly. Simulations along a line
find the intervals of the variable in which an event happens, and bisection refines their ends. A law that is
a `SlicedLaw` then gives the probability of these intervals in closed form, under every draw. The lines come
in independent batches, whose differences give the error.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri
from scipy.stats import qmc

from accelerated_evaluation.answer.answer import Answer, Crashes
from accelerated_evaluation.answer.posterior import SampledPosterior
from accelerated_evaluation.base.arguments import a_number
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.checking import checked
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.laws.draws import Draws, OneLaw
from accelerated_evaluation.laws.protocol import Box, SlicedLaw
from accelerated_evaluation.methods.problem import Problem
from accelerated_evaluation.scenarios.events import Event
from accelerated_evaluation.scenarios.protocol import Scenario
from accelerated_evaluation.vehicles.protocol import repeats_itself

HALVINGS = 12  # number of bisections of a step of the scan
AT_ONCE = 500_000  # number of encounters that are simulated at once
PIECES = 5  # number of parts of an interval with crashes, each with an impact speed
BATCHES = 16  # number of independent batches of lines
TINY = 1e-12  # smallest distance of a quasi-random number from 0 and 1
CHANGE = "Use Simulations, or FewRuns for a slow vehicle."  # what to do where nothing can be scanned
NAMES = ("line", "start", "end")


@dataclass(frozen=True)
class Stretches:
    """The intervals of the scanned variable in which an event happens."""

    line: NDArray[np.intp]  # index of the line of each interval, (m,)
    start: Array  # in the unit of the variable, (m,)
    end: Array  # (m,)


@checked(lines=a_number(1, 10**7, whole=True), points=a_number(2, 10**5, whole=True))
@dataclass(frozen=True)
class Scan:
    """The way to an answer by scans of lines, for fast vehicles in scenarios with a variable to scan.

    Parameters
    ----------
    lines
        Least number of lines; it is raised to the next power of 2.
    points
        Number of simulations on each line before bisection. An interval that is shorter than the distance of
        two points may be missed.

    Examples
    --------
    >>> from accelerated_evaluation import Scan
    >>> finer = Scan(lines=16384, points=200)
    >>> finer.lines * finer.points  # simulations before bisection
    3276800
    """

    lines: int = 4096
    points: int = 100

    def answer(
        self, problem: Problem, draws: Draws, events: Sequence[Event], generator: np.random.Generator
    ) -> Answer:
        """Return the probability of the events of a problem under each draw of the law.

        Raises
        ------
        InputError
            If the scenario has no variable that can be scanned, a draw of the law gives no probabilities of
            intervals of it, or the outcomes of the vehicle are random.
        """
        k, laws = _capable(problem, draws)
        proposal, box = draws.proposal, draws.proposal.box
        x = proposal.from_normal_scores(_scores(self.lines, problem.dimension, generator))
        every = list(dict.fromkeys([problem.event, *events]))
        found = self._scanned(problem, k, x, every, box, generator)
        whole = [np.full(len(x), end[k]) for end in (box.lower, box.upper)]
        drawn = proposal.log_slice(k, x, *whole)  # log density of the other variables of the lines
        weights = {event: _weights(laws, k, x, each, drawn) for event, each in found.items()}
        posteriors = {
            event: _posterior(weights[event], each.line, len(x), draws) for event, each in found.items()
        }
        simulations = len(x) * self.points
        main = found[problem.event]
        crashes = None
        if main.line.size:  # parts of the intervals, because the impact speed varies in them
            parts = _pieces(main)
            crashes = _crashes(problem, k, x, parts, _weights(laws, k, x, parts, drawn))
        return Answer(problem, draws, posteriors, crashes, simulations=simulations, notes={"found": found})

    def _scanned(
        self,
        problem: Problem,
        k: int,
        x: Array,
        events: Sequence[Event],
        box: Box,
        generator: np.random.Generator,
    ) -> dict[Event, Stretches]:
        """Return the intervals of every event on the lines x, shape (n, d)."""
        low, high = box.lower[k], box.upper[k]
        parts: dict[Event, list[Stretches]] = {event: [] for event in events}
        offset, size = generator.random(len(x)), max(AT_ONCE // self.points, 1)
        for first in range(0, len(x), size):
            lines = np.arange(first, min(first + size, len(x)))
            steps = (np.arange(self.points - 1) + offset[lines, None]) / (self.points - 1)
            values = np.column_stack([np.full(lines.size, low), low + (high - low) * steps])
            outcomes = problem.simulate(_along(x, k, np.repeat(lines, self.points), values.ravel()))
            for event, found in parts.items():
                happened = event.happens(outcomes).reshape(values.shape)
                found.append(_stretches(problem, event, k, x, lines, values, happened, high))
        return {
            event: Stretches(*(np.concatenate([getattr(part, name) for part in found]) for name in NAMES))
            for event, found in parts.items()
        }


def exact_probability(problem: Problem, generator: np.random.Generator) -> tuple[float, float]:
    """Return the probability of the event under the law of a problem, with its relative standard error.

    Both are NaN if the scenario, the law or the vehicle has no scans.
    """
    law = OneLaw(problem.law)
    try:
        _capable(problem, law)
    except InputError:
        return math.nan, math.nan
    found = Scan().answer(problem, law, (), generator).posterior
    return (0.0, 0.0) if found is None else (float(found.probabilities[0]), float(found.errors[0]))


def _scores(lines: int, dimension: int, generator: np.random.Generator) -> Array:
    """Return quasi-random normal scores of the lines, shape (n, d), in batches that follow each other."""
    power = max(math.ceil(math.log2(lines / BATCHES)), 1)
    return np.concatenate(
        [ndtri(_inside(qmc.Sobol(dimension, rng=generator).random_base2(power))) for _ in range(BATCHES)]
    )


def _inside(u: Array) -> Array:
    """Return numbers of the unit interval without its ends, whose normal scores are infinite."""
    return np.clip(u, TINY, 1 - TINY)


def scanned_variable(scenario: Scenario, draws: Draws, change: str = CHANGE) -> int:
    """Return the index of the variable to scan; InputError if the scenario or the law of a draw has none.

    ``change`` says what to do instead.
    """
    if scenario.scanned is None:
        raise InputError(
            f"scenario {scenario.name}",
            seen="no variable along which every event happens in a few intervals",
            expected="a scenario with such a variable (`scanned`)",
            change=change,
        )
    lacking = sorted(
        {type(law).__name__ for law in (*draws.laws, draws.proposal) if not isinstance(law, SlicedLaw)}
    )
    if lacking:
        raise InputError(
            f"scan of {scenario.scanned}",
            seen=f"a law of the class {lacking[0]}, without a method log_slice",
            expected="laws that give the probability of an interval of one variable for given others",
            change=change,
        )
    return scenario.names.index(scenario.scanned)


def _capable(problem: Problem, draws: Draws) -> tuple[int, Sequence[SlicedLaw]]:
    """Return the index of the variable to scan, and the law of each draw.

    InputError is raised if the scenario, the laws or the vehicle do not allow a scan.
    """
    k = scanned_variable(problem.scenario, draws)
    if repeats_itself(problem.vehicle) is False:
        raise InputError(
            f"scan of {problem.scenario.scanned}",
            seen="a vehicle whose outcomes are random",
            expected="a vehicle with deterministic outcomes",
            change=CHANGE,
        )
    return k, draws.laws


def _along(x: Array, k: int, line: NDArray[np.intp], values: Array) -> Array:
    """Return points on lines with the given values of variable k, shape (m, d)."""
    points = x[line].copy()
    points[:, k] = values
    return points


def _stretches(
    problem: Problem,
    event: Event,
    k: int,
    x: Array,
    lines: NDArray[np.intp],
    values: Array,
    happened: NDArray[np.bool_],
    high: float,
) -> Stretches:
    """Return the intervals of an event on some lines, from flags at rising values, shape (lines, points)."""
    row, column = np.nonzero(happened[:, 1:] != happened[:, :-1])
    left, right = values[row, column], values[row, column + 1]
    begins = happened[row, column + 1]
    for _ in range(HALVINGS if row.size else 0):
        middle = (left + right) / 2
        same = event.happens(problem.simulate(_along(x, k, lines[row], middle))) == begins
        left, right = np.where(same, left, middle), np.where(same, middle, right)
    at_first, at_last = np.flatnonzero(happened[:, 0]), np.flatnonzero(happened[:, -1])
    border = (left + right) / 2
    start_row = np.concatenate([row[begins], at_first])
    start = np.concatenate([border[begins], values[at_first, 0]])
    end_row = np.concatenate([row[~begins], at_last])
    end = np.concatenate([border[~begins], np.full(at_last.size, high)])
    order, other = np.lexsort([start, start_row]), np.lexsort([end, end_row])
    return Stretches(lines[start_row[order]], start[order], end[other])


def _weights(laws: Sequence[SlicedLaw], k: int, x: Array, found: Stretches, drawn: Array) -> Array:
    """Return the contribution of each interval to the probability under each draw, shape (K, m)."""
    slices = [law.log_slice(k, x[found.line], found.start, found.end) for law in laws]
    return np.exp(np.reshape(slices, (len(laws), -1)) - drawn[found.line]) / len(x)


def _posterior(weights: Array, line: NDArray[np.intp], n: int, draws: Draws) -> SampledPosterior | None:
    """Return the probability under each draw, with its error, from the batches of n lines."""
    estimates = weights.sum(axis=1)
    if not estimates.any():
        return None
    batch = line * BATCHES // n
    of_batches = BATCHES * np.array([np.bincount(batch, row, BATCHES) for row in weights])
    errors = of_batches.std(axis=1, ddof=1) / np.sqrt(BATCHES)
    relative = np.divide(errors, estimates, out=np.ones_like(estimates), where=estimates > 0)
    return SampledPosterior(estimates, draws.member, np.minimum(relative, 1), BATCHES)


def _pieces(found: Stretches) -> Stretches:
    """Return intervals that are divided into `PIECES` equal parts each."""
    ends = np.linspace(found.start, found.end, PIECES + 1)  # (PIECES + 1, m)
    return Stretches(np.tile(found.line, PIECES), ends[:-1].ravel(), ends[1:].ravel())


def _crashes(problem: Problem, k: int, x: Array, found: Stretches, weights: Array) -> Crashes:
    """Return the middle of each part of an interval, with its impact speed."""
    middle = _along(x, k, found.line, (found.start + found.end) / 2)
    impact = getattr(problem.simulate(middle), "impact_speed", np.full(len(middle), np.nan))
    return Crashes(middle, impact[:, None], weights)
