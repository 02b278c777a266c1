"""Probabilities of intervals that are accurate in far tails."""

import numpy as np
from numpy.typing import ArrayLike

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.distributions.mixture import Mixture
from accelerated_evaluation.laws.distributions.protocol import Distribution


def interval_probability(law: Distribution, start: ArrayLike, end: ArrayLike) -> Array:
    """Return P(start <= X < end), element by element, without subtracting nearly equal numbers.

    For a mixture, the weighted probabilities of the components are added up. The end may be infinite.
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
