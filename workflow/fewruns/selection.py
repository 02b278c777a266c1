"""Selection of points of a weighted pool: inclusion probabilities, and systematic sampling with them."""

import numpy as np
from numpy.typing import NDArray

from fewruns.arrays import Array


def inclusion_probabilities(size: Array, guard: Array, n: float, defence: float) -> Array:
    """Return inclusion probabilities that sum to n and are proportional to a mixture of two measures.

    The mixture consists of the normalised ``size`` with the share 1 - ``defence`` and of the normalised
    ``guard`` with the share ``defence``. A point whose probability would exceed 1 is included with certainty,
    and the remaining probability is divided among the others. This may raise further points above 1, so the
    step is repeated.

    Parameters
    ----------
    size
        Importance of each of the m points, shape (m,). If all values are 0, only ``guard`` is used.
    guard
        Distribution of the defensive runs, shape (m,), positive wherever the event is possible.
    n
        Sum of the inclusion probabilities.
    defence
        Share of the defensive runs.
    """
    size = size if size.any() else guard
    size = (1 - defence) * size / size.sum() + defence * guard / guard.sum()
    certain = np.zeros(len(size), bool)
    while True:
        inclusion = np.where(certain, 1.0, (n - certain.sum()) * size / size[~certain].sum())
        if not (new := (inclusion >= 1) & ~certain).any():
            return inclusion
        certain |= new


def draws_of_the_wide_law(wide: Array, inclusion: Array) -> float:
    """Return the number of draws from a wide distribution to which a sample of the pool is equivalent.

    In N draws from the wide distribution, a point of a pool of m points would be expected N wide / m times.
    The result is the largest N for which no inclusion probability is smaller than this.

    Parameters
    ----------
    wide
        Density of the wide distribution divided by the density of the pool, shape (m,).
    inclusion
        Inclusion probabilities, shape (m,).
    """
    within = wide > 0
    with np.errstate(over="ignore"):  # where the wide density underflows; such points are not the minimum
        draws = inclusion[within] / wide[within]
    return float(draws.min() * len(inclusion)) if within.any() else 0.0


def draw_systematically(
    z: Array, importance: Array, inclusion: Array, generator: np.random.Generator
) -> NDArray[np.intp]:
    """Draw points of a pool by systematic sampling with given inclusion probabilities; return their indices.

    The points are ordered along the principal axis of the important points, and the inclusion probabilities
    are cumulated in this order. A point is selected wherever the cumulated sum passes u, u + 1, u + 2, ...
    for one uniform random number u. Every point then has its inclusion probability, and the runs are spread
    along the axis, like a stratified sample with one run in each stratum.

    Parameters
    ----------
    z
        Normal scores of the pool, shape (m, d).
    importance
        Weight of each point for the principal axis, shape (m,).
    inclusion
        Inclusion probabilities, shape (m,); their sum is the number of runs.
    generator
        Source of the uniform number.
    """
    order = along_principal_axis(z, importance)
    marks, n = np.cumsum(inclusion[order]), round(inclusion.sum())
    # The marks are scaled, because the last one may be slightly below n by rounding.
    return order[np.searchsorted(marks / marks[-1] * n, generator.random() + np.arange(n))]


def along_principal_axis(z: Array, importance: Array) -> NDArray[np.intp]:
    """Return the indices that sort points along the first principal axis of the weighted points, shape (m,).

    Parameters
    ----------
    z, importance
        Points, shape (m, d), and their weights, shape (m,).
    """
    share = importance / importance.sum() if importance.any() else np.full(len(z), 1 / len(z))
    centred = z - share @ z
    return np.argsort(centred @ np.linalg.eigh((centred.T * share) @ centred)[1][:, -1])


def spread_by_mass(z: Array, mass: Array, count: int) -> NDArray[np.intp]:
    """Return the indices of points of a pool that represent equal parts of a mass.

    The points are ordered along the principal axis of the mass. The mass is divided into ``count`` equal
    parts in this order, and the point in the middle of each part is selected. No random number is used.

    Parameters
    ----------
    z
        Normal scores of the pool, shape (m, d).
    mass
        Mass of each point, not negative, shape (m,).
    count
        Number of indices; there are none if all masses are 0.
    """
    if not mass.any():
        return np.empty(0, dtype=np.intp)
    order = along_principal_axis(z, mass)
    marks = np.cumsum(mass[order])
    return order[np.searchsorted(marks / marks[-1] * count, np.arange(count) + 0.5)]
