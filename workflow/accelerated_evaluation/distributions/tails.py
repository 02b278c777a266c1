"""Probabilities of intervals, and quantiles of normal scores, that are accurate in far tails."""

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
        The distribution of X. For a mixture, the sum is over the components that overlap an interval.
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
    """Return the quantile x of ``law`` at the normal score z, so that F(x) = Phi(z).

    Above the median the survival function is inverted, and below it the distribution function, so that
    neither tail loses accuracy by rounding near one.
    """
    value, above = np.empty_like(z), z > 0
    # A side without points is skipped: the quantiles of a mixture take long even for none.
    if above.any():
        value[above] = law.isf(ndtr(-z[above]))
    if not above.all():
        value[~above] = law.ppf(ndtr(z[~above]))
    return value
