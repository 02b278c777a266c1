"""The progress of a sampler: its runs so far, the requested batch, and what was derived from the runs."""

from dataclasses import dataclass, field
from typing import Self

import numpy as np

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.methods.surrogate.combining import BatchEstimate
from accelerated_evaluation.methods.surrogate.constants import REACH
from accelerated_evaluation.methods.surrogate.repeats import RepeatBatch, Repeats
from accelerated_evaluation.methods.surrogate.two_phase import Flags, TwoPhaseBatch


@dataclass(frozen=True)
class WideBatch:
    """A batch drawn from the wide distribution, independently of earlier runs; ``z`` has shape (n, d)."""

    z: Array


@dataclass(frozen=True)
class ApproachBatch:
    """A batch of the search, drawn where the scores predict an event; ``z`` has shape (n, d)."""

    z: Array


Batch = WideBatch | ApproachBatch | TwoPhaseBatch | RepeatBatch


@dataclass
class Progress:
    """The runs of a sampler so far, and the quantities derived from them.

    Attributes
    ----------
    z, happened, score
        Normal scores of all runs, shape (n, d), whether the event happened, and their scores, shape (n,).
    wide_draws
        Draws from the wide distribution to which the runs are equivalent: their number, and the rarities
        between which they are, shape (k, 3).
    estimates
        The estimates of all batches of the second phase.
    batches
        The batches of the second phase whose outcomes are known, with which their estimates can be reweighted
        for another law. They belong to the last of the ``estimates``; estimates of an earlier version of the
        sampler have none.
    foreseen
        Probabilities that the two surrogates predicted for all runs of the second phase, which are the last
        m, before they were made, shape (m, 2).
    repeats
        Repetitions of runs, which are not counted among the runs.
    chance, chance_since
        Whether an outcome may be random, and the number of estimates when it was found that most outcomes
        are. These estimates assumed deterministic outcomes and are no longer used.
    pending
        The batch that was requested and whose outcomes have not been received.
    centres
        Centres of the next pool, shape (k, d); None before the first pool.
    searched
        Number of runs of the search per unit of rarity, up to slightly beyond ``rarest``.
    rarest
        Rarity of the most probable event found by the search.
    directions
        Directions on which the event depends, divided by their lengths, shape (d, k), if there are many
        normal scores.
    learnt_at
        Number of runs when the lengths and the amplitude were last learnt.
    """

    z: Array
    happened: Flags
    score: Array
    wide_draws: Array = field(default_factory=lambda: np.empty((0, 3)))
    estimates: list[BatchEstimate] = field(default_factory=list)
    batches: list[TwoPhaseBatch] = field(default_factory=list)
    foreseen: Array = field(default_factory=lambda: np.empty((0, 2)))
    repeats: Repeats = field(default_factory=Repeats.none)
    chance: bool = False
    chance_since: int = 0
    pending: Batch | None = None
    centres: Array | None = None
    searched: float = 0.0
    rarest: float = REACH
    directions: Array | None = None
    learnt_at: int = 0

    @classmethod
    def start(cls, dimension: int) -> Self:
        """Return the progress of a sampler without any run."""
        return cls(np.empty((0, dimension)), np.empty(0, bool), np.empty(0))
