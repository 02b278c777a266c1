"""Probabilities of intervals, and quantiles at normal scores, that are accurate in far tails."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.distributions.mixture import Mixture
from accelerated_evaluation.distributions.protocol import Distribution


def interval_probability(law: Distribution, start: ArrayLike, end: ArrayLike) -> Array:
    """Return P(start <= X < end), element by element, without subtracting nearly equal numbers.

    Parameters
    ----------
    law
        The distribution of X. For a mixture, the weighted probabilities of the components are added up.
    start, end
        Ends of the intervals, of shapes that broadcast; the end may be infinite.

    Returns
    -------
    numpy.ndarray
        Probabilities, of the broadcast shape.
    """
    start, end = np.broadcast_arrays(np.asarray(start, dtype=float), np.asarray(end, dtype=float))
    if not isinstance(law, Mixture):
        low = law.logsf(start)
        with np.errstate(invalid="ignore"):
            return np.where(np.isneginf(low), 0.0, np.exp(low) * -np.expm1(law.logsf(end) - low))
    total = np.zeros(start.shape)
    for weight, component in zip(law.weights, law.components, strict=True):
        reached = (start < component.upper) & (end > component.lower)
        total[reached] += weight * interval_probability(component, start[reached], end[reached])
    return total


def normal_score_quantile(law: Distribution, z: Array) -> Array:
    """Return the quantiles x of a distribution at normal scores z, so that F(x) = Phi(z).

    Above the median the survival function is inverted, and below it the distribution function, so that
    neither tail loses accuracy by rounding near one.

    Parameters
    ----------
    law
        The distribution with the distribution function F.
    z
        Normal scores, shape (n,); Phi is the standard normal distribution function.

    Returns
    -------
    numpy.ndarray
        Quantiles, shape (n,).
    """
    value, above = np.empty_like(z), z > 0
    # A side without points is skipped, because the quantile function of a mixture takes long even then.
    if above.any():
        value[above] = law.isf(ndtr(-z[above]))
    if not above.all():
        value[~above] = law.ppf(ndtr(z[~above]))
    return value
