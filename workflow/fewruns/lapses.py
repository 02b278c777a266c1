"""Bounds on the crash probability that lapses add, for a vehicle that behaves differently in few of its runs.

A lapse is a rare random failure of the vehicle. The estimate includes only events that the runs have met, and
lapses are seldom met. If n runs in a set of cut-ins of probability Q had no crash, lapses may still cause
crashes there with a probability of up to 3 Q / n (95 % confidence). This module bounds the probability of
such crashes; it does not estimate it. A bound needs an assumption about the cut-ins in which the vehicle
lapses. The cut-ins are ordered by their hardness, which is the probability of the event predicted by a
surrogate of the flags, and divided into shells. Each shell has a tenth of the probability of the next easier
one. One of two assumptions is made:

- *Equal hardness*: all cut-ins of a shell have the same probability of a lapse that ends in the event, so it
  does not matter which cut-ins of a shell were simulated. Every shell has a bound of its own.
- *Monotone*: in addition, this probability is not smaller in harder cut-ins. The runs of harder shells then
  also bound the probability in easier shells.

Without any assumption, n draws from the law itself without an event give the bound log(1 / alpha) / n. The
two assumptions do not reduce the number n that is needed for a given bound, because lapses that are equally
likely in all cut-ins satisfy both. Under the second assumption, the n runs may be hard cut-ins instead of
draws from the law. Only the knowledge that easy cut-ins are harmless reduces the number, to n Q if lapses
matter in a share Q of all cut-ins.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import betaincinv

from fewruns.arrays import Array, Flags
from fewruns.constants import NOISY_AMPLITUDE, POOL, UNSEEN_ALPHA
from fewruns.gaussian_process import EventSurrogate
from fewruns.wide_laws import draw_wide, log_normal_to_wide

# The hardest cut-ins, in which the event is covered by the estimate, have KNOWN times the probability of the
# estimate, or the probability HARDEST if there is no estimate.
KNOWN, HARDEST = 10.0, 1e-6

SEED = np.random.SeedSequence(0, spawn_key=(2259220878,))  # of the draws from which masses follow


@dataclass(frozen=True)
class LapseBounds:
    """Bounds, with confidence 1 - `UNSEEN_ALPHA`, on the probability that lapses can add to the estimate.

    Attributes
    ----------
    like_hardness, monotone
        The bounds under the two assumptions of the module, equal hardness and monotone. If there is no
        estimate, the hardest cut-ins are included, so these are bounds on the probability of the event.
    runs
        Number of draws from the law itself, none of them an event, that would reduce the bound to a given
        share of the estimate without any assumption. If there is no estimate, ``like_hardness`` is used
        instead, and the number is a lower limit.
    """

    like_hardness: float
    monotone: float
    runs: float

    @classmethod
    def after(cls, z: Array, happened: Flags, probability: float, share: float) -> "LapseBounds":
        """Return the bounds on the probability that lapses can add, given the flags of n runs.

        A lapse is a rare random failure of the vehicle, which the runs may have missed.

        Parameters
        ----------
        z, happened
            Normal scores of the runs, shape (n, d), and whether the event happened, shape (n,).
        probability
            The estimated probability of the event; NaN or 0 if there is no estimate.
        share
            Share of the estimate to which the number ``runs`` would reduce the bound.
        """
        if not len(z):
            return cls(1.0, 1.0, math.inf)
        is_known = probability > 0
        surrogate = EventSurrogate(z.shape[1], amplitude=NOISY_AMPLITUDE)
        surrogate.fit(z, happened, learn=False)
        # These draws need no simulation. They are the same in every call, so that the bound has no noise.
        points = draw_wide(POOL, z.shape[1], np.random.Generator(np.random.PCG64(SEED)))
        harder = _mass_of_harder(surrogate, points, z)
        edges = _edges(KNOWN * probability if is_known else HARDEST)
        shells = np.digitize(harder, edges) - 1  # -1 for the hardest cut-ins, which the estimate covers
        count = np.array([np.count_nonzero(shells == k) for k in range(len(edges) - 1)])
        events = np.array([np.count_nonzero(happened & (shells == k)) for k in range(len(edges) - 1)])
        mass, each = np.diff(edges), UNSEEN_ALPHA / max(len(edges) - 1, 1)
        own, pooled = upper_limit(events, count, each), upper_limit(events.cumsum(), count.cumsum(), each)
        rest = 0.0 if is_known else HARDEST
        alike, monotone = float(mass @ own) + rest, float(mass @ np.minimum(own, pooled)) + rest
        return cls(alike, monotone, -math.log(UNSEEN_ALPHA) / (share * (probability if is_known else alike)))


def upper_limit(events: Array, count: Array, alpha: float) -> Array:
    """Return one-sided upper limits of binomial probabilities by Clopper and Pearson, shape (k,).

    Parameters
    ----------
    events, count
        Numbers of events, and of trials, shape (k,).
    alpha
        The confidence of each limit is 1 - alpha.
    """
    return np.where(events < count, betaincinv(events + 1, np.maximum(count - events, 1), 1 - alpha), 1.0)


def _edges(least: float) -> Array:
    """Return the edges of the shells, rising.

    An edge is the probability of all cut-ins that are at least as hard as the easiest of the shell; they are
    ``least``, powers of ten above it, and 1.
    """
    decades = max(math.ceil(-math.log10(least)), 1) if least < 1 else 0
    return np.unique(np.append(np.logspace(-decades, 0, decades + 1).clip(least), 1.0))


def _mass_of_harder(surrogate: EventSurrogate, points: Array, z: Array) -> Array:
    """Return for each run of z, shape (n, d), the probability of all cut-ins that are at least as hard."""
    hardness = surrogate.probability(points)
    order = np.argsort(hardness)
    mass = np.exp(log_normal_to_wide(points[order])) / len(points)
    harder = np.append(np.cumsum(mass[::-1])[::-1], 0.0)
    place = np.searchsorted(hardness[order], surrogate.probability(z))
    return np.clip(harder[place] / harder[0], 0.0, np.nextafter(1.0, 0.0))
