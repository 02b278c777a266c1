"""The search for the event and for its most probable part, with runs at every rarity.

The rarity of a point z is -log P(|Z| > |z|) for a standard normal Z. The score of a run is smaller the closer
the run came to the event, but the smallest scores may be at large rarities, which have almost no probability.
The search therefore divides the rarities into steps, and places a run in every step at a point where a
regression of the scores predicts a high probability of the event. Scores may also be misleading. If there is
no event after one run for every unit of rarity, half of the runs follow the surrogate of the flags instead,
which also predicts events far from all runs. Once an event is known, the search continues among points with a
smaller or slightly larger rarity, until it has covered them densely enough.
"""

import numpy as np

from fewruns.arrays import Array, Flags
from fewruns.constants import CANDIDATES
from fewruns.gaussian_process import EventSurrogate
from fewruns.graded import GradedSurrogate, end_of_events, graded
from fewruns.wide_laws import draw_at, rarity


def target_outcome(rarity: Array, outcome: Array, happened: Flags, at: Array) -> Array:
    """Return the value below which the graded outcome of a new run should be, at given rarities, shape (m,).

    If an event is known, this is the value that separates events from other runs. Otherwise it is the
    smallest outcome of all runs whose rarity is at most the given one. If there is no such run, it is the
    outcome of the run with the smallest rarity.

    Parameters
    ----------
    rarity, outcome, happened
        Rarities, graded outcomes and flags of all runs, shape (n,).
    at
        Rarities of new runs, shape (m,).
    """
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
    """Draw the points of a batch of the search: one in each of n steps of rarity, shape (n, d).

    The rarity of a point z is -log P(|Z| > |z|). The steps become narrower as the rarity increases, because a
    part of the event that begins at some rarity usually extends to larger ones. Runs far out can therefore
    find all parts, but runs near the origin only the nearest ones. In each step, the point is drawn from
    several candidates in uniform directions, with a probability proportional to the square of the predicted
    probability of the event.

    Parameters
    ----------
    runs
        Number n of points.
    rarest
        Upper end of the last step.
    z, happened, score
        Normal scores, shape (n, d), flags and scores, shape (n,), of all runs so far.
    generator
        Source of all randomness.
    in_vain
        Whether there is no event after a long search, so that the scores may be misleading. Each run then
        follows, with probability one half, the surrogate of the flags instead, which also predicts events far
        from all runs.
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
