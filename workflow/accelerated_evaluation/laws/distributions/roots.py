"""Find the roots of many monotone functions at once."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from accelerated_evaluation.base.arrays import Array

_LIMITS = np.finfo(float)
_MOST_STEPS = 2046  # largest number of bisections: the number of different powers of two among doubles


def find_roots(
    function: Callable[[Array, NDArray[np.intp]], Array], low: Array, high: Array
) -> tuple[Array, NDArray[np.bool_]]:
    """Find a root of each of n functions by the method of Chandrupatla.

    For the method see Chandrupatla (1997, Advances in Engineering Software 28). The result is identical to
    that of `scipy.optimize.elementwise.find_root`. If there are only a few roots, SciPy's support of other
    array libraries takes longer than the iterations; this function avoids that. ``function`` takes points x
    and indices i, and returns the values f_i(x). The sign of f_i should differ at the two ends of its
    bracket. The result is the roots, NaN if there is none, and whether there is one.
    """
    root, is_found, active = np.full(low.shape, np.nan), np.zeros(low.shape, bool), np.arange(low.size)
    # Rows: newest point x1, other end of the bracket x2, last discarded point x3, and the values there.
    state = np.array([low, high, high, function(low, active), function(high, active), np.ones(low.size)])
    for step in range(_MOST_STEPS):
        x1, x2, _, f1, f2, _ = state
        best, value = np.where(abs(f1) < abs(f2), (x1, f1), (x2, f2))
        tolerance = 4 * _LIMITS.eps * abs(best) + 4 * _LIMITS.smallest_normal
        going = (np.sign(f1) != np.sign(f2)) & np.isfinite(x1) & np.isfinite(x2)
        found = (abs(value) <= _LIMITS.smallest_normal) | (going & (abs(x2 - x1) < tolerance))
        root[active[found]], is_found[active[found]] = best[found], True
        if not (going := going & ~found).any():
            break
        active, state, tolerance = active[going], state[:, going], tolerance[going]
        x1, x2, _, f1, f2, _ = state
        share = 0.5 if step == 0 else _share(state, tolerance)
        x = x1 + share * (x2 - x1)
        f = function(x, active)
        same = np.sign(f) == np.sign(f1)
        state = np.array([x, *np.where(same, (x2, x1), (x1, x2)), f, *np.where(same, (f2, f1), (f1, f2))])
    return root, is_found


def _share(state: Array, tolerance: Array) -> Array:
    """Return the position of the next point in the bracket: 0 at x1, 1 at x2, shape (k,).

    The position follows from inverse quadratic interpolation if that is safe, and is 0.5 otherwise. ``state``
    has the points x1, x2, x3 and the values f1, f2, f3, shape (6, k). ``tolerance`` is the width of the
    bracket at which the iteration ends.
    """
    x1, x2, x3, f1, f2, f3 = state
    position = (x1 - x2) / (x3 - x2)
    with np.errstate(divide="ignore", invalid="ignore"):
        height = (f1 - f2) / (f3 - f2)
    along = (x3 - x1) / (x2 - x1)
    safe = ((1 - np.sqrt(1 - position)) < height) & (height < np.sqrt(position))
    share = np.full(x1.shape, 0.5)
    f1, f2, f3, along = f1[safe], f2[safe], f3[safe], along[safe]
    share[safe] = f1 / (f1 - f2) * f3 / (f3 - f2) - along * f1 / (f3 - f1) * f2 / (f2 - f3)
    least = 0.5 * tolerance / abs(x2 - x1)
    return np.clip(share, least, 1 - least)
