"""The search for the event, and for its most probable part: one run in every step of rarity.

The rarity of a point is -log P(|Z| > |z|). A score that falls as the event comes nearer may be smallest far
out, where hardly any of the probability is. So runs are compared with runs of about the same rarity only: the
surrogate learns in which directions the score falls, and every step of rarity gets a run where it falls most.
Once an event is seen, the search goes on among the more probable points alone, until it finds no event there.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from accelerated_evaluation.distributions.protocol import Array
from accelerated_evaluation.methods.surrogate.constants import CANDIDATES, NEAR_SHARE, NEIGHBOURS
from accelerated_evaluation.methods.surrogate.wide_laws import draw_at


def came_near(rarity: Array, score: Array) -> NDArray[np.bool_]:
    """Return which runs came nearer to the event than most runs of about the same rarity, shape (n,).

    A run is near if its score is among the smallest share `NEAR_SHARE` of the `NEIGHBOURS` runs about it in
    the order of the rarity. Equal scores tell nothing: none of them is near.

    Parameters
    ----------
    rarity, score
        Of all runs, shape (n,).
    """
    order, n = np.argsort(rarity), len(rarity)
    window = min(NEIGHBOURS, n)
    first = np.clip(np.arange(n) - window // 2, 0, n - window)
    ordered = score[order]
    smaller = ordered[first[:, None] + np.arange(window)] <= ordered[:, None]
    near = np.empty(n, bool)
    near[order] = smaller.sum(1) <= NEAR_SHARE * window
    return near


def draw_approach(
    runs: int,
    rarest: float,
    dimension: int,
    probability: Callable[[Array], Array],
    generator: np.random.Generator,
) -> Array:
    """Draw one point in each of equal steps of rarity, where the event is expected; shape (n, d).

    In each step it is one of several candidates of the wide law, taken with a probability in proportion to
    the square of what the surrogate says.

    Parameters
    ----------
    runs
        Number n of points.
    rarest
        Where the last step ends.
    dimension
        Number d of normal scores.
    probability
        The surrogate: probability of being near at points, shape (m, d).
    generator
        Source of all randomness.
    """
    each = max(CANDIDATES // runs, 2)
    steps = np.repeat(np.arange(runs), each) + generator.random(runs * each)
    z = draw_at(steps / runs * rarest, dimension, generator)
    share = probability(z).reshape(runs, each) ** 2
    marks = np.cumsum(share, axis=1)
    chosen = (marks < generator.random((runs, 1)) * marks[:, -1:]).sum(1)
    return z.reshape(runs, each, dimension)[np.arange(runs), chosen]
