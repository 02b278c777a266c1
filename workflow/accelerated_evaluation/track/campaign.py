"""A campaign on the proving ground: it requests real runs, receives their outcomes, and gives an estimate.

The surrogate-guided sampler (`methods.surrogate`) chooses the runs batch by batch. The outcomes of real runs
arrive one by one, in any order and over weeks. A campaign therefore collects the outcomes of a batch, and
passes them to the sampler when the batch is complete.

Not every cut-in can be driven on a proving ground. If a campaign has limits, it estimates the probability
that a cut-in is within the limits and ends in the event. A run that the sampler chooses beyond the limits
need not be driven, because it is certainly not an event within the limits.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Self

from fewruns.constants import ENOUGH_REPEATS
from fewruns.problems import Predecessor
from fewruns.sampler import Sampler

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.laws import Law
from accelerated_evaluation.methods import Estimate, Stopping, study_errors
from accelerated_evaluation.methods.surrogate import rules_for
from accelerated_evaluation.scenarios.events import Event
from accelerated_evaluation.scenarios.protocol import Scenario
from accelerated_evaluation.track.driven import BEYOND, DrivenOutcome, outcome_in_words, outcomes_of
from accelerated_evaluation.track.law_files import InputFile, law_in
from accelerated_evaluation.track.limits import UNLIMITED, Limits, require_limits
from accelerated_evaluation.track.scenarios import ConcreteScenario

SMALLEST_BATCH, LARGEST_BATCH = 2, 500  # numbers of runs
MOST_EMPTY = 100  # largest number of consecutive batches without a run within the limits


@dataclass
class Run:
    """A run that the sampler has requested."""

    number: int  # counted from 1
    batch: int  # number of the batch, counted from 1
    encounter: tuple[float, ...]  # values of the variables of the scenario, in their order
    outcome: DrivenOutcome | None = None  # None if it has not been reported yet

    @property
    def concrete(self) -> ConcreteScenario:
        """The run as a scenario that can be written as an OpenSCENARIO file; it has to be a cut-in."""
        return ConcreteScenario(f"run_{self.number:04d}", *self.encounter, notes={"batch": str(self.batch)})


@dataclass
class Campaign:
    """The complete state of a campaign."""

    law: InputFile
    encounters: InputFile | None  # table to which the law was fitted; None for a joint law
    description: str  # of the law
    event: Event
    goal: Stopping  # the stopping rule, which contains the required width of the interval.
    sampler: Sampler
    limits: Limits = UNLIMITED
    beyond: float = 0.0  # probability of a cut-in beyond the limits
    # All runs that the sampler has chosen, in the order of their numbers. A run beyond the limits has the
    # outcome `BEYOND`.
    runs: list[Run] = field(default_factory=list)
    scenario: Scenario = field(kw_only=True)

    @classmethod
    @study_errors()
    def begin(
        cls,
        law: InputFile,
        encounters: InputFile | None,
        event: Event,
        goal: Stopping,
        *,
        batch_size: int,
        seed: int,
        limits: Limits = UNLIMITED,
        predecessor: "Campaign | None" = None,
        deterministic: bool | None = None,
        scenario: Scenario,
    ) -> Self:
        """Begin a new campaign.

        The law is read once, to check that it can be used. ``encounters`` is the table to which the law was
        fitted, None for a joint law. Encounters in which the event happened in the campaign of a similar
        vehicle, the predecessor, are requested first. If it is not known whether the vehicle is
        ``deterministic``, some runs have to be repeated. InputError is raised if a file cannot be used, if
        the batch size is out of range, if too few cut-ins are within the limits, or if the predecessor
        belongs to another law or event, or has no event.
        """
        check_batch_size(batch_size)
        read = law_in(scenario, law, encounters)
        beyond = require_limits(limits, read)
        fingerprint = f"{event.quantity} {event.threshold!r} under the law {law.sha256}"
        if limits:
            fingerprint += f", within {limits!r}"
        sampler = Sampler(
            scenario.dimension,
            child_generator(seed, "campaign"),
            batch_size,
            fingerprint=fingerprint,
            predecessor=None if predecessor is None else predecessor.as_predecessor(law, event),
            deterministic=deterministic,
            enough_repeats=ENOUGH_REPEATS,
            **rules_for(scenario, event),
        )
        return cls(law, encounters, read.description, event, goal, sampler, limits, beyond, scenario=scenario)

    # ---- runs

    @property
    def outstanding(self) -> list[Run]:
        """The requested runs whose outcomes have not been reported yet."""
        return [run for run in self.runs if run.outcome is None]

    def ask(self, law: Law, batch_size: int | None = None) -> list[Run]:
        """Return the runs to drive next: the outstanding runs, or a new batch if there are none.

        A batch size holds for the new batch and all later ones. It does not change an outstanding batch,
        because the inclusion probabilities of its runs depend on its size. InputError is raised if it is out
        of range, or if `MOST_EMPTY` batches had no run within the limits.
        """
        if batch_size is not None:
            check_batch_size(batch_size)
            # Batches may have different sizes, if each size is chosen before the batch is drawn.
            self.sampler.batch_size = batch_size
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
        """Let the sampler choose a batch; runs beyond the limits get their outcome without being driven.

        The requested runs are rounded to what can be set in a real run. The campaign therefore estimates the
        probability for the vehicle under rounded encounters.
        """
        x = law.from_normal_scores(self.sampler.ask(certify=self.sampler.is_narrow(self.goal)))
        encounters = self.scenario.settable(x)
        within = self.limits.hold(*encounters.T) if self.limits else [True] * len(encounters)
        first, batch = len(self.runs) + 1, self.batches + 1
        self.runs += [
            Run(first + place, batch, tuple(encounter), None if within[place] else BEYOND)
            for place, encounter in enumerate(encounters.tolist())
        ]
        self._hand_over()

    @property
    def batches(self) -> int:
        """Number of batches that have been requested."""
        return self.runs[-1].batch if self.runs else 0

    def tell(self, results: Mapping[int, DrivenOutcome], *, correct: bool = False) -> int:
        """Receive outcomes by the number of the run, and pass the batch to the sampler when it is complete.

        Return how many are new or corrected. With ``correct`` they may replace earlier reports of runs in the
        open batch. InputError is raised if an outcome contradicts an earlier report that may not be replaced.
        No outcome is then accepted.
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
        """Pass the outcomes of the open batch to the sampler if all of them have been reported."""
        if not self.outstanding:
            driven = (run.outcome for run in self.runs if run.batch == self.batches)
            outcomes = outcomes_of(driven, self.scenario)
            self.sampler.tell(self.event.happens(outcomes), self.event.score(outcomes))

    def _require_open(self, number: int, *, correct: bool) -> None:
        """Raise InputError if the run has an outcome, unless it may be corrected and was not used yet."""
        run = self.runs[number - 1]
        if run.outcome is None:
            return
        is_used = run.batch < self.batches or not self.outstanding
        change = "Restore an earlier copy of the campaign's file, and report all later runs again."
        if not is_used:
            change = "Correct the table, or add --correct if the earlier report was wrong."
        if is_used or not correct:
            raise InputError(
                f"run {number}",
                seen="an outcome that differs from the earlier report",
                expected=f"{outcome_in_words(run.outcome)}, as reported earlier",
                change=change,
            )

    def as_predecessor(self, law: InputFile, event: Event) -> Predecessor:
        """Return the runs of the complete batches, to guide the campaign of a similar vehicle.

        InputError is raised if this campaign has another law or event, or if the event did not happen in its
        complete batches.
        """
        change = "Name a campaign with the same law and event, or leave --predecessor out."
        own, other = (
            (self.law.sha256, law.sha256),
            (self.scenario.event_in_words(self.event), self.scenario.event_in_words(event)),
        )
        for what, (seen, expected) in (("law", own), ("event", other)):
            if seen != expected:
                where = f"--predecessor, its {what}"
                raise InputError(where, seen=seen, expected=expected, change=change)
        progress = self.sampler.progress
        if not progress.happened.any():
            seen = f"no event in {len(progress.z)} runs of complete batches"
            raise InputError("--predecessor", seen=seen, expected="at least one event", change=change)
        return Predecessor(progress.z, progress.happened)

    # ---- what follows

    def estimate(self) -> Estimate:
        """Return the estimated probability of the event, with its interval, from all complete batches."""
        return self.sampler.estimate(self.goal)


def check_batch_size(size: int) -> None:
    """Raise InputError unless the size of a batch is from `SMALLEST_BATCH` to `LARGEST_BATCH`."""
    if not SMALLEST_BATCH <= size <= LARGEST_BATCH:
        expected = f"{SMALLEST_BATCH} to {LARGEST_BATCH} runs"
        raise InputError("--batch-size", seen=str(size), expected=expected, change="Choose another size.")
