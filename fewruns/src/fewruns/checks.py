"""The checks of a system for random outcomes: repetitions of runs, and draws of the law itself."""

from dataclasses import dataclass

import numpy as np

from fewruns.arrays import Generator
from fewruns.constants import (
    DRIFT_LAG,
    DRIFT_PAIRS,
    ENOUGH_BATCHES,
    ENOUGH_UNEXPECTED,
    ENOUGH_UNLEARNT,
    FIRST_REPEATS,
)
from fewruns.progress import LAW, PlainBatch, Progress
from fewruns.repeats import RepeatBatch, choose_repeats, where_lapses_matter


@dataclass(frozen=True)
class Checks:
    """The checks that are required, and those that are due after the runs so far."""

    progress: Progress
    deterministic: bool | None  # as stated by the user, like the two numbers
    enough_repeats: int
    enough_draws: int

    @property
    def missing(self) -> int:
        """Number of repetitions and draws that are still required for convergence."""
        return self.repeats_wanted(certify=True) + self._draws_wanted

    def repeats_wanted(self, *, certify: bool) -> int:
        """Return how many repetitions are still required; ``certify`` adds those for convergence."""
        repeats = self.progress.repeats
        if self.deterministic is True:
            return 0
        if repeats.vary_often:
            first = max(FIRST_REPEATS + DRIFT_PAIRS - len(repeats), 0)
            return first or repeats.pairs_wanted(self._late_repeats(certify=certify))
        if self.progress.chance and self.deterministic is None and len(repeats):
            return 0
        wanted = self.enough_repeats if certify and not self.progress.chance else FIRST_REPEATS
        return max(wanted - len(repeats), 0)

    def repeats(self, most: int, *, certify: bool) -> RepeatBatch | None:
        """Choose up to ``most`` runs to repeat; return None if no repetition is required now."""
        progress = self.progress
        if not (count := min(self.repeats_wanted(certify=certify), most)):
            return None
        expected = np.zeros(len(progress.z), bool)
        expected[len(progress.z) - len(progress.foreseen) :] = progress.foreseen.max(axis=1, initial=0) > 0.5
        known = progress.z, progress.happened, progress.score, progress.repeats
        is_late = progress.is_noisy and len(progress.repeats) >= FIRST_REPEATS + DRIFT_PAIRS
        rounds = self._late_repeats(certify=certify) if is_late else 0
        frequent = where_lapses_matter(progress.z, progress.mean, max(self.enough_repeats, 1))
        return choose_repeats(*known, count, expected, frequent, rounds=rounds)

    def draws(self, most: int, generator: Generator, *, is_last: bool) -> PlainBatch | None:
        """Draw up to ``most`` points of the law itself; return None if no draws are due.

        They are due if the other checks are made (``is_last``), if surrogates do not learn the event, and for
        at least half of the runs of a system that may lapse.
        """
        progress = self.progress
        batches = max(ENOUGH_UNLEARNT // most, ENOUGH_BATCHES)
        is_due = len(progress.foreseen) >= batches * most and not progress.has_learnt(batches)
        if progress.may_lapse or self._draws_wanted:
            is_due |= is_last
            is_due |= sum(batch.surprising for batch in progress.estimates) >= ENOUGH_UNEXPECTED
        if progress.may_lapse:
            is_due |= 2 * len(progress.law_draws) < progress.simulations or progress.is_counted
            is_due &= self.deterministic is True or len(progress.repeats) > 0
        if not is_due:
            return None
        count = min(self._draws_wanted or most, most)
        return PlainBatch(generator.standard_normal((count, progress.z.shape[1])), LAW)

    def _late_repeats(self, *, certify: bool) -> int:
        """Return how often the runs that show a drift should have been repeated after the early repeats."""
        runs = self.progress.repeats.repeated[: FIRST_REPEATS + DRIFT_PAIRS]
        return int(certify) + (len(self.progress.z) > DRIFT_LAG * (runs.max() + 1))

    @property
    def _draws_wanted(self) -> int:
        """Number of draws of the law that are still required before an estimate can have converged."""
        if self.deterministic is not None or self.progress.chance:
            return 0
        return max(self.enough_draws - len(self.progress.law_draws), 0)
