"""A factor of the inclusion probabilities, so that the estimates are equally precise under all laws.

Without it, few runs are where improbable laws have their events. The variance under law k is a sum of w^2
r_k^2 e^2 / pi over the pool, with r_k = f_k / f_sampled and the error e of the surrogate. Divided by P_k^2
and averaged over the laws, it is smallest for pi proportional to w e sqrt(mean over k of (r_k / P_k)^2).
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from fewruns.arrays import Array, Function, Indices

POINTS = 150  # largest number of points at which the emphasis is evaluated
FEW_LAWS = 20  # number of laws that represent all laws, because the emphasis need not be exact
SMALLEST = 1e-3  # share of the mean probability below which no more runs are made for a less probable law


def representative(probabilities: Array) -> tuple[Indices, Array]:
    """Return the laws that represent all K laws, shape (k,), and their probabilities over the mean, (k,).

    They are chosen at equal steps of the rank of their probabilities, shape (K,).
    """
    steps = (np.arange(FEW_LAWS) + 0.5) / FEW_LAWS * probabilities.size
    chosen = np.argsort(probabilities)[steps.astype(int)]
    return chosen, np.maximum(probabilities[chosen] / probabilities.mean(), SMALLEST)


@dataclass(frozen=True)
class Emphasis:
    """Factor of the inclusion probabilities, as a function of the normal scores."""

    ratios: Function  # f_k / f_sampled of the k laws that represent all, at n points, shape (k, n)
    probabilities: Array  # of the event under each of these laws, divided by the mean over all laws

    def __call__(self, z: Array) -> Array:
        """Return the emphasis at z, shape (n, d), or at the nearest of `POINTS` points; shape (n,)."""
        if len(z) > POINTS:
            few = z[np.linspace(0, len(z) - 1, POINTS).astype(int)]
            return self(few)[cKDTree(few).query(z)[1]]
        with np.errstate(divide="ignore", invalid="ignore"):  # points so far out that a density underflows
            emphasis = np.sqrt(np.mean((self.ratios(z) / self.probabilities[:, None]) ** 2, axis=0))
        return np.where(np.isfinite(emphasis), emphasis, 1.0)
