"""The answer from scans of lines: one variable of a scenario is integrated exactly, and the others are drawn.

Most lines are drawn from the proposal of the draws of the law, by quasi-random numbers (Sobol points with
random scrambling, Owen 1997), which fill the space of the other variables evenly. Events may be frequent on
lines that the law rarely has, such as cut-ins at very short ranges. Therefore some lines have one normal
score that is uniform between wide limits. Each line is weighted by the ratio of the normal density of its
scores to the density of the mixture from which the lines are drawn (Veach and Guibas 1995).

Simulations along a line find the intervals of the variable in which an event happens, and bisection refines
their ends unless there are many. A law that is a `SlicedLaw` then gives the probability of these intervals in
closed form, under every draw. The lines come in independent batches, whose differences give the error.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.special import ndtri

from accelerated_evaluation.answer.ways.answer import Answer, Crashes
from accelerated_evaluation.answer.ways.posterior import SampledPosterior
from accelerated_evaluation.base.arguments import a_number
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.checking import checked
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.crash_map.intervals import Intervals, in_batches, intervals_on
from accelerated_evaluation.laws.draws import Draws, OneLaw
from accelerated_evaluation.laws.protocol import Box, SlicedLaw, log_slice_of
from accelerated_evaluation.methods.problem import Problem
from accelerated_evaluation.scenarios.events import Event
from accelerated_evaluation.scenarios.protocol import Scenario
from accelerated_evaluation.vehicles.protocol import repeats_itself

PIECES = 5  # number of parts of an interval with crashes, each with an impact speed
BATCHES = 16  # number of independent batches of lines
WIDE = 2  # one line in so many has a score that is uniform
REACH = 6.0  # largest absolute value of such a score; beyond it, a normal score has the probability 2e-9
TINY = 1e-12  # smallest distance of a quasi-random number from 0 and 1
CHANGE = "Use Simulations, or FewRuns for a slow vehicle."  # what to do where nothing can be scanned


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

        InputError is raised if the scenario has no variable that can be scanned, a draw of the law gives no
        probabilities of intervals of it, or the outcomes of the vehicle are random.
        """
        k = _capable(problem, draws)
        proposal, box = draws.proposal, draws.proposal.box
        z, log_weight = _scores(self.lines, problem.scenario.dimension, k, generator)
        x = proposal.from_normal_scores(z)
        every = list(dict.fromkeys([problem.event, *events]))
        found = self._scanned(problem, k, x, every, box, generator)
        whole = [np.full(len(x), end[k]) for end in (box.lower, box.upper)]
        # Log density of the other variables with which the lines come.
        drawn = log_slice_of(proposal, k, x, *whole) - log_weight
        # The intervals of the main event are divided, because the impact speed varies in them.
        parts = found | {problem.event: _pieces(found[problem.event])}
        weights = {event: _weights(draws, k, x, each, drawn) for event, each in parts.items()}
        posteriors = {
            event: _posterior(weights[event], each.line, len(x), draws) for event, each in parts.items()
        }
        simulations = len(x) * self.points
        main = parts[problem.event]
        crashes = None
        if main.line.size:
            crashes = _crashes(problem, k, x, main, weights[problem.event])
        return Answer(problem, draws, posteriors, crashes, simulations=simulations, notes={"found": found})

    def _scanned(
        self,
        problem: Problem,
        k: int,
        x: Array,
        events: Sequence[Event],
        box: Box,
        generator: np.random.Generator,
    ) -> dict[Event, Intervals]:
        """Return the intervals of every event on the lines x, shape (n, d)."""
        low, high = box.lower[k], box.upper[k]
        offset = generator.random(len(x))

        def simulate(line: NDArray[np.intp], values: Array) -> Any:  # noqa: ANN401
            return problem.simulate(_along(x, k, line, values))

        def find(lines: NDArray[np.intp]) -> dict[Event, Intervals]:
            steps = (np.arange(self.points - 1) + offset[lines, None]) / (self.points - 1)
            values = np.column_stack([np.full(lines.size, low), low + (high - low) * steps])
            outcomes = simulate(np.repeat(lines, self.points), values.ravel())
            return intervals_on(lines, values, outcomes, events, (low, high), simulate)

        return in_batches(len(x), self.points, find)


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


def _scores(lines: int, dimension: int, k: int, generator: np.random.Generator) -> tuple[Array, Array]:
    """Return quasi-random scores of the lines, shape (n, d), and the log of the weight of each, shape (n,).

    They are in batches that follow each other. Every batch begins with the lines that have a uniform score,
    first those of the first variable. Variable k has none, because lines do not depend on it.
    """
    power = max(math.ceil(math.log2(lines / BATCHES)), 1)
    sobol = (scipy.stats.qmc.Sobol(dimension, rng=generator) for _ in range(BATCHES))
    u = np.concatenate([points.random_base2(power) for points in sobol])
    z, others, wide = ndtri(_inside(u)), np.delete(np.arange(dimension), k), 2**power // WIDE
    place = np.arange(len(u)) % 2**power
    row = np.flatnonzero(place < wide * (others.size > 0))
    column = others[place[row] * others.size // max(wide, 1)]
    z[row, column] = REACH * (2 * u[row, column] - 1)
    share = np.bincount(column, minlength=dimension) / len(u)
    with np.errstate(divide="ignore"):
        ratio = np.where(np.abs(z) <= REACH, np.exp(-math.log(2 * REACH) - scipy.stats.norm.logpdf(z)), 0.0)
    return z, -np.log(1 - share.sum() + ratio @ share)


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
    lacking = sorted({type(law).__name__ for law in draws.sliced if not isinstance(law, SlicedLaw)})
    if lacking:
        raise InputError(
            f"scan of {scenario.scanned}",
            seen=f"a law of the class {lacking[0]}, without a method log_slice",
            expected="laws that give the probability of an interval of one variable for given others",
            change=change,
        )
    k, box = scenario.names.index(scenario.scanned), draws.proposal.box
    if not np.isfinite([box.lower[k], box.upper[k]]).all():
        raise InputError(
            f"scan of {scenario.scanned}",
            seen=f"a law with the limits {box.lower[k]:g} and {box.upper[k]:g}",
            expected="finite limits, between which lines are scanned",
            change="Fit a law with a cap (for cut-ins, models.closing_speed_max), or use Simulations.",
        )
    return k


def _capable(problem: Problem, draws: Draws) -> int:
    """Return the index of the variable to scan.

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
    return k


def _along(x: Array, k: int, line: NDArray[np.intp], values: Array) -> Array:
    """Return points on lines with the given values of variable k, shape (m, d)."""
    points = x[line].copy()
    points[:, k] = values
    return points


def _weights(draws: Draws, k: int, x: Array, found: Intervals, drawn: Array) -> Array:
    """Return the contribution of each interval to the probability under each draw, shape (K, m)."""
    slices = draws.log_slices(k, x[found.line], found.start, found.end)
    return np.exp(slices - drawn[found.line]) / len(x)


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


def _pieces(found: Intervals) -> Intervals:
    """Return intervals that are divided into `PIECES` equal parts each."""
    ends = np.linspace(found.start, found.end, PIECES + 1)  # (PIECES + 1, m)
    return Intervals(np.tile(found.line, PIECES), ends[:-1].ravel(), ends[1:].ravel())


def _crashes(problem: Problem, k: int, x: Array, found: Intervals, weights: Array) -> Crashes:
    """Return the middle of each part of an interval, with its impact speed."""
    middle = _along(x, k, found.line, (found.start + found.end) / 2)
    impact = getattr(problem.simulate(middle), "impact_speed", np.full(len(middle), np.nan))
    return Crashes(middle, impact[:, None], weights)
