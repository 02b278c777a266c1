"""Diagnostics of importance weights: their effective number, and the tail of their distribution."""

import math

import numpy as np

from fewruns.arrays import Array

FEWEST_IN_TAIL = 5  # number of ratios below which no tail is fitted
# Prior of the shape: this number of ratios with this mean shape (Vehtari and others 2024, appendix C).
PRIOR_RATIOS, PRIOR_SHAPE = 10, 0.5


def effective_number(weights: Array) -> Array:
    """Return the effective number (sum w)^2 / sum w^2 of weights, shape (..., n), as (...) (Kish 1965)."""
    return weights.sum(axis=-1) ** 2 / np.maximum((weights**2).sum(axis=-1), np.finfo(float).tiny)


def pareto_k(ratios: Array) -> float:
    """Return Pareto k-hat of S positive ratios, from the min(S / 5, 3 sqrt(S)) largest; NaN if too few."""
    size = len(ratios)
    count = math.ceil(min(size / 5, 3 * math.sqrt(size)))
    if size <= count:
        return math.nan
    tail = np.sort(ratios)[-count - 1 :]
    excess = tail[1:][tail[1:] > tail[0]] - tail[0]
    if len(excess) < FEWEST_IN_TAIL:
        return math.nan
    return (len(excess) * pareto_shape(excess) + PRIOR_RATIOS * PRIOR_SHAPE) / (len(excess) + PRIOR_RATIOS)


def largest_pareto_k(size: int) -> float:
    """Return min(1 - 1 / log10(S), 0.7), up to which S ratios have a reliable mean; NaN without ratios."""
    return min(1 - 1 / math.log10(size), 0.7) if size > 1 else math.nan


def pareto_shape(excess: Array) -> float:
    """Return the shape of a generalised Pareto distribution of n sorted positive values, shape (n,).

    The estimate is the posterior mean of Zhang and Stephens (2009), who parametrise the distribution by its
    shape k and b = -k / scale; the profile likelihood determines k for a given b.
    """
    n = len(excess)
    grid = 30 + math.isqrt(n)
    quartile = excess[math.floor(n / 4 + 0.5) - 1]
    b = 1 / excess[-1] + (1 - np.sqrt(grid / (np.arange(grid) + 0.5))) / (3 * quartile)
    shape = np.log1p(-np.outer(b, excess)).mean(axis=1)
    likelihood = n * (np.log(-b / shape) - shape - 1)
    posterior = np.exp(likelihood - likelihood.max())
    return float(np.log1p(-excess * (posterior @ b / posterior.sum())).mean())
