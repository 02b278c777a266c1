"""The progress of a sampler: its runs so far, the requested batch, what was derived, and draws of the law."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import takewhile
from typing import Annotated, Self, get_args, get_type_hints

import numpy as np
from scipy.special import bdtrc, betaincinv

from fewruns.arrays import Array, Flags, Indices
from fewruns.combining import BatchEstimate, beginnings, combine, consistent_batches
from fewruns.constants import AGREEMENT, CONTRADICTION, NOISY_USABLE, REACH, RELEARN, UNSEEN_ALPHA, USABLE
from fewruns.repeats import RepeatBatch, Repeats
from fewruns.two_phase import TwoPhaseBatch

# Phases of batches without an estimate: draws of the wide distribution, the search, draws of the law as runs
# of the search, and draws of the law that are no runs.
WIDE, SEARCH, PLAIN, LAW = "wide", "search", "plain", "law"


@dataclass(frozen=True)
class LawDraws:
    """Outcomes of the draws of the law so far."""

    z: Annotated[Array, "draws", "dimension"]
    happened: Annotated[Flags, "draws"]

    def __len__(self) -> int:
        """Return the number of draws."""
        return len(self.happened)

    @property
    def events(self) -> int:
        """Number of draws that ended in the event."""
        return int(np.count_nonzero(self.happened))

    @property
    def share(self) -> float:
        """Share of the draws that ended in the event."""
        return self.events / len(self)

    def extended(self, z: Array, happened: Flags) -> "LawDraws":
        """Return these draws, followed by further ones, shape (n, d), and their flags, shape (n,)."""
        return LawDraws(np.vstack([self.z, z]), np.append(self.happened, happened))

    def interval(self, alpha: float) -> tuple[float, float]:
        """Return the ends of the interval of Clopper and Pearson for P(event), of level 100 (1 - alpha) %."""
        events, others = self.events, len(self) - self.events
        low = float(betaincinv(events, others + 1, alpha / 2)) if events else 0.0
        return low, float(betaincinv(events + 1, others, 1 - alpha / 2)) if others else 1.0

    def contradict(self, probability: float) -> bool:
        """Return whether the events are improbable even if the estimate is too low by `AGREEMENT`."""
        events, allowed = self.events, min(AGREEMENT * probability, 1.0)
        return events > 0 and bool(bdtrc(events - 1, len(self), allowed) < CONTRADICTION)


@dataclass(frozen=True)
class PlainBatch:
    """A batch of n runs without an estimate: wide draws, a part of the search, or draws of the law itself."""

    z: Annotated[Array, "batch", "dimension"]  # normal scores
    phase: str


Batch = PlainBatch | RepeatBatch | TwoPhaseBatch


def without_failed(batch: Batch, failed: Flags) -> Batch:
    """Return a batch without its failed runs."""
    hints = get_type_hints(type(batch), include_extras=True)
    own = [name for name, hint in hints.items() if get_args(hint)[1:2] == ("batch",)]
    return replace(batch, **{name: getattr(batch, name)[~failed] for name in own}) if failed.any() else batch


@dataclass
class Asked:
    """A batch of n runs that was requested, with the outcomes that have been received."""

    batch: Batch
    first: int  # number of its first run
    issued: int  # number of its runs that `Sampler.ask` has returned
    told: Annotated[Flags, "batch"]  # whether the outcome of a run has been received
    happened: Annotated[Flags, "batch"]
    score: Annotated[Array, "batch"]
    failed: Annotated[Flags, "batch"]  # whether a run has no outcome

    @classmethod
    def start(cls, batch: Batch, first: int) -> Self:
        """Return a batch none of whose runs has been returned."""
        n = len(batch.z)
        return cls(batch, first, 0, np.zeros(n, bool), np.zeros(n, bool), np.zeros(n), np.zeros(n, bool))

    @property
    def outstanding(self) -> Indices:
        """Numbers of the runs that were returned, and whose outcomes have not been received."""
        return self.first + np.flatnonzero(~self.told[: self.issued])


@dataclass
class Progress:
    """The runs of a sampler so far, and the quantities derived from them."""

    # Normal scores of all runs, whether the event happened, and their scores. Repetitions of runs and draws
    # of the law itself are not among them.
    z: Annotated[Array, "runs", "dimension"]
    happened: Annotated[Flags, "runs"]
    score: Annotated[Array, "runs"]
    law_draws: LawDraws
    plain: LawDraws  # the runs that the search has drawn from the law itself
    failed: Annotated[Array, "failed", "dimension"]  # runs of all kinds without an outcome
    failed_draws: int = 0  # how many of these are draws of the law
    # Draws from the wide distribution to which the runs are equivalent: number, smallest and largest rarity.
    wide_draws: Annotated[Array, "groups", 3] = field(default_factory=lambda: np.empty((0, 3)))
    # The batches of the second phase, and their estimates. The last batch belongs to the last estimate. There
    # are fewer batches than estimates if the sampler was rebuilt after an upgrade.
    estimates: list[BatchEstimate] = field(default_factory=list)
    batches: list[TwoPhaseBatch] = field(default_factory=list)
    # Uncalibrated predictions of the two surrogates for the runs of the second phase before they were made,
    # which are the last runs.
    foreseen: Annotated[Array, "foreseen", 2] = field(default_factory=lambda: np.empty((0, 2)))
    repeats: Repeats = field(default_factory=Repeats.none)
    chance: bool = False  # whether an outcome may be random
    # Number of estimates when the verdict whether most outcomes are random last changed; they are not used.
    chance_since: int = 0
    # Numbers of runs of the batches.
    sizes: Annotated[Indices, "sizes"] = field(default_factory=lambda: np.empty(0, np.int64))
    narrow_at: int | None = None  # number of runs when the interval last became narrow; None if it is not
    # The requested batches that are not complete, in their order. They become runs in this order.
    asked: list[Asked] = field(default_factory=list)
    centres: Annotated[Array, "centres", "dimension"] | None = None  # of the next pool
    searched: float = 0.0  # runs of the search per unit of rarity, up to the rarity ``rarest`` + `BEYOND`
    rarest: float = REACH  # smallest rarity of an event that the search has found
    # Directions on which the event depends, divided by their lengths, if there are many normal scores.
    directions: Annotated[Array, "dimension", "directions"] | None = None
    learnt_at: int = 0  # number of runs when the parameters of the surrogates were last learnt

    @classmethod
    def start(cls, dimension: int) -> Self:
        """Return the progress of a sampler without any run."""
        nothing = np.empty((0, dimension)), np.empty(0, bool)
        return cls(*nothing, np.empty(0), LawDraws(*nothing), LawDraws(*nothing), nothing[0])

    @property
    def simulations(self) -> int:
        """Number of all simulations, including repetitions of runs, draws of the law, and failed runs."""
        return len(self.z) + len(self.repeats) + len(self.law_draws) + len(self.failed)

    @property
    def pending(self) -> Batch | None:
        """The first of the requested batches that are not complete."""
        return self.asked[0].batch if self.asked else None

    @property
    def next_number(self) -> int:
        """Number of the next run, which is the number of all runs that were requested so far."""
        return self.asked[-1].first + len(self.asked[-1].batch.z) if self.asked else self.simulations

    @property
    def planned(self) -> "Progress":
        """The progress for the next batch, in which the checks that are pending have shown nothing."""
        repeats, draws = self.repeats, self.law_draws
        for batch in (asked.batch for asked in self.asked):
            none = np.zeros(len(batch.z), bool)
            if isinstance(batch, RepeatBatch):
                first = batch.repeated
                repeats = repeats.extended(batch, self.happened[first], none, self.score[first])
            elif isinstance(batch, PlainBatch) and batch.phase == LAW:
                draws = draws.extended(batch.z, none)
        return replace(self, repeats=repeats, law_draws=draws) if self.asked else self

    @property
    def unknown_runs(self) -> Array:
        """The failed runs, and the pending ones that are neither repetitions nor draws of the law, (n, d)."""
        batches = [asked.batch for asked in self.asked if not isinstance(asked.batch, RepeatBatch)]
        runs = [batch.z for batch in batches if getattr(batch, "phase", None) != LAW]
        return np.vstack([self.failed, *runs])

    @property
    def is_learnt_again(self) -> bool:
        """Whether there are so many new runs that the parameters of the surrogates are learnt again."""
        return not self.estimates or len(self.z) >= RELEARN * self.learnt_at

    @property
    def cover_runs(self) -> Indices:
        """The runs of the batches of a cover since the last batch that was sampled."""
        pairs = zip(reversed(self.estimates), reversed(self.batches), strict=False)
        covers = takewhile(lambda pair: not pair[0].runs, pairs)
        return np.arange(len(self.z) - sum(len(batch.z) for _, batch in covers), len(self.z))

    def without(self, left_out: Indices) -> "Progress":
        """Return the progress without some runs, for surrogates that are fitted to the others."""
        kept = np.setdiff1d(np.arange(len(self.z)), left_out)
        foreseen = kept[kept >= len(self.z) - len(self.foreseen)] - len(self.z)
        others = {name: getattr(self, name)[kept] for name in ("z", "happened", "score")}
        return replace(self, **others, foreseen=self.foreseen[foreseen])

    # ---- the batches of the estimate

    @property
    def consistent(self) -> Sequence[BatchEstimate]:
        """The last batches with consistent predictions, without those before noise was noticed."""
        return consistent_batches(self.estimates[self.chance_since :], self._usable)

    @property
    def sampled(self) -> Sequence[BatchEstimate]:
        """The batches on which the estimate is based: the consistent ones, except those of a cover alone."""
        return [batch for batch in self.consistent if batch.runs]

    @property
    def stored(self) -> list[tuple[BatchEstimate, TwoPhaseBatch]]:
        """The consistent batches whose runs are stored, with their estimates."""
        return [*zip(reversed(self.consistent), reversed(self.batches), strict=False)][::-1]

    @property
    def mean(self) -> float:
        """The estimate from the batches on which it is based; 0 if there are none."""
        batches = self.sampled
        return combine(batches).probability if batches else 0.0

    def reaches_prediction(self, factor: float) -> bool:
        """Return whether the estimate is more than the last predicted probability divided by ``factor``.

        If not, the surrogate has learnt of a part of the event that most batches of the estimate missed.
        """
        return self.mean > self.estimates[-1].prediction.probability / factor

    def has_learnt(self, batches: int) -> bool:
        """Return whether there was an estimate after any of the last ``batches`` batches."""
        begun = [*beginnings(self.estimates[self.chance_since :], self._usable)]
        return any(first is not None for first in begun[-batches:])

    @property
    def _usable(self) -> float:
        """The coefficient of variation of a run below which the surrogate is usable."""
        return NOISY_USABLE if self.is_noisy else USABLE

    # ---- random outcomes

    @property
    def is_noisy(self) -> bool:
        """Whether the outcomes of most runs are random."""
        return self.repeats.vary_often

    @property
    def may_lapse(self) -> bool:
        """Whether outcomes may be random in a few of the runs, which the runs may have missed."""
        return self.chance and not self.is_noisy

    @property
    def is_contradicted(self) -> bool:
        """Whether the draws of the law contain far more events than the present estimate allows."""
        return self.law_draws.contradict(self.mean)

    @property
    def is_counted(self) -> bool:
        """Whether the event of a system that may lapse is so frequent that the draws of the law show it.

        They then contain more events than the estimate from all other runs allows, and they count instead.
        """
        return self.may_lapse and self.is_contradicted

    @property
    def unseen_lapses(self) -> float:
        """A bound on the probability that lapses add; 0 if there are none, or if they are counted."""
        is_unseen = self.may_lapse and not self.is_counted
        return self.law_draws.interval(2 * UNSEEN_ALPHA)[1] if is_unseen else 0.0
