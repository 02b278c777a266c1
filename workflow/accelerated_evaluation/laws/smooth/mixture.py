"""Mixtures of smooth laws at given places, and the inverse of their Rosenblatt map."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.smooth.draws import Hazards

STEPS = 100  # most steps of Newton's method, or of bisection where a step leaves its bracket
TOLERANCE = 1e-12  # relative, of the closing speed and of log(R_max / R)


@dataclass(frozen=True)
class RangeMixture:
    """The mixture of the distributions of the range at n lead speeds.

    Attributes
    ----------
    ranges
        Hazards of log(R_max / R) of the shared ranges.
    share
        Share of the draws that have each of the ranges, shape (a, 1).
    """

    ranges: Hazards
    share: Array

    def score(self, value: Array, row: NDArray[np.intp] | None = None) -> tuple[Array, Array]:
        """Return -log P(X > x) of the mixture at x = log(R_max / R), and its derivative by x.

        Parameters
        ----------
        value
            x for each lead speed, or for each element of ``row``.
        row
            Indices of the lead speeds; all in order by default.
        """
        cumulative, rate = self.ranges.at(value, row)
        return mixed(cumulative, np.log(rate) - cumulative, np.log(self.share))

    def log_density(self, value: Array) -> Array:
        """Return the log density of x = log(R_max / R) of each of the shared ranges, shape (a, n)."""
        cumulative, rate = self.ranges.at(value)
        return np.log(rate) - cumulative


def mixed(cumulative: Array, log_density: Array, log_weight: Array) -> tuple[Array, Array]:
    """Return -log of the mean survival function of a mixture, and the hazard of the mixture, shape (n,).

    Parameters
    ----------
    cumulative, log_density
        Cumulative hazards and log densities of the components, shape (components, n).
    log_weight
        Logarithms of the weights of the components, shape (components, 1) or (components, n).
    """
    survival = log_weight - cumulative
    largest = survival.max(axis=0)
    left = np.exp(survival - largest).sum(axis=0)
    hazard = np.exp(log_weight + log_density - largest).sum(axis=0) / left
    lost = -(np.exp(log_weight) * np.expm1(-cumulative)).sum(axis=0)
    # Near 0 the score keeps its digits if it is found from what is lost, and otherwise from what is left.
    is_near = lost < 0.5
    score = np.where(is_near, -np.log1p(-np.where(is_near, lost, 0.0)), -largest - np.log(left))
    return score, hazard


def solve(
    score: Callable[[Array, NDArray[np.intp]], tuple[Array, Array]],
    level: Array,
    start: Array,
    largest: float = math.inf,
) -> Array:
    """Return where an increasing function of n values, 0 at 0, reaches a level.

    Newton's method, with bisection where a step leaves the bracket that is known so far. The function is not
    evaluated any more for a value that has settled, so that no value depends on the others.

    Parameters
    ----------
    score
        Returns the function and its derivative at some of the n values, which are given with their indices.
    level
        Not negative, shape (n,).
    start
        Where to begin, above 0, shape (n,).
    largest
        Value at which the function is known to have reached every level.
    """
    low, high, value = np.zeros(level.size), np.full(level.size, largest), np.array(start, dtype=float)
    row = np.arange(level.size)
    for _ in range(STEPS):
        at, wanted = value[row], level[row]
        reached, slope = score(at, row)
        short = reached < wanted
        below, above = np.where(short, at, low[row]), np.where(short, high[row], at)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            step = at + (wanted - reached) / slope
        middle = np.where(np.isfinite(above), (below + above) / 2, 2 * at)
        new = np.where((step > below) & (step < above), step, middle)
        value[row], low[row], high[row] = new, below, above
        close = TOLERANCE * new
        row = row[(np.abs(new - at) > close) & (above - below > close)]
        if not row.size:
            break
    return value
