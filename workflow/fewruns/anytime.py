"""Intervals that keep their confidence level although they are checked after every batch.

An interval of confidence 1 - alpha covers the truth with this probability if it is computed once, at a time
that was chosen beforehand. If it is checked after every batch, the probability that at least one of the
intervals misses the truth is larger than alpha.

Let P be the true probability, and c_t the coefficient of variation of the estimate Y_t after t batches. The
weighted errors of the batches are a martingale. In the time V = 1 / c^2 it is close to a Brownian motion W:
(Y_t - P) / P = W(V_t) / V_t. With probability 1 - alpha the motion stays within z sqrt(V_g) up to the time
V_g, where z follows from its reflection principle (1.645 for 80 %). This is the boundary of O'Brien and
Fleming (1979). V_g = 1 / c_g^2 is the time at which the interval is as narrow as the goal requires. Until
then all intervals with

    |Y_t - P| <= P z c_t^2 / c_g

cover the truth together with probability 1 - alpha. After V_g the interval stays as it was then.

These intervals do not include a part of the event that no run has met, because they are based on the
predicted and observed variances. The module `certificate` bounds the probability of such a part.
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
    """Return the boundary z that a Brownian motion W crosses with probability alpha.

    W crosses the boundary if |W(V)| > z sqrt(V_g) at any time V in [0, V_g]. The probability that it does not
    is (4 / pi) sum_k (-1)^k / (2k + 1) exp(-(2k + 1)^2 pi^2 / (8 z^2)). It is equated with 1 - alpha.
    """
    odd = 2 * np.arange(TERMS) + 1

    def excess(z: float) -> float:
        stays = 4 / math.pi * ((-1) ** np.arange(TERMS) / odd * np.exp(-((odd * math.pi / z) ** 2) / 8)).sum()
        return 1 - alpha - float(stays)

    return float(brentq(excess, 0.1, 20.0))


def reach_of_goal(beta: float) -> float:
    """Return the relative error r for which the half-width of an interval is beta times the estimate Y.

    The interval is that from Y / (1 + r) to Y / (1 - r).
    """
    return (math.sqrt(1 + 4 * beta**2) - 1) / (2 * beta)


def anytime_interval(
    batches: Sequence[BatchEstimate], alpha: float, beta: float
) -> tuple[Combined, tuple[float, float]]:
    """Return an estimate and an interval that covers the truth at all checks with probability 1 - alpha.

    Parameters
    ----------
    batches
        The batches on which the estimate is based, at least two, in their order.
    alpha
        Probability that any of the intervals misses the truth.
    beta
        Goal for the half-width of the interval, divided by the estimate.

    Returns
    -------
    combined : Combined
        The estimate from the first batches with which the goal is met, or from all batches if it is not.
    interval : tuple of float
        The ends of the interval; the upper one may be infinite.
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
