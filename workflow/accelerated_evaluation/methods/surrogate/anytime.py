"""Intervals that may be checked after every batch: a boundary that the error of the estimate seldom crosses.

An interval of confidence 1 - alpha covers the truth with this probability if it is computed once, at a time
that was chosen beforehand. Somebody who checks it after every batch has many chances to see one that misses.

Let c_t be the coefficient of variation of the estimate Y_t after t batches. The weighted errors of the
batches are a martingale. In the time V = 1 / c^2 it is close to a Brownian motion W:
(Y_t - P) / P = W(V_t) / V_t. With probability 1 - alpha the motion stays within z sqrt(V_g) up to the time
V_g, where z follows from its reflection principle (1.645 for 80 %). This is the boundary of O'Brien and
Fleming (1979). V_g is the time at which the interval is as narrow as the goal asks. Until then all intervals
with

    |Y_t - P| <= P z c_t^2 / c_g

cover the truth together with probability 1 - alpha. After V_g the interval stays as it was then.

Nothing here protects against a part of the event that no run has met. The upper end rests on the variances
that were predicted and observed; what can be unseen is the question of `certificate`.
"""

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtri, stdtrit

from accelerated_evaluation.methods.surrogate.combining import BatchEstimate, Combined, combine, ends

TERMS = 50  # of the series of the reflection principle


@lru_cache
def boundary(alpha: float) -> float:
    """Return what |W(V)| / sqrt(V_g) exceeds on [0, V_g] with probability alpha, for a Brownian motion W.

    The probability to stay within z is (4 / pi) sum_k (-1)^k / (2k + 1) exp(-(2k + 1)^2 pi^2 / (8 z^2)).
    """
    odd = 2 * np.arange(TERMS) + 1

    def excess(z: float) -> float:
        stays = 4 / math.pi * ((-1) ** np.arange(TERMS) / odd * np.exp(-((odd * math.pi / z) ** 2) / 8)).sum()
        return 1 - alpha - float(stays)

    return float(brentq(excess, 0.1, 20.0))


def reach_of_goal(beta: float) -> float:
    """Return the r for which the interval Y / (1 + r) to Y / (1 - r) has a half-width of beta Y."""
    return (math.sqrt(1 + 4 * beta**2) - 1) / (2 * beta)


def anytime_interval(
    batches: Sequence[BatchEstimate], alpha: float, beta: float
) -> tuple[Combined, tuple[float, float]]:
    """Return an estimate and an interval that covers the truth at all checks with probability 1 - alpha.

    Parameters
    ----------
    batches
        The batches that count, at least two.
    alpha
        Probability that any of the intervals misses the truth.
    beta
        Goal: largest half-width, in relation to the estimate.

    Returns
    -------
    combined : Combined
        The estimate of the batches up to the first one with which the goal was met, or of all.
    interval : tuple of float
        Its ends; the upper one may be infinite.
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
    """Return the coefficient of variation, larger by what Student's law exceeds the normal law."""
    if combined.probability <= 0:
        return math.inf
    student = float(stdtrit(combined.batches - 1, 1 - alpha / 2) / ndtri(1 - alpha / 2))
    return student * combined.error
