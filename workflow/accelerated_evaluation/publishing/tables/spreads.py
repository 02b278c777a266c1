"""Our numbers with their spread: quantiles over replicates or seeds, or a confidence interval."""

import math
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.special import ndtri

from accelerated_evaluation.methods.importance_sampling import crude_simulations


class Spread(NamedTuple):
    """One of our numbers with its spread.

    Attributes
    ----------
    value
        The number.
    low, high
        Limits of the spread.
    of
        Description of the spread, such as "10-90 % over 10 replicates".
    """

    value: float
    low: float
    high: float
    of: str


def spread_over(values: ArrayLike, things: str) -> Spread:
    """Return the mean of values with their 10 and 90 % quantiles as spread.

    Parameters
    ----------
    values
        The values, of any shape.
    things
        What the values belong to, such as "replicates", for the description of the spread.
    """
    values = np.asarray(values, dtype=float)
    low, high = np.quantile(values, (0.1, 0.9))
    return Spread(float(values.mean()), float(low), float(high), f"10-90 % over {values.size} {things}")


def count(number: int) -> Spread:
    """Return a number that is known exactly as a `Spread` of width zero."""
    return Spread(number, number, number, "none, a count")


def of_method(table: pd.DataFrame, method: str, scope: str = "all") -> pd.DataFrame:
    """Return the rows of a table of estimates that belong to one method and scope.

    Parameters
    ----------
    table
        Estimates, or their courses over the simulations, with columns ``method`` and ``scope``.
    method
        Name of the method.
    scope
        Name of a segment, or ``all`` for all segments together.
    """
    return table[(table["method"] == method) & (table["scope"] == scope)]


def pooled_probability(course: pd.DataFrame, method: str, alpha: float, scope: str = "all") -> Spread:
    """Pool the last rows of all replicates' courses into one estimate.

    The courses continue beyond convergence. Unlike the mean of the estimates at convergence, the pooled
    estimate is therefore not biased by a stopping rule.

    Parameters
    ----------
    course
        ``estimates_course.csv`` of a study: estimates during the simulations of each replicate.
    method
        Name of the method.
    alpha
        The level of the interval is 1 - alpha.
    scope
        Name of a segment, or ``all`` for all segments together.

    Returns
    -------
    Spread
        The mean probability, weighted by the numbers of simulations, with its normal interval of level
        1 - alpha.
    """
    last = of_method(course, method, scope).groupby("replicate").last()
    weight = last["simulations"] / last["simulations"].sum()
    probability = float(weight @ last["probability"])
    half_width = float(-ndtri(alpha / 2)) * math.sqrt(weight**2 @ last["variance"])
    simulations = last["simulations"].sum()
    of = f"{100 * (1 - alpha):g} % interval of {simulations:,} simulations"
    low, high = max(probability - half_width, 0.0), min(probability + half_width, 1.0)
    return Spread(probability, low, high, of)


def sample_size(estimates: pd.DataFrame, method: str) -> Spread:
    """Return the number of simulations to convergence over all segments.

    The number is the mean over the replicates. A replicate that did not converge contributes the simulations
    that it made, fewer than it needs; the description of the spread then says how many did not converge.

    Parameters
    ----------
    estimates
        ``estimates.csv`` of a study.
    method
        Name of the method.
    """
    rows = of_method(estimates, method)
    spread = spread_over(rows["simulations"], "replicates")
    missing = int((~rows["converged"]).sum())
    return spread._replace(of=f"{spread.of}, {missing} not converged") if missing else spread


def crude_sample_size(probability: Spread, alpha: float, beta: float) -> Spread:
    """Return the number of simulations that crude Monte Carlo would need (section VI.C, N-hat).

    Parameters
    ----------
    probability
        The crash probability; the spread of the number results from its limits.
    alpha, beta
        Convergence is a relative half-width beta of the interval with level 1 - alpha.
    """
    value, high, low = (
        crude_simulations(p, alpha, beta) if p > 0 else math.inf
        for p in (probability.value, probability.low, probability.high)
    )
    return Spread(value, low, high, f"from the {probability.of}")
