"""What runs that no sampler has chosen say about an estimate: repetitions elsewhere, replays of records."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd
from fewruns.constants import FEW
from fewruns.problems import Predecessor

from accelerated_evaluation.answer.candidates.fitted_records import FittedRecords
from accelerated_evaluation.answer.ways.answer import Answer, evaluate
from accelerated_evaluation.answer.ways.by_few_runs import FewRuns
from accelerated_evaluation.answer.ways.extrapolation import ALL
from accelerated_evaluation.answer.ways.posterior import answer_row
from accelerated_evaluation.answer.ways.replays import LEVEL, Replays, replay
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.draws import Draws
from accelerated_evaluation.methods.problem import Problem, normal_scores
from accelerated_evaluation.scenarios.events import Event
from accelerated_evaluation.scenarios.outcomes import of_known
from accelerated_evaluation.vehicles.external.slow import SlowVehicle
from accelerated_evaluation.vehicles.external.watched import WatchedVehicle
from accelerated_evaluation.vehicles.external.workers import difference_elsewhere

SHOWN = 3  # number of records with the event that a message names


def _rounded(count: float) -> str:
    """Write an expected number with two significant digits and no power of ten, such as 0.35 or 290."""
    return f"{float(f'{count:.2g}'):,g}"


@dataclass(frozen=True)
class Evidence:
    """Evidence for or against an estimate."""

    event: str  # the event in words
    upper: float  # largest probability that the estimate allows: the upper end of its widest interval
    replays: Replays
    difference: str | None  # how a run differs when it is repeated in another process; None if all agree
    crashed: pd.DataFrame = field(default_factory=pd.DataFrame)  # the replayed records with the event
    examples: Sequence[str] = ()  # the first of these records in words
    lower: float = 0.0  # smallest probability that the estimate allows

    @property
    def doubts(self) -> list[str]:
        """Reasons why the estimate cannot be trusted, in words."""
        return [text for text in (self.difference, self._contradiction()) if text is not None]

    @property
    def in_words(self) -> str:
        """The replays as a sentence."""
        replays, (count, total) = self.replays, self._counts()
        sampled, events = int(replays.sampled.sum()), int(replays.events.sum())
        shown = f"all {total:,}" if count == total else f"{sampled:,} of {total:,}"
        text = (
            f"replays: the vehicle replayed {shown} distinct records, and {events:,} ended with "
            f"{self.event}; the estimate allows at most {_rounded(replays.allowed(self.upper))} among them"
        )
        if count > sampled:
            text += (
                f". Of {count - sampled:,} records similar to these, {replays.happened - events:,} ended "
                f"with it, too; the estimate allows at most {_rounded(self.upper * total)} in all {total:,} "
                "records"
            )
        return text

    def unseen(self, probability: float) -> str | None:
        """Return in words how much the replays can have missed, compared with the estimated probability.

        The result is None if all records were replayed, so that nothing in them was missed.
        """
        count, total = self._counts()
        if count == total:
            return None
        share = self.replays.share_at_most
        known = np.isfinite(probability) and 0 < probability < share
        times = float(f"{share / probability:.2g}") if known else np.nan
        ratio = f", which is {times:,g} times the answer" if known else ""
        return (
            f"the replays could have missed {self.event} in a share of up to {share:.2g} of the records"
            f"{ratio}. Only {count:,} of {total:,} records were replayed; the answer assumes that the "
            "vehicle has no lapses that are too rare for them, by chance or at single values of its inputs"
        )

    def added_to(self, tables: Mapping[str, pd.DataFrame]) -> dict[str, pd.DataFrame]:
        """Return tables with those of the replays; doubts are added, and nothing has then converged.

        The table ``extrapolation`` receives the number of records with the event, or, if only a sample was
        replayed, the upper limit of their share.
        """
        found = {
            **tables,
            "replays": self.replays.table(self.upper, self.lower),
            "replayed_events": self.crashed,
        }
        if len(known := tables.get("extrapolation", ())):
            count, total = self._counts()
            name, value = ("recorded", self.replays.happened)
            if count < total:
                name, value = "replay_high95", self.replays.share_at_most
            found["extrapolation"] = known.assign(**{name: known["part"].map({ALL: value})})
        if not self.doubts:
            return found
        return {
            name: table.assign(converged=False, doubts=" ".join(self.doubts))
            if "converged" in table
            else table
            for name, table in found.items()
        }

    def _counts(self) -> tuple[int, int]:
        return self.replays.replayed, int(self.replays.records.sum())

    def _contradiction(self) -> str | None:
        p_value = self.replays.p_value(self.upper, self.lower)
        if p_value >= LEVEL:
            return None
        count, total = self._counts()
        if p_value < self.replays.p_value(self.upper):
            return (
                f"the records contradict the estimate (p = {p_value:.1g}, level {LEVEL:g}): {self.event} "
                f"in {self.replays.happened:,} of {count:,} replayed records; expected at least "
                f"{self.lower * total:.2g} in all {total:,} records. The estimate cannot be trusted: outcomes"
                " may depend on the other encounters of a batch, or the law does not describe the records. "
                "Simulate some encounters of runs.csv with the event one by one."
            )
        return (
            f"the records contradict the estimate (p = {p_value:.1g}, level {LEVEL:g}): {self.event} "
            f"in {self.replays.happened:,} of {count:,} replayed records; expected at most "
            f"{_rounded(self.upper * total)} in all {total:,} records. The estimate cannot be trusted: the "
            "sampler missed a part of the event, or the law does not describe the records. Simulate some of "
            f"these records again ({'; '.join(self.examples)}), and correct the vehicle if it should not "
            "have the event in them. The table replayed_events.csv contains all of them."
        )


def replays_of(
    vehicle: WatchedVehicle, records: Array, event: Event, generator: np.random.Generator
) -> Replays:
    """Replay records of shape (n, d); those near the event of the default vehicle come first.

    A run that fails counts as one without the event.
    """
    scenario, car = vehicle.scenario, vehicle.vehicle
    return replay(
        lambda points: of_known(event.happens, car.simulate(*points), False),
        records.T,
        event.score(scenario.known_vehicle().simulate(*records.T)),
        generator,
        is_slow=isinstance(car, SlowVehicle),
    )


def checked_answers(
    problem: Problem,
    draws: Draws,
    records: FittedRecords,
    way: FewRuns,
    events: Sequence[Event],
    streams: Callable[[str], np.random.Generator],
    replicates: int = 1,
) -> tuple[list[Answer], Evidence]:
    """Compute answers from few runs, and check them by replays of records and by runs in other processes.

    The replays guide the sampler, in addition to its predecessor. If there is evidence against the
    replicates, which are independent, none counts as converged.
    """
    watched = WatchedVehicle(problem.vehicle, problem.scenario)
    problem = replace(problem, vehicle=watched, law=draws.proposal)
    replays = replays_of(watched, records.x[draws.holds(records.x)], problem.event, streams("replays"))
    known = known_runs(replays, draws.proposal.from_normal_scores, way.predecessor)
    way = replace(way, predecessor=known)
    answers = [
        evaluate(problem, draws, way, events, generator=streams(f"replicate {number}"))
        for number in range(replicates)
    ]
    rows = [answer_row(each.posterior) for each in answers if each.posterior is not None]
    upper = min(max((row["high95"] for row in rows), default=1.0), 1.0)
    lower = min((row["low95"] for row in rows), default=0.0)
    evidence = evidence_on(watched, replays, problem.event, upper, lower)
    if evidence.doubts:
        answers = [replace(each, converged=False) for each in answers]
    return answers, evidence


def known_runs(
    replays: Replays,
    from_normal_scores: Callable[[Array], Array],
    predecessor: Predecessor | None = None,
) -> Predecessor | None:
    """Return the replays and the runs of a predecessor as known runs; None without an event."""
    if not replays.flags.any() or len(replays.encounters) > FEW:
        return predecessor
    z, is_found = normal_scores(from_normal_scores, replays.encounters.T)
    z, flags = z[is_found], replays.flags[is_found]
    if not flags.any():
        return predecessor
    if predecessor is not None:
        z, flags = np.vstack([predecessor.z, z]), np.append(predecessor.happened, flags)
    return Predecessor(z, flags)


def evidence_on(
    vehicle: WatchedVehicle, replays: Replays, event: Event, upper: float, lower: float = 0.0
) -> Evidence:
    """Repeat the runs of an estimate elsewhere, and compare the estimate with the replays.

    ``upper`` and ``lower`` are the ends of the widest interval of the estimate.
    """
    found = None
    if not vehicle.differed:  # otherwise the sampler knows that the outcomes vary
        found = difference_elsewhere(vehicle.vehicle, vehicle.encounters, vehicle.outcomes, event)
    scenario = vehicle.scenario
    crashed = replays.with_event.T
    return Evidence(
        scenario.event_in_words(event),
        upper,
        replays,
        None if found is None else str(found),
        pd.DataFrame(crashed, columns=list(scenario.names)),
        [scenario.described(each) for each in crashed[:SHOWN]],
        lower,
    )
