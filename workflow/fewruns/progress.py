"""The progress of a sampler: its runs so far, the requested batch, and what was derived from the runs."""

from dataclasses import dataclass, field
from typing import Self

import numpy as np
from fewruns.arrays import Array, Flags
from fewruns.combining import BatchEstimate
from fewruns.constants import REACH
from fewruns.law_draws import LawBatch, LawDraws
from fewruns.repeats import RepeatBatch, Repeats
from fewruns.two_phase import TwoPhaseBatch


@dataclass(frozen=True)
class WideBatch:
    """A batch of n runs drawn from the wide distribution; ``z`` are their normal scores, shape (n, d)."""

    z: Array


@dataclass(frozen=True)
class ApproachBatch:
    """A batch of n runs of the search for the event; ``z`` are their normal scores, shape (n, d)."""

    z: Array


Batch = WideBatch | ApproachBatch | TwoPhaseBatch | RepeatBatch | LawBatch


@dataclass
class Progress:
    """The runs of a sampler so far, and the quantities derived from them.

    Attributes
    ----------
    z, happened, score
        Normal scores of all runs, shape (n, d), whether the event happened, and their scores, shape (n,).
    law_draws
        Draws of the law itself, which are not counted among the runs.
    wide_draws
        Draws from the wide distribution to which the runs are equivalent, in k groups: number of draws,
        smallest and largest rarity, shape (k, 3).
    estimates
        The estimates of all batches of the second phase.
    batches
        The batches of the second phase whose outcomes are known. They are kept so that their estimates can
        be reweighted for another law. The last batch belongs to the last of the ``estimates``; there may be
        fewer batches than estimates, because earlier versions of the sampler did not keep them.
    foreseen
        Uncalibrated predictions of the two surrogates for the last m runs, which are all runs of the second
        phase, before they were made, shape (m, 2).
    repeats
        Repetitions of runs, which are not counted among the runs.
    chance, chance_since
        Whether an outcome may be random; and how many estimates there were when the verdict whether most
        outcomes are random last changed. These first estimates are no longer used.
    pending
        The batch that was requested and whose outcomes have not been received.
    centres
        Centres of the next pool, shape (k, d); None before the first pool.
    searched
        Number of runs of the search per unit of rarity, up to the rarity ``rarest`` + `BEYOND`.
    rarest
        Rarity of the event with the smallest rarity that the search has found.
    directions
        Directions on which the event depends, divided by their lengths, shape (d, k), if there are many
        normal scores.
    learnt_at
        Number of runs when the parameters of the surrogates were last learnt.
    """

    z: Array
    happened: Flags
    score: Array
    law_draws: LawDraws
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
        """Return the progress of a sampler without any run, in ``dimension`` normal scores."""
        nothing = np.empty((0, dimension)), np.empty(0, bool), np.empty(0)
        return cls(*nothing, LawDraws.none(dimension))
