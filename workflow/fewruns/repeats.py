"""Repetitions of runs, which show whether the outcomes of a vehicle are deterministic.

If a vehicle behaves differently in one run out of a hundred, a few hundred runs of different encounters do
not reveal this, although most of its crashes may happen in these rare runs. Repetitions of the same
encounters can. If n repetitions agree with their runs, the share of all repetitions that differ is below
log(1 / alpha) / n with confidence 1 - alpha.
"""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from scipy.special import betaincinv

from fewruns.arrays import Array, Flags, Indices
from fewruns.constants import LARGEST_SCORE, OFTEN, SAME_SCORE


@dataclass(frozen=True)
class RepeatBatch:
    """A batch of runs that are repeated.

    Attributes
    ----------
    z
        Normal scores to simulate, shape (n, d).
    repeated
        Indices of the repeated runs among all runs, shape (n,).
    """

    z: Annotated[Array, "batch", "dimension"]
    repeated: Annotated[Indices, "batch"]


@dataclass(frozen=True)
class Repeats:
    """Outcomes of the repetitions so far; every array has shape (k,).

    Attributes
    ----------
    repeated
        Indices of the repeated runs among all runs.
    happened
        Whether the event happened in the repetition.
    differed
        Whether the outcome differed from that of the run, in the flag or in the score.
    """

    repeated: Annotated[Indices, "repeats"]
    happened: Annotated[Flags, "repeats"]
    differed: Annotated[Flags, "repeats"]

    @classmethod
    def none(cls) -> "Repeats":
        """Return an empty record, for a sampler that has not repeated any run."""
        return cls(np.empty(0, np.int64), np.empty(0, bool), np.empty(0, bool))

    def __len__(self) -> int:
        """Return the number of repeats."""
        return len(self.repeated)

    def extended(self, batch: RepeatBatch, happened: Flags, differed: Flags) -> "Repeats":
        """Return the record with the repetitions of a batch added.

        Parameters
        ----------
        batch
            The repeated runs.
        happened, differed
            Whether the event happened in each repetition, and whether its outcome differed, shape (n,).
        """
        return Repeats(
            np.append(self.repeated, batch.repeated),
            np.append(self.happened, happened),
            np.append(self.differed, differed),
        )

    @property
    def vary_often(self) -> bool:
        """Whether the share of repetitions that differ is at least `OFTEN`, as for a vehicle with noise.

        Otherwise the outcomes of only a few runs may be random.
        """
        return len(self) > 0 and bool(self.differed.mean() >= OFTEN)

    def largest_share(self, alpha: float) -> float:
        """Return an upper bound, with confidence 1 - alpha, on the share of repetitions that differ.

        This is the upper limit of Clopper and Pearson. It is 1 if there is no repetition.
        """
        differed = int(np.count_nonzero(self.differed))
        if differed == len(self):
            return 1.0
        return float(betaincinv(differed + 1, len(self) - differed, 1 - alpha))


def end_differently(happened: Flags, score: Array, again: Flags, score_again: Array) -> Flags:
    """Return which repetitions ended differently from their runs, in the flag or in the score, shape (n,).

    Parameters
    ----------
    happened, score
        Whether the event happened in each run, and its score, shape (n,).
    again, score_again
        Whether the event happened in each repetition, and its score, shape (n,).
    """
    return (happened != again) | ~np.isclose(score, score_again, rtol=SAME_SCORE, atol=SAME_SCORE)


def choose_repeats(
    z: Array,
    happened: Flags,
    score: Array,
    known: Repeats,
    count: int,
    generator: np.random.Generator,
) -> RepeatBatch:
    """Return the runs to repeat next: half of them with the event, half without it.

    In each half, the runs that were repeated least often are chosen first. Among these, the runs nearest to
    the boundary of the event are chosen first, judged by their scores. Runs with an infinite score, such as
    those in which the host never approached the other vehicle, are repeated only if all runs without the
    event are of this kind. If there are no runs of one half, all repeated runs are of the other.

    Parameters
    ----------
    z, happened, score
        Normal scores, shape (n, d), flags and scores, shape (n,), of all runs.
    known
        The repetitions so far.
    count
        Number of runs to choose; a run may be chosen more than once if there are too few.
    generator
        Source of randomness for the order of the chosen runs.
    """
    times = np.bincount(known.repeated, minlength=len(z))
    safe = ~happened & (score < LARGEST_SCORE)
    kinds = [np.flatnonzero(happened), np.flatnonzero(safe if safe.any() else ~happened)]
    nearness = np.where(happened, -score, score)  # smallest for the runs nearest to the boundary
    ordered = [kind[np.lexsort((nearness[kind], times[kind]))] for kind in kinds]
    events = min(count // 2, len(ordered[0])) if len(ordered[1]) else count
    chosen = np.concatenate([np.resize(ordered[0], events), np.resize(ordered[1], count - events)])
    chosen = generator.permutation(chosen).astype(np.int64)
    return RepeatBatch(z[chosen], chosen)
