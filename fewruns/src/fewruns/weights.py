"""The effective number of importance weights."""

import numpy as np

from fewruns.arrays import Array


def effective_number(weights: Array) -> Array:
    """Return the effective number (sum w)^2 / sum w^2 of weights, shape (..., n), as (...) (Kish 1965)."""
    return weights.sum(axis=-1) ** 2 / np.maximum((weights**2).sum(axis=-1), np.finfo(float).tiny)
