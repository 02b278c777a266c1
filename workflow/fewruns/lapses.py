"""A bound on the probability that lapses add, if these are not less likely at harder points.

If n runs in a set of points of probability Q had no event, lapses may still cause events there with a
probability of up to 3 Q / n (95 % confidence). The points are ordered by their hardness, which is the
probability of the event predicted by a surrogate of the flags, and divided into shells, each with a tenth of
the probability of the next easier one. The assumption is that the probability of a lapse that ends in the
event is the same in a shell, and not smaller in harder ones, so that their runs also bound that in easier
shells.
"""

import math

import numpy as np

from fewruns.arrays import Array, Flags
from fewruns.constants import NOISY_AMPLITUDE, POOL, UNSEEN_ALPHA
from fewruns.gaussian_process import EventSurrogate
from fewruns.law_draws import upper_limit
from fewruns.wide_laws import draw_wide, log_normal_to_wide

# The hardest points, in which the event is covered by the estimate, have KNOWN times the probability of the
# estimate, or the probability HARDEST if there is no estimate.
KNOWN, HARDEST = 10.0, 1e-6

SEED = np.random.SeedSequence(0, spawn_key=(2259220878,))  # of the draws from which masses follow


def monotone_bound(z: Array, happened: Flags, probability: float) -> float:
    """Return the bound from the flags of runs at z, shape (n, d), and the estimate, which may be NaN or 0."""
    if not len(z):
        return 1.0
    is_known = probability > 0
    surrogate = EventSurrogate(z.shape[1], amplitude=NOISY_AMPLITUDE)
    surrogate.fit(z, happened, learn=False)
    # These draws need no simulation. They are the same in every call, so that the bound has no noise.
    points = draw_wide(POOL, z.shape[1], np.random.Generator(np.random.PCG64(SEED)))
    harder = _mass_of_harder(surrogate, points, z)
    edges = _edges(KNOWN * probability if is_known else HARDEST)
    shells = np.digitize(harder, edges) - 1  # -1 for the hardest points, which the estimate covers
    count = np.array([np.count_nonzero(shells == k) for k in range(len(edges) - 1)])
    events = np.array([np.count_nonzero(happened & (shells == k)) for k in range(len(edges) - 1)])
    mass, each = np.diff(edges), UNSEEN_ALPHA / max(len(edges) - 1, 1)
    own, pooled = upper_limit(events, count, each), upper_limit(events.cumsum(), count.cumsum(), each)
    return float(mass @ np.minimum(own, pooled)) + (0.0 if is_known else HARDEST)


def _edges(least: float) -> Array:
    """Return the rising edges of the shells: ``least``, powers of ten above it, and 1."""
    decades = max(math.ceil(-math.log10(least)), 1) if least < 1 else 0
    return np.unique(np.append(np.logspace(-decades, 0, decades + 1).clip(least), 1.0))


def _mass_of_harder(surrogate: EventSurrogate, points: Array, z: Array) -> Array:
    """Return for each run of z, shape (n, d), the probability of all points that are at least as hard."""
    hardness = surrogate.probability(points)
    order = np.argsort(hardness)
    mass = np.exp(log_normal_to_wide(points[order])) / len(points)
    harder = np.append(np.cumsum(mass[::-1])[::-1], 0.0)
    place = np.searchsorted(hardness[order], surrogate.probability(z))
    return np.clip(harder[place] / harder[0], 0.0, np.nextafter(1.0, 0.0))
