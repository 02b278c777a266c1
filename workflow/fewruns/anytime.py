"""Intervals that keep their confidence level although they are checked after every batch.

In the time V = 1 / c^2, with the coefficient of variation c of the estimate Y, the weighted errors are close
to a Brownian motion, (Y - P) / P = W(V) / V. With probability 1 - alpha it stays within z sqrt(V_g) up to the
time V_g = 1 / c_g^2 at which the interval is as narrow as the goal requires (O'Brien and Fleming 1979; z =
1.645 for 80 %). Until then all intervals |Y - P| <= P z c^2 / c_g cover the truth P together.
"""

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtri, stdtrit

from fewruns.combining import BatchEstimate, Combined, combine, ends

TERMS = 50  # number of terms of the series in `boundary`


@lru_cache
def boundary(alpha: float) -> float:
    """Return z with P(|W(V)| > z sqrt(V_g) for any V <= V_g) = alpha, for a Brownian motion W."""
    odd = 2 * np.arange(TERMS) + 1

    def excess(z: float) -> float:
        stays = 4 / math.pi * ((-1) ** np.arange(TERMS) / odd * np.exp(-((odd * math.pi / z) ** 2) / 8)).sum()
        return 1 - alpha - float(stays)

    return float(brentq(excess, 0.1, 20.0))


def reach_of_goal(beta: float) -> float:
    """Return the relative error r for which the half-width of Y / (1 + r) to Y / (1 - r) is beta Y."""
    return (math.sqrt(1 + 4 * beta**2) - 1) / (2 * beta)


def anytime_interval(
    batches: Sequence[BatchEstimate], alpha: float, beta: float
) -> tuple[Combined, tuple[float, float]]:
    """Return the estimate from two or more batches, and an interval that may be checked after each of them.

    It is based on the first batches with which the half-width is at most beta times the estimate, or on all.
    """
    goal = reach_of_goal(beta)
    for count in range(2, len(batches) + 1):
        combined = combine(batches[:count])
        reach = boundary(alpha) * _inflated(combined, alpha)
        if reach <= goal:
            break
    # The boundary is z c^2 / c_g, and z c_g is the reach of the goal.
    return combined, ends(combined.probability, goal * max(reach / goal, 1.0) ** 2)


def _inflated(combined: Combined, alpha: float) -> float:
    """Return the coefficient of variation times the ratio of Student's quantile to the normal quantile."""
    if combined.probability <= 0:
        return math.inf
    student = float(stdtrit(combined.batches - 1, 1 - alpha / 2) / ndtri(1 - alpha / 2))
    return student * combined.error
