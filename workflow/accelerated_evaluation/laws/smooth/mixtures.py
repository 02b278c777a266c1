"""Mixtures of draws of smooth hazards, and the inverse of their cumulative hazards."""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from accelerated_evaluation.base.arrays import Array

STEPS = 100  # largest number of Newton or bisection steps
TOLERANCE = 1e-12  # relative error of the closing speed and of log(R_max / R)


def mixed(cumulative: Array, log_density: Array, log_weight: Array) -> tuple[Array, Array]:
    """Return -log P(X > x) and the hazard of a mixture, both of shape (n,).

    Those of the components have the shape (components, n), and the logarithms of the weights (components, 1)
    or (components, n).
    """
    survival = log_weight - cumulative
    largest = survival.max(axis=0)
    left = np.exp(survival - largest).sum(axis=0)
    hazard = np.exp(log_weight + log_density - largest).sum(axis=0) / left
    lost = -(np.exp(log_weight) * np.expm1(-cumulative)).sum(axis=0)
    # For accuracy the cumulative hazard is computed from P(X <= x) (`lost`) if that is small, and otherwise
    # from P(X > x) (`left`).
    is_near = lost < 0.5
    score = np.where(is_near, -np.log1p(-np.where(is_near, lost, 0.0)), -largest - np.log(left))
    return score, hazard


def solve(
    score: Callable[[Array, NDArray[np.intp]], tuple[Array, Array]],
    level: Array,
    start: Array,
    largest: float = math.inf,
) -> Array:
    """Return the points at which n increasing functions, which are 0 at 0, reach given levels, shape (n,).

    The equations are solved by Newton's method. If a step leaves the bracket of a root, it is replaced by a
    bisection. A function is not evaluated any more after its root has been found, so that no root depends on
    the others. ``score(points, indices)`` returns values and derivatives. All functions have reached their
    levels at ``largest``.
    """
    low, high, value = np.zeros(level.size), np.full(level.size, float(largest)), np.array(start, dtype=float)
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
