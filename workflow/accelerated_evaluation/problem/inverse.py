"""Normal scores of given encounters: the inverse of the map from normal scores to encounters of a law."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from accelerated_evaluation.base.arrays import Array

REACH = 8.0  # largest absolute value of a normal score
HALVINGS = 50  # after which the interval of a score is shorter than the resolution of floats
SAME = 1e-6  # relative tolerance for an encounter that its normal scores reproduce


def normal_scores(from_normal_scores: Callable[[Array], Array], x: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Return the normal scores of encounters x, shape (n, d), by bisection of one variable after the other.

    Each variable depends on the scores up to its own, and increases or decreases with its own, as in a
    Rosenblatt transformation. The second result says whether the scores reproduce the encounter, shape (n,).
    They do not if it is outside of the law.
    """
    z = np.zeros_like(x)

    def at(value: Array | float, k: int) -> Array:
        z[:, k] = value
        return from_normal_scores(z)[:, k]

    for k in range(x.shape[1]):
        low, high = np.full(len(x), -REACH), np.full(len(x), REACH)
        increases = at(high, k) > at(low, k)
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            values = at(middle, k)
            is_below = np.where(increases, values < x[:, k], values > x[:, k])
            low, high = np.where(is_below, middle, low), np.where(is_below, high, middle)
        z[:, k] = high
    return z, np.isclose(from_normal_scores(z), x, rtol=SAME, atol=SAME).all(axis=1)
