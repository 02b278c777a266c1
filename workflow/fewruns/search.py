"""The search for the event and for its most probable part, with runs at every rarity.

The smallest scores may be at large rarities, which have almost no probability. The search therefore divides
the rarities into steps, and places a run in every step at a point where a regression of the scores predicts a
high probability of the event. Once an event is known, the search continues up to slightly larger rarities,
until it has covered them densely enough.
"""

import numpy as np

from fewruns.arrays import Array, Flags
from fewruns.constants import CANDIDATES
from fewruns.gaussian_process import EventSurrogate
from fewruns.graded import GradedSurrogate, end_of_events, graded
from fewruns.wide_laws import draw_at, rarity


def target_outcome(rarity: Array, outcome: Array, happened: Flags, at: Array) -> Array:
    """Return the value below which the outcome of a new run should be, at m rarities ``at``, shape (m,)."""
    if happened.any():
        return np.full(len(at), end_of_events(outcome, happened))
    order = np.argsort(rarity)
    smallest = np.minimum.accumulate(outcome[order])
    return smallest[np.maximum(np.searchsorted(rarity[order], at) - 1, 0)]


def draw_approach(
    runs: int,
    rarest: float,
    z: Array,
    happened: Flags,
    score: Array,
    generator: np.random.Generator,
    *,
    in_vain: bool = False,
) -> Array:
    """Draw the n points of a batch of the search: one in each step of rarity up to ``rarest``, (n, d).

    The steps become narrower as the rarity increases, because runs far out can find all parts of the event,
    but runs near the origin only the nearest ones. If the search was ``in_vain`` for long, scores may be
    misleading, and half of the runs follow a surrogate of the flags instead.
    """
    each = max(CANDIDATES // runs, 2)
    steps = np.repeat(np.arange(runs), each) + generator.random(runs * each)
    # The square root makes the density of the runs grow like the rarity.
    at = np.sqrt(steps / runs) * rarest
    candidates = draw_at(at, z.shape[1], generator)
    outcome = graded(happened, score)
    surrogate = GradedSurrogate(z.shape[1])
    surrogate.fit(z, outcome, learn=True)
    chance = surrogate.probability(candidates, target_outcome(rarity(z), outcome, happened, at))
    if in_vain:
        flags = EventSurrogate(z.shape[1])
        flags.fit(z, happened, learn=False)
        by_flags = np.repeat(generator.random(runs) < 0.5, each)
        chance[by_flags] = flags.probability(candidates[by_flags])
    share = chance.reshape(runs, each) ** 2
    marks = np.cumsum(share, axis=1)
    chosen = (marks < generator.random((runs, 1)) * marks[:, -1:]).sum(1)
    return candidates.reshape(runs, each, -1)[np.arange(runs), chosen]
