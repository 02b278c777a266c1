"""Repetitions of runs, which show whether the outcomes of a system are deterministic."""

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from scipy.spatial.distance import cdist
from scipy.special import bdtr

from fewruns.arrays import Array, Flags, Indices
from fewruns.constants import DRIFT, DRIFT_PAIRS, FREQUENT_SHARE, LARGEST, OFTEN, SAME_SCORE, UNSEEN_ALPHA
from fewruns.wide_laws import rarity


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
    score: Annotated[Array, "repeats"]

    @classmethod
    def none(cls) -> "Repeats":
        """Return an empty record, for a sampler that has not repeated any run."""
        return cls(np.empty(0, np.int64), np.empty(0, bool), np.empty(0, bool), np.empty(0))

    def __len__(self) -> int:
        """Return the number of repeats."""
        return len(self.repeated)

    def extended(self, batch: RepeatBatch, happened: Flags, differed: Flags, score: Array) -> "Repeats":
        """Return the record with the repetitions of a batch added."""
        return Repeats(
            np.append(self.repeated, batch.repeated),
            np.append(self.happened, happened),
            np.append(self.differed, differed),
            np.append(self.score, score),
        )

    @property
    def pairs(self) -> tuple[Indices, Indices]:
        """The first and the last repetition of each run that was repeated, which may be the same one.

        Runs are chosen to be repeated by their outcomes, so that a run and its repetition are no pair.
        """
        first = np.unique(self.repeated, return_index=True)[1]
        return first, len(self) - 1 - np.unique(self.repeated[::-1], return_index=True)[1]

    def pairs_wanted(self, rounds: int) -> int:
        """Return how many runs still have to be repeated, so that enough have ``rounds`` late repetitions."""
        times = np.unique(self.repeated, return_counts=True)[1]
        return max(min(DRIFT_PAIRS, len(times)) - int(np.count_nonzero(times > rounds)), 0)

    @property
    def drift(self) -> bool:
        """Whether late repetitions differ from early ones in one direction more often than by chance.

        The pairs are also checked without those of two events, whose scores may say little.
        """
        first, last = self.pairs
        early, late = self.happened[first], self.happened[last]
        change = np.where(early != late, early.astype(float) - late, self.score[last] - self.score[first])
        return _is_one_way(change) or _is_one_way(change[~(early & late)])

    @property
    def vary_often(self) -> bool:
        """Whether at least the share `OFTEN` of the repetitions differ, as for a system with noise."""
        return len(self) > 0 and bool(self.differed.mean() >= OFTEN)


def _is_one_way(change: Array) -> bool:
    """Return whether more of the changes have the same sign than by chance, by a sign test."""
    up, down = np.count_nonzero(change > 0), np.count_nonzero(change < 0)
    return bool(2 * bdtr(min(up, down), up + down, 0.5) < DRIFT)


def end_differently(happened: Flags, score: Array, again: Flags, score_again: Array) -> Flags:
    """Return which repetitions ended differently from their runs, in the flag or in the score, shape (n,)."""
    return (happened != again) | ~np.isclose(score, score_again, rtol=SAME_SCORE, atol=SAME_SCORE)


def choose_repeats(
    z: Array,
    happened: Flags,
    score: Array,
    known: Repeats,
    count: int,
    expected: Flags,
    frequent: Flags,
    *,
    rounds: int = 0,
) -> RepeatBatch:
    """Return ``count`` runs to repeat next, those that were repeated least often, and of these events first.

    An event that a lapse has caused hardly ever happens again, so that the repetition of each event finds the
    lapses among all runs. Events that were ``expected`` before they happened are not repeated, because lapses
    would not show there. Then come the runs that were nearest to the event by their scores. Runs with an
    infinite score are repeated only if all runs without the event are of this kind. Half of the very first
    repetitions are without the event. After them, at least the share `FREQUENT_SHARE` of all repetitions are
    of runs without the event that are ``frequent`` (`where_lapses_matter`), each time where fewest others are
    near. If the outcomes of most runs are random, all are that look for a drift, evenly from near to far,
    because the scores of events may say little. With ``rounds``, runs are repeated that have no more than so
    many repetitions.
    """
    times = np.bincount(known.repeated, minlength=len(z))
    safe = ~happened & (score < LARGEST)
    kind = np.flatnonzero(safe | (happened & ~expected) if safe.any() else np.ones(len(z), bool))
    nearness = np.where(happened, -score, score)  # smallest for the runs nearest to the boundary
    ordered = kind[np.lexsort((nearness[kind], ~happened[kind], times[kind]))]
    if rounds:
        again = known.repeated[np.sort(known.pairs[0])]
        again = again[times[again] <= rounds]
        ordered = again[np.lexsort((-times[again], happened[again]))]
    elif known.vary_often:
        never = ordered[~happened[ordered] & (times[ordered] == 0)]
        ordered = np.append(never[:: max(len(never) // DRIFT_PAIRS, 1)], ordered)
    elif not len(known):
        events, others = ordered[happened[ordered]], ordered[~happened[ordered]]
        ordered = np.concatenate([events[: count // 2], others, events])
    else:
        others = ordered[frequent[ordered] & ~happened[ordered]]
        missing = math.ceil(FREQUENT_SHARE * (len(known) + count)) - times[others].sum()
        near = np.exp(-cdist(z[others], z[known.repeated], "sqeuclidean") / 2).sum(axis=1)
        first = others[np.argsort(near)][: max(missing, 0)]
        ordered = np.append(first, ordered[~np.isin(ordered, first)])
    chosen = np.resize(ordered, count)
    return RepeatBatch(z[chosen], chosen.astype(np.int64))


def where_lapses_matter(z: Array, probability: float, checks: int) -> Flags:
    """Return which points, shape (n, d), are so frequent that lapses there could matter.

    If ``checks`` repetitions without a difference leave the rate r of lapses possible, lapses beyond a rarity
    R add at most r exp(-R), which is less than the ``probability`` of the event if R is large.
    """
    largest = 1 - UNSEEN_ALPHA ** (1 / checks)
    return (probability > 0) & (largest * np.exp(-rarity(z)) > probability)
