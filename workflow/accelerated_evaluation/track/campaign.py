"""A campaign on the proving ground: asks for real runs, is told how they ended, and says what follows.

The sampler of few simulations (`methods.surrogate`) chooses the runs batch by batch. Real runs come back one
by one, in any order and over weeks, so a campaign keeps what was told of a batch until the batch is whole,
and only then hands it to the sampler.

A proving ground cannot drive every cut-in. Where a campaign has limits, its event is the event within them.
A run that the sampler chooses beyond them needs no driving: no event within the limits happens there.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Self

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.laws import Law
from accelerated_evaluation.laws.files import read_law
from accelerated_evaluation.methods.estimate import Estimate, Stopping
from accelerated_evaluation.methods.surrogate.gaussian_process import Predecessor
from accelerated_evaluation.methods.surrogate.sampler import Sampler
from accelerated_evaluation.records.encounter_table import read_encounters
from accelerated_evaluation.track.driven import BEYOND, DrivenOutcome, outcome_in_words, outcomes_of
from accelerated_evaluation.track.limits import UNLIMITED, Limits, require_limits
from accelerated_evaluation.track.scenarios import Scenario
from accelerated_evaluation.vehicles.events import Event

SMALLEST_BATCH, LARGEST_BATCH = 2, 500
MOST_EMPTY = 100  # batches in a row without a run within the limits


@dataclass
class Run:
    """A run that was asked for: number and batch, counted from 1, the cut-in, and its outcome.

    Attributes
    ----------
    lead_speed, range_, closing_speed
        v_L [m/s], range at the start [m] and host speed minus v_L at the start [m/s].
    """

    number: int
    batch: int
    lead_speed: float
    range_: float
    closing_speed: float
    outcome: DrivenOutcome | None = None

    @property
    def scenario(self) -> Scenario:
        """The run as a scenario."""
        cut_in = self.lead_speed, self.range_, self.closing_speed
        return Scenario(f"run_{self.number:04d}", *cut_in, notes={"batch": str(self.batch)})


@dataclass(frozen=True)
class Source:
    """A file that a campaign belongs to, with the checksum of its content."""

    file: str
    sha256: str


@dataclass
class Campaign:
    """All that a campaign knows.

    Attributes
    ----------
    law, encounters
        The law file and the encounter table from which it takes the lead speeds.
    description
        What the law says of itself.
    event
        What must not happen.
    goal
        How narrow the interval has to be.
    sampler
        Chooses the runs.
    limits, beyond
        What can be driven, and the probability of a cut-in beyond.
    runs
        All that the sampler chose, by their numbers; those beyond the limits are told from the start.
    """

    law: Source
    encounters: Source
    description: str
    event: Event
    goal: Stopping
    sampler: Sampler
    limits: Limits = UNLIMITED
    beyond: float = 0.0
    runs: list[Run] = field(default_factory=list)

    @classmethod
    def begin(
        cls,
        law: Source,
        encounters: Source,
        event: Event,
        goal: Stopping,
        *,
        batch_size: int,
        seed: int,
        limits: Limits = UNLIMITED,
        predecessor: "Campaign | None" = None,
        deterministic: bool | None = None,
    ) -> Self:
        """Return a new campaign; its law is read once, to see that it can be used.

        Parameters
        ----------
        law, encounters
            Files with their checksums.
        event, goal
            What must not happen, and how narrow the interval has to be.
        batch_size, seed
            Runs asked for at once, and root of all randomness.
        limits
            What can be driven.
        predecessor
            Campaign of a vehicle that is like this one; where it met the event, this one begins.
        deterministic
            Whether the vehicle always does the same in the same cut-in; None if repeats have to show it.

        Raises
        ------
        InputError
            If a file cannot be used, the batch size is out of its range, the limits leave too little, or the
            predecessor belongs to another law or event, or met no event.
        """
        check_batch_size(batch_size)
        read = read_law(law.file, read_encounters(encounters.file))
        beyond = require_limits(limits, read)
        fingerprint = f"{event.quantity} {event.threshold!r} under the law {law.sha256}"
        if limits:
            fingerprint += f", within {limits!r}"
        sampler = Sampler(
            3,
            child_generator(seed, "campaign"),
            batch_size,
            fingerprint=fingerprint,
            predecessor=None if predecessor is None else predecessor.as_predecessor(law, event),
            deterministic=deterministic,
        )
        return cls(law, encounters, read.description, event, goal, sampler, limits, beyond)

    # ---- runs

    @property
    def outstanding(self) -> list[Run]:
        """The runs that were asked for and not told yet."""
        return [run for run in self.runs if run.outcome is None]

    def ask(self, law: Law, batch_size: int | None = None) -> list[Run]:
        """Return the runs to drive next: what is outstanding, or else a new batch.

        Parameters
        ----------
        law
            That the campaign belongs to.
        batch_size
            Of a new batch and all that follow; None for no change. An outstanding batch keeps its size,
            because what its runs say has been weighed for it.
        """
        if batch_size is not None:
            check_batch_size(batch_size)
            # The derivation of the sampler holds for batches of any sizes that were chosen beforehand.
            self.sampler = Sampler.resume(replace(self.sampler.state(), batch_size=batch_size))
        for _ in range(MOST_EMPTY):
            if self.outstanding:
                return self.outstanding
            self._choose(law)
        raise InputError(
            "the limits of the campaign",
            seen=f"no run within {self.limits.in_words} in {MOST_EMPTY} batches",
            expected="limits within which the event can happen",
            change="Begin another campaign with wider limits.",
        )

    def _choose(self, law: Law) -> None:
        """Let the sampler choose a batch; what lies beyond the limits is known to be no event within them."""
        cut_ins = law.from_normal_scores(self.sampler.ask(certify=self.sampler.is_narrow(self.goal)))
        columns = cut_ins.lead_speed, cut_ins.range_, law.capped(cut_ins.closing_speed)
        within = self.limits.hold(*columns).tolist()
        first, batch = len(self.runs) + 1, self.batches + 1
        cut_ins_of_runs = zip(*(column.tolist() for column in columns), strict=True)
        self.runs += [
            Run(first + place, batch, *cut_in, None if within[place] else BEYOND)
            for place, cut_in in enumerate(cut_ins_of_runs)
        ]
        self._hand_over()

    @property
    def batches(self) -> int:
        """Number of batches that were asked for."""
        return self.runs[-1].batch if self.runs else 0

    def tell(self, results: Mapping[int, DrivenOutcome], *, correct: bool = False) -> int:
        """Take what happened in some runs, and hand the batch to the sampler once it is whole.

        Parameters
        ----------
        results
            By number of run; checked against the runs by `results.check`.
        correct
            Whether what was told before of a run of the open batch may be replaced.

        Returns
        -------
        int
            How many runs were new or corrected.

        Raises
        ------
        InputError
            If a run contradicts what was told of it before; nothing is taken then.
        """
        news = {
            number: outcome for number, outcome in results.items() if self.runs[number - 1].outcome != outcome
        }
        for number in news:
            self._require_open(number, correct=correct)
        for number, outcome in news.items():
            self.runs[number - 1].outcome = outcome
        if news:
            self._hand_over()
        return len(news)

    def _hand_over(self) -> None:
        """Tell the sampler of the open batch, once all its runs are told."""
        if not self.outstanding:
            outcomes = outcomes_of(run.outcome for run in self.runs if run.batch == self.batches)
            self.sampler.tell(self.event.happens(outcomes), self.event.score(outcomes))

    def _require_open(self, number: int, *, correct: bool) -> None:
        """Refuse to change what is known of a run, unless it is being corrected before it was used."""
        run = self.runs[number - 1]
        if run.outcome is None:
            return
        is_used = run.batch < self.batches or not self.outstanding
        change = "Restore the copy of the campaign's file from before, and tell all runs since then again."
        if not is_used:
            change = "Correct the table, or add --correct if what was told before was wrong."
        if is_used or not correct:
            raise InputError(
                f"run {number}",
                seen="another outcome than was told before",
                expected=f"{outcome_in_words(run.outcome)}, as told before",
                change=change,
            )

    def as_predecessor(self, law: Source, event: Event) -> Predecessor:
        """Return the runs of whole batches, for a campaign with a vehicle that is like this one."""
        change = "Name a campaign with the same law and event, or leave --predecessor out."
        own, other = (self.law.sha256, law.sha256), (self.event.in_words, event.in_words)
        for what, (seen, expected) in (("law", own), ("event", other)):
            if seen != expected:
                where = f"--predecessor, its {what}"
                raise InputError(where, seen=seen, expected=expected, change=change)
        progress = self.sampler.progress
        if not progress.happened.any():
            seen = f"no event in {len(progress.z)} runs of whole batches"
            raise InputError("--predecessor", seen=seen, expected="at least one", change=change)
        return Predecessor(progress.z, progress.happened)

    # ---- what follows

    def estimate(self) -> Estimate:
        """Return what all whole batches say."""
        return self.sampler.estimate(self.goal)


def check_batch_size(size: int) -> None:
    """Raise InputError unless a batch of this size can be asked for."""
    if not SMALLEST_BATCH <= size <= LARGEST_BATCH:
        expected = f"{SMALLEST_BATCH} to {LARGEST_BATCH} runs"
        raise InputError("--batch-size", seen=str(size), expected=expected, change="Choose another size.")
