"""What the runs say against statements about a problem: the direction of the scores, and upper sets."""

import numpy as np
from scipy.spatial.distance import cdist

from fewruns.arrays import Array, Flags
from fewruns.constants import STEEPEST, WRONG_WAY


def point_the_wrong_way(happened: Flags, score: Array) -> bool:
    """Return whether most events have larger scores than most other runs, given n flags and scores.

    Scores should be smaller the closer a run came to the event. Scores without any information mix, so only
    those with a changed sign are noticed.
    """
    if not happened.any() or happened.all():
        return False
    return bool(np.quantile(score[happened], 1 - WRONG_WAY) > np.quantile(score[~happened], WRONG_WAY))


def events_below_others(z: Array, happened: Flags) -> int:
    """Return how many events contradict that the event is an upper set in one of d inputs; z has (n, d).

    If it is one in input k, and its boundary is not steeper than `STEEPEST`, no other run lies above an event
    in this input by more than `STEEPEST` times their distance in all others. It is not stated which input it
    is. The number is therefore the smallest over the inputs.
    """
    below, above = z[happened], z[~happened]
    square, numbers = cdist(below, above, "sqeuclidean"), []
    for k in range(z.shape[1]):
        step = above[:, k] - below[:, k, None]
        is_above = (step > 0) & (step**2 > STEEPEST**2 * (square - step**2))
        numbers.append(int(is_above.any(axis=1).sum()))
    return min(numbers)
