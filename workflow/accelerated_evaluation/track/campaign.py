"""A campaign on the proving ground: asks for real runs, is told how they ended, and says what follows.

The sampler of few simulations (`methods.surrogate`) chooses the runs batch by batch. Real runs come back one
by one, in any order and over weeks, so a campaign keeps what was told of a batch until the batch is whole,
and only then hands it to the sampler.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np

from accelerated_evaluation.encounters.contract import read_encounters
from accelerated_evaluation.errors import InputError
from accelerated_evaluation.laws import Law
from accelerated_evaluation.laws.files import read_law
from accelerated_evaluation.methods.estimate import Estimate, Stopping
from accelerated_evaluation.methods.surrogate.sampler import Sampler
from accelerated_evaluation.randomness import child_generator
from accelerated_evaluation.track.scenarios import Scenario
from accelerated_evaluation.vehicles.events import Event
from accelerated_evaluation.vehicles.protocol import Outcomes

SMALLEST_BATCH, LARGEST_BATCH = 2, 500


@dataclass(frozen=True)
class Told:
    """What is known of a run that was driven.

    Attributes
    ----------
    crash
        Whether the cars touched.
    min_range, min_ttc, impact_speed
        Smallest range [m], smallest time to collision [s] and closing speed at the crash [m/s]; None where it
        was not measured.
    note
        Anything that the people on the track want to remember.
    """

    crash: bool
    min_range: float | None = None
    min_ttc: float | None = None
    impact_speed: float | None = None
    note: str = ""


@dataclass
class Run:
    """A run that was asked for: number and batch, counted from 1, the cut-in, and what was told of it.

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
    told: Told | None = None

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
    runs
        All that were asked for, by their numbers.
    """

    law: Source
    encounters: Source
    description: str
    event: Event
    goal: Stopping
    sampler: Sampler
    runs: list[Run] = field(default_factory=list)

    @classmethod
    def begin(
        cls, law: Source, encounters: Source, event: Event, goal: Stopping, *, batch_size: int, seed: int
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

        Raises
        ------
        InputError
            If a file cannot be used, or the batch size is out of its range.
        """
        check_batch_size(batch_size)
        description = read_law(law.file, read_encounters(encounters.file)).description
        fingerprint = f"{event.quantity} {event.threshold!r} under the law {law.sha256}"
        sampler = Sampler(3, child_generator(seed, "campaign"), batch_size, fingerprint=fingerprint)
        return cls(law, encounters, description, event, goal, sampler)

    # ---- runs

    @property
    def outstanding(self) -> list[Run]:
        """The runs that were asked for and not told yet."""
        return [run for run in self.runs if run.told is None]

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
        if not self.outstanding:
            cut_ins = law.from_scores(self.sampler.ask(certify=self.sampler.is_narrow(self.goal)))
            closing_speed = law.capped(cut_ins.closing_speed)
            columns = (cut_ins.lead_speed.tolist(), cut_ins.range_.tolist(), closing_speed.tolist())
            first, batch = len(self.runs) + 1, self.batches + 1
            self.runs += [
                Run(first + place, batch, *cut_in) for place, cut_in in enumerate(zip(*columns, strict=True))
            ]
        return self.outstanding

    @property
    def batches(self) -> int:
        """Number of batches that were asked for."""
        return self.runs[-1].batch if self.runs else 0

    def tell(self, results: Mapping[int, Told], *, correct: bool = False) -> int:
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
        news = {number: told for number, told in results.items() if self.runs[number - 1].told != told}
        for number in news:
            self._require_open(number, correct=correct)
        open_batch = [run for run in self.runs if run.batch == self.batches]
        for number, told in news.items():
            self.runs[number - 1].told = told
        if news and not self.outstanding:
            outcomes = outcomes_of(run.told for run in open_batch)
            self.sampler.tell(self.event.happens(outcomes), self.event.score(outcomes))
        return len(news)

    def _require_open(self, number: int, *, correct: bool) -> None:
        """Refuse to change what is known of a run, unless it is being corrected before it was used."""
        run = self.runs[number - 1]
        if run.told is None:
            return
        is_used = run.batch < self.batches or not self.outstanding
        change = "Restore the copy of the campaign's file from before, and tell all runs since then again."
        if not is_used:
            change = "Correct the table, or add --correct if what was told before was wrong."
        if is_used or not correct:
            raise InputError(
                f"run {number}",
                seen="another outcome than was told before",
                expected=f"{told_in_words(run.told)}, as told before",
                change=change,
            )

    # ---- what follows

    def estimate(self) -> Estimate:
        """Return what all whole batches say."""
        return self.sampler.estimate(self.goal)


def check_batch_size(size: int) -> None:
    """Raise InputError unless a batch of this size can be asked for."""
    if not SMALLEST_BATCH <= size <= LARGEST_BATCH:
        expected = f"{SMALLEST_BATCH} to {LARGEST_BATCH} runs"
        raise InputError("--batch-size", seen=str(size), expected=expected, change="Choose another size.")


def outcomes_of(told: Iterable[Told]) -> Outcomes:
    """Return what was told of runs as outcomes; what was not measured is as harmless as the flag allows."""
    rows = list(told)
    crash = np.array([row.crash for row in rows])

    def column(name: str, unknown: Any) -> np.ndarray:  # noqa: ANN401
        values = [getattr(row, name) for row in rows]
        return np.where([value is None for value in values], unknown, np.array(values, dtype=float))

    return Outcomes(
        crash,
        column("min_range", np.where(crash, 0.0, np.inf)),
        column("min_ttc", np.where(crash, 0.0, np.inf)),
        column("impact_speed", 0.0),
    )


def told_in_words(told: Told) -> str:
    """Return the outcome of a run for a message."""
    words = ["crash" if told.crash else "no crash"]
    for name in ("min_range", "min_ttc", "impact_speed"):
        if getattr(told, name) is not None:
            words.append(f"{name} {getattr(told, name):g}")
    return ", ".join(words)
