"""Repetitions of runs, which show whether the outcomes of a system are deterministic."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from fewruns.arrays import Array, Flags, Indices
from fewruns.constants import LARGEST_SCORE, OFTEN, SAME_SCORE


@dataclass(frozen=True)
class RepeatBatch:
    """A batch of runs that are repeated."""

    z: Annotated[Array, "batch", "dimension"]
    repeated: Annotated[Indices, "batch"]  # indices of the repeated runs among all runs


@dataclass(frozen=True)
class Repeats:
    """Outcomes of the repetitions so far."""

    repeated: Annotated[Indices, "repeats"]  # indices of the repeated runs among all runs
    happened: Annotated[Flags, "repeats"]  # whether the event happened in the repetition
    # Whether the outcome differed from that of the run, in the flag or in the score.
    differed: Annotated[Flags, "repeats"]

    @classmethod
    def none(cls) -> "Repeats":
        """Return an empty record, for a sampler that has not repeated any run."""
        return cls(np.empty(0, np.int64), np.empty(0, bool), np.empty(0, bool))

    def __len__(self) -> int:
        """Return the number of repeats."""
        return len(self.repeated)

    def extended(self, batch: RepeatBatch, happened: Flags, differed: Flags) -> "Repeats":
        """Return the record with the repetitions of a batch added."""
        return Repeats(
            np.append(self.repeated, batch.repeated),
            np.append(self.happened, happened),
            np.append(self.differed, differed),
        )

    @property
    def vary_often(self) -> bool:
        """Whether at least the share `OFTEN` of the repetitions differ, as for a system with noise."""
        return len(self) > 0 and bool(self.differed.mean() >= OFTEN)


def end_differently(happened: Flags, score: Array, again: Flags, score_again: Array) -> Flags:
    """Return which repetitions ended differently from their runs, in the flag or in the score, shape (n,)."""
    return (happened != again) | ~np.isclose(score, score_again, rtol=SAME_SCORE, atol=SAME_SCORE)


def choose_repeats(
    z: Array,
    happened: Flags,
    score: Array,
    known: Repeats,
    count: int,
    generator: np.random.Generator,
) -> RepeatBatch:
    """Return ``count`` runs to repeat next: half of them with the event, half without it, in random order.

    The runs that were repeated least often are chosen first, and among these those nearest to the boundary of
    the event, judged by their scores. Runs with an infinite score are repeated only if all runs without the
    event are of this kind.
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
