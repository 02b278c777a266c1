"""The search for the event, and for its most probable part: some runs in every step of rarity.

The rarity of a point is -log P(|Z| > |z|). A score that falls as the event comes nearer may be smallest far
out, where hardly any of the probability is. So the search divides the rarities into steps, and every step
gets a run where a regression of the scores gives the event a good chance. Scores may also lead to where no
event is: after a run for every unit of rarity without one, half of the runs go where no run is near instead.
Once an event is seen, the search goes on among the points that are more probable, or hardly less, until it
has looked there closely enough.
"""

import numpy as np

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.methods.surrogate.constants import CANDIDATES
from accelerated_evaluation.methods.surrogate.gaussian_process import EventSurrogate
from accelerated_evaluation.methods.surrogate.graded import GradedSurrogate, end_of_events, graded
from accelerated_evaluation.methods.surrogate.two_phase import Flags
from accelerated_evaluation.methods.surrogate.wide_laws import draw_at, rarity


def to_beat(rarity: Array, outcome: Array, happened: Flags, at: Array) -> Array:
    """Return the outcome below which a point of some rarity is wanted, shape (m,).

    Where an event is known, it is the end of the events. Before, it is the smallest outcome of the runs that
    are not rarer than the point, or of the least rare run.

    Parameters
    ----------
    rarity, outcome, happened
        Of all runs, shape (n,).
    at
        Rarity of the points, shape (m,).
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
    """Draw one point in each step of rarity, where the event is expected; shape (runs, d).

    The steps are finer the rarer, because a part of the event that begins at some rarity is met beyond it
    too, and more easily there: runs far out look for all parts, and runs near the origin for the nearest
    alone. In each step the point is one of several candidates of the wide law, taken with a probability in
    proportion to the square of its chance to be in the event.

    Parameters
    ----------
    runs
        Number of points.
    rarest
        Where the last step ends.
    z, happened, score
        Normal scores, shape (n, d), flags and scores, shape (n,), of all runs so far.
    generator
        Source of all randomness.
    in_vain
        Whether so much was searched without an event that the scores may lead astray. Then every run has even
        odds to follow the surrogate of the flags instead, which gives a chance where no run is near.
    """
    each = max(CANDIDATES // runs, 2)
    steps = np.repeat(np.arange(runs), each) + generator.random(runs * each)
    # The square root makes the density of the runs grow like the rarity.
    at = np.sqrt(steps / runs) * rarest
    candidates = draw_at(at, z.shape[1], generator)
    outcome = graded(happened, score)
    surrogate = GradedSurrogate(z.shape[1])
    surrogate.fit(z, outcome, learn=True)
    chance = surrogate.probability(candidates, to_beat(rarity(z), outcome, happened, at))
    if in_vain:
        flags = EventSurrogate(z.shape[1])
        flags.fit(z, happened, learn=False)
        by_flags = np.repeat(generator.random(runs) < 0.5, each)
        chance[by_flags] = flags.probability(candidates[by_flags])
    share = chance.reshape(runs, each) ** 2
    marks = np.cumsum(share, axis=1)
    chosen = (marks < generator.random((runs, 1)) * marks[:, -1:]).sum(1)
    return candidates.reshape(runs, each, -1)[np.arange(runs), chosen]
