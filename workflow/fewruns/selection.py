"""Selection of points of a weighted pool: inclusion probabilities, and systematic sampling with them."""

import numpy as np

from fewruns.arrays import Array, Flags, Indices


def inclusion_probabilities(size: Array, guard: Array, n: float, defence: float) -> Array:
    """Return inclusion probabilities, shape (m,), with the sum n, for a mixture of ``size`` and ``guard``.

    A point whose probability would exceed 1 is included with certainty, and the rest is divided again.
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
    """Return the number N of draws from a wide law to which a sample of m points is equivalent.

    It is the largest N for which no inclusion probability is smaller than N wide / m.
    """
    within = wide > 0
    with np.errstate(over="ignore"):  # where the wide density underflows; such points are not the minimum
        draws = inclusion[within] / wide[within]
    return float(draws.min() * len(inclusion)) if within.any() else 0.0


def draw_systematically(
    z: Array, importance: Array, inclusion: Array, generator: np.random.Generator
) -> Indices:
    """Draw points of a pool by systematic sampling with given inclusion probabilities; return their indices.

    Along the principal axis of the important points, a point is selected wherever the cumulated probability
    passes u, u + 1, ... for one uniform number u. The runs are then spread like a stratified sample.
    """
    order = along_principal_axis(z, importance)
    marks, n = np.cumsum(inclusion[order]), round(inclusion.sum())
    # The marks are scaled, because the last one may be slightly below n by rounding.
    scaled = marks * (n / marks[-1]) if n else marks
    return order[np.searchsorted(scaled, generator.random() + np.arange(n))]


def along_principal_axis(z: Array, importance: Array) -> Indices:
    """Return the indices that sort weighted points, shape (m, d), along their first principal axis."""
    share = importance / importance.sum() if importance.any() else np.full(len(z), 1 / len(z))
    centred = z - share @ z
    return np.argsort(centred @ np.linalg.eigh((centred.T * share) @ centred)[1][:, -1])


def spread_by_mass(z: Array, mass: Array, count: int) -> Indices:
    """Return the indices of ``count`` points that represent equal parts of a mass; none if it is 0."""
    if not mass.any():
        return np.empty(0, dtype=np.intp)
    order = along_principal_axis(z, mass)
    marks = np.cumsum(mass[order])
    return order[np.searchsorted(marks / marks[-1] * count, np.arange(count) + 0.5)]


def choose_covering(inside: Flags, n: int, again: float = 0.0) -> Indices:
    """Return n of m points of which most of t sets contain one, given what they contain, shape (m, t).

    The need of a set that contains a chosen point is multiplied by ``again``.
    """
    need, chosen = np.ones(inside.shape[1]), []
    for _ in range(n):
        gain = inside @ need
        gain[chosen] = -1.0
        chosen.append(gain.argmax())
        need[inside[chosen[-1]]] *= again
    return np.array(chosen)
