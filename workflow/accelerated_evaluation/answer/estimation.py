"""The estimate of a slow vehicle without a study: records, laws, few runs, and the answer in words."""

import json
import math
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from tqdm import tqdm

from accelerated_evaluation.answer.candidates.fitted_records import FittedRecords, records_of
from accelerated_evaluation.answer.consequences.counted_crashes import contradictions
from accelerated_evaluation.answer.consequences.criterion import Basis, Counted, Criterion
from accelerated_evaluation.answer.consequences.deciding import criteria_in_words, criteria_tables
from accelerated_evaluation.answer.consequences.in_service import judged_after, length_of, updated_rates
from accelerated_evaluation.answer.consequences.injuries.tables import RISKS
from accelerated_evaluation.answer.estimate_tables import estimate_tables
from accelerated_evaluation.answer.settings import Settings
from accelerated_evaluation.answer.study_tables import injured_by_level, risks_table
from accelerated_evaluation.answer.ways.answer import Answer, Way, evaluate
from accelerated_evaluation.answer.ways.by_few_runs import FewRuns, Shown, runs_to_begin_with
from accelerated_evaluation.answer.ways.by_map import Map
from accelerated_evaluation.answer.ways.by_simulations import Simulations
from accelerated_evaluation.answer.ways.choice import FILE, draws_named
from accelerated_evaluation.answer.ways.comparison import compared_table
from accelerated_evaluation.answer.ways.evidence import Evidence, checked_answers
from accelerated_evaluation.answer.ways.extrapolation import beyond_in_words, extrapolation_in_words
from accelerated_evaluation.answer.ways.posterior import LEVEL
from accelerated_evaluation.answer.ways.request import Request
from accelerated_evaluation.answer.ways.words import (
    aligned,
    answer_in_words,
    budget_in_words,
    probability_row,
    ratio_in_words,
    ratio_row,
    updated_row,
)
from accelerated_evaluation.base.checking import checked
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.numerals import counted
from accelerated_evaluation.base.percent import in_percent
from accelerated_evaluation.crash_map.mapping import map_crashes
from accelerated_evaluation.crash_map.maps import Grid
from accelerated_evaluation.laws.draws import Draws
from accelerated_evaluation.laws.files import names_records, read_verdict, write_law
from accelerated_evaluation.laws.limited import limited, limits_in_words
from accelerated_evaluation.methods.problem import Problem
from accelerated_evaluation.methods.surrogate import (
    assumption_in_words,
    chance_in_words,
    checks_in_words,
    unseen_in_words,
    weights_in_words,
)
from accelerated_evaluation.records.checks import Records
from accelerated_evaluation.records.verdict import Verdict, verdict_on
from accelerated_evaluation.vehicles.external.slow import SlowVehicle


@dataclass(frozen=True, repr=False)
class Estimated:
    """The replicates of an answer from few runs, with everything that is written and printed.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> found = ae.estimate("left_turn", ae.Request(law="independent_variables"))
    >>> sorted(found.tables)[:3]
    ['account', 'answer', 'budget']
    """

    answers: Sequence[Answer]
    records: FittedRecords
    verdict: Verdict
    vehicle: SlowVehicle | None  # with its stored outcomes; None for a fast vehicle
    references: Mapping[str, Answer]
    request: Request
    evidence: Evidence
    criteria: Sequence[Criterion] = ()
    remarks: Sequence[str] = ()  # warnings during the estimate, such as that of random outcomes
    # Crashes in service, and the rate of the first replicate before and after them.
    counted: Counted | None = None
    in_service: pd.DataFrame | None = None

    def __repr__(self) -> str:
        """Return the estimate in words."""
        return "\n".join(self.lines())

    @cached_property
    def tables(self) -> dict[str, pd.DataFrame]:
        """All tables by name, with the doubts about the estimate and the verdict on the records."""
        tables = self.evidence.added_to(estimate_tables(self.answers, self.records))
        if self.records.account is not None:
            tables["account"] = self.records.account
        if self.criteria:
            tables |= self._judged(tables["extrapolation"])
        if self.in_service is not None:
            tables["in_service"] = self.in_service
        return self.verdict.added_to_answers(tables)

    def _judged(self, extrapolation: pd.DataFrame) -> dict[str, pd.DataFrame]:
        """Return the tables of the criteria, judged by the first replicate."""
        own, others = self.answers[0], {name: each.posterior for name, each in self.references.items()}
        risks = risks_table(own) if own.problem.scenario.name in RISKS else None
        first = extrapolation[extrapolation["replicate"] == 0] if len(extrapolation) else extrapolation
        return criteria_tables(
            self.criteria,
            None if self.evidence.doubts else own.posterior,
            Basis.of(first, own.problem.scenario.scope),
            self.records.size,
            self.records.exposure,
            others,
            injured_by_level(own.posterior, risks),
            update=partial(judged_after, counted=self.counted, records=self.records)
            if self.counted
            else None,
        )

    @checked()
    def write(self, folder: Path) -> pd.DataFrame:
        """Write all tables and the law to a folder, and return the ratios to other vehicles."""
        for name, table in self.tables.items():
            write_csv(folder / f"{name}.csv", table)
        write_law(folder / "law.json", self.answers[0].draws.law, self.records.table, self.verdict)
        self.records.write(folder / "encounters.parquet")
        if len(compared := self.compared()):
            write_csv(folder / "compared.csv", compared)
        return compared

    def compared(self) -> pd.DataFrame:
        """Return the ratios to other vehicles, one row each, with the simulations of these vehicles."""
        others = self.references.values()
        posteriors = {name: other.posterior for name, other in self.references.items()}
        marked = contradictions(posteriors, self.records)
        return compared_table({"": self.answers[0].posterior, **posteriors}, marked).assign(
            other_simulations=[other.simulations for other in others],
            other_converged=[other.converged for other in others],
        )

    def lines(self, compared: pd.DataFrame | None = None, *, verbose: bool = False) -> list[str]:
        """Return the answer in words: first what was asked; with ``verbose`` all that is known of it."""
        ratios = [] if compared is None else compared.to_dict("records")
        return [
            *self.verdict.stop_lines(),
            *(f"warning: {doubt}" for doubt in self.evidence.doubts),
            *(
                f"warning: the estimate of {name} has not converged, so its ratio may change"
                for name, other in self.references.items()
                if not other.converged
            ),
            *(self._not_converged(number) for number, each in enumerate(self.answers) if not each.converged),
            *self._summary(ratios),
            *(f"note: {remark}" for remark in (*self.remarks, *self._contradicted())),
            *self._unseen(),
            *(
                line
                for number, each in enumerate(self.answers)
                for line in self._lines_of(number, each, verbose=verbose)
            ),
            *(map(ratio_in_words, ratios) if verbose else ()),
            *(criteria_in_words(self.tables) if self.criteria else ()),
            self.evidence.in_words,
            *(self._simulated() if verbose or (self.vehicle and self.vehicle.lost) else []),
            *self.verdict.warning_lines(),
        ]

    def _contradicted(self) -> list[str]:
        """Return the references that counted crashes contradict, in words."""
        posteriors = {name: other.posterior for name, other in self.references.items()}
        found = contradictions(posteriors, self.records)
        return [f"the reference {name} is {words}" for name, words in found.items()]

    def _summary(self, ratios: Sequence[Mapping[str, Any]]) -> list[str]:
        """Return the answer in aligned lines: probability, ratios, share beyond the records, simulations.

        All replicates are shown; ratios and replays are those of the first.
        """
        rows = []
        for number, answer in enumerate(self.answers):
            scenario, estimate = answer.problem.scenario, answer.notes["estimate"]
            row = answer.table(self.records.per_km).iloc[0].to_dict()
            rows.append(probability_row(row, answer.sources, scenario.noun))
            if number == 0:
                rows += map(ratio_row, ratios)
            if answer.crashes is not None:
                rows.append(("beyond", beyond_in_words(self._beyond(number)), ""))
            counts = f"{estimate.simulations:,} simulations, {estimate.events:,} of them with the event"
            if number == 0:
                counts += f"; {self.evidence.replays.replayed:,} replays of records"
                if (name := self.request.against) is not None:
                    counts += f"; {self.references[name].simulations:,} simulations of {name}"
            if number == 0 and self.in_service is not None:
                rows.append(updated_row(self.in_service))
            rows.append(("converged" if answer.converged else "not converged", counts, ""))
        return aligned(rows)

    def _beyond(self, replicate: int) -> pd.DataFrame:
        """Return the rows of the table ``extrapolation`` of a replicate."""
        table = self.tables["extrapolation"]
        return table[table["replicate"] == replicate]

    def _unseen(self) -> list[str]:
        """Return how much the replays can have missed, in at most one line."""
        answer = self.answers[0]
        middle = answer.notes["estimate"].probability
        if answer.posterior is not None:
            middle = float(answer.table(self.records.per_km)["median"].iloc[0])
        text = self.evidence.unseen(middle)
        return [] if text is None else [f"note: {text}"]

    def content(self, compared: pd.DataFrame) -> dict[str, Any]:
        """Return the answer as a value for JSON: tables as lists of rows, and warnings as texts."""
        names = ["answer", "budget", "estimate", "extrapolation"]
        names += ["criteria", "deciding"] if self.criteria else []
        tables = {name: self.tables[name] for name in names} | {"compared": compared}
        rows = {name: json.loads(table.to_json(orient="records")) for name, table in tables.items()}
        return rows | {
            "warnings": [*self.evidence.doubts, *self.verdict.lines()],
            "notes": [*self.remarks, *self._unseen()],
        }

    def _lines_of(self, number: int, answer: Answer, *, verbose: bool) -> Iterator[str]:
        scenario, estimate = answer.problem.scenario, answer.notes["estimate"]
        if len(self.answers) > 1:
            yield f"replicate {number}:"
        if answer.notes["not_ended"]:
            yield f"warning: {answer.notes['not_ended']:,} runs did not end, and count as without the event"
        if answer.notes["failed"][0]:
            (failed, added), total = answer.notes["failed"], estimate.simulations
            yield (
                f"warning: {failed:,} of {total:,} runs ({in_percent(failed / total)}) failed repeatedly, "
                "and count as without the event. With it in all of them, the probability would be higher by "
                f"{added:.2g}, which the upper ends contain"
            )
        assumptions = assumption_in_words(estimate.diagnostics)
        if verbose:
            yield from self._probabilities(answer)
            if answer.crashes is not None:
                yield extrapolation_in_words(self._beyond(number))
            yield from budget_in_words(answer.budget())
            yield f"law of {scenario.noun}s: {answer.draws.proposal.description}"
            if answer.converged and assumptions and not estimate.diagnostics["counted"]:
                yield "it has converged if there are no rare lapses"
        yield from checks_in_words(estimate)
        if verbose or answer.posterior is None:
            known = "not known yet" if math.isnan(estimate.probability) else f"{estimate.probability:.3g}"
            yield (
                f"{scenario.event_in_words(answer.problem.event)} under this law: probability {known}, "
                f"{1 - estimate.alpha:.0%} interval of the sampling alone {estimate.low:.2g} to "
                f"{estimate.high:.2g}"
            )
        if verbose:
            yield weights_in_words(estimate.diagnostics)
            yield unseen_in_words(estimate.probability, estimate.diagnostics)
            yield chance_in_words(estimate.diagnostics, answer.problem.deterministic)
        else:
            yield from assumptions

    def _probabilities(self, answer: Answer) -> Iterator[str]:
        """Return all events in words, the main event first."""
        table = answer.table(self.records.per_km)
        has_row = table["high95"].notna() | (table.index == 0)
        for row in table[has_row].to_dict("records"):
            yield from answer_in_words(row, answer.sources, answer.problem.scenario.noun)
        if not has_row.all():
            yield f"not known from these runs: {', '.join(table.loc[~has_row, 'event'])}"
        others = [event for event in answer.posteriors if event != answer.problem.event]
        for event in [each for each in others if answer.posteriors[each] is None][:1]:
            option = event.quantity if event.at is None else f"{event.quantity}={event.threshold:g}"
            yield f"an event that is not known needs runs of its own, for example --event {option}"

    def _not_converged(self, number: int) -> str:
        """Return the reason why a replicate has not converged, and what to do."""
        estimate = self.answers[number].notes["estimate"]
        if self.evidence.doubts:
            reason = "see the warning above"
        elif not math.isnan(bound := estimate.diagnostics.get("unseen_lapses", math.nan)):
            reason = f"lapses that no run has shown can add up to {bound:.1g}, which the upper ends contain"
        elif estimate.diagnostics["drift"]:
            reason = "the vehicle changes from run to run, so that there is no single probability"
        else:
            reason = (
                "more simulations may change it, or may find further parts of the event; increase "
                "surrogate.maximum_calls"
            )
        which = f" (replicate {number})" if len(self.answers) > 1 else ""
        return f"NOT CONVERGED{which}: {reason}; --verbose prints more"

    def _simulated(self) -> list[str]:
        if (vehicle := self.vehicle) is None:
            return []
        lost = counted(vehicle.lost, "batch", "batches")
        again = f"lost and simulated again: {lost}; " if vehicle.lost else ""
        return [
            f"simulated: {vehicle.simulated:,}; {again}taken from the store: {vehicle.found:,}; "
            f"kept: {len(vehicle.store):,} in {vehicle.store.path}"
        ]


def estimate_event(settings: Settings, request: Request) -> Estimated:
    """Estimate the probability of an event for a vehicle, with laws of records."""
    scenario = settings.scenario
    verdicts: list[Verdict] = []
    named = settings.vehicle
    with _remarks() as remarks, named.loaded(sets_aside=True) as vehicle, _progress() as (begin, show):
        begin("reading and checking the records")
        records = records_of(
            scenario,
            settings.records,
            settings.sample(),
            settings.support,
            lambda found: verdicts.append(
                _verdict(found, settings.records.name, request.law, settings.accepted)
            ),
        )
        if settings.in_service is not None:
            length_of(settings.in_service, records)  # an error before anything is simulated
        begin("fitting the laws of the records")
        draws = draws_named(request.law, records, settings.laws)
        draws = limited(draws, settings.limits, settings.laws.streams("limits"))
        problem = Problem(scenario, vehicle, settings.event, law=draws.proposal)
        size, share = settings.batch_size, request.sampling_share
        way = FewRuns(settings.stopping, size, named.pending(size), share, on_batch=show)
        compared: dict[str, Answer] = {}
        if settings.against is not None and request.against is not None:
            begin(f"estimating {request.against}")
            with settings.against.loaded(sets_aside=True) as other:
                old = replace(problem, vehicle=other)
                found = evaluate(old, draws, way, generator=settings.laws.streams("against"))
            compared[request.against] = found
            way = replace(way, predecessor=runs_to_begin_with(found, problem))
        begin("replaying records, and choosing the first simulations")
        answers, evidence = checked_answers(
            problem, draws, records, way, settings.events, settings.laws.streams, request.replicates
        )
    for name, reference in settings.references.items():
        with reference.loaded() as other:
            given = Problem(scenario, other, settings.event), draws, records, settings.many, settings.grid
            compared[name] = reference_answer(*given, settings.laws.streams("references", name))
    slow = vehicle if isinstance(vehicle, SlowVehicle) else None
    own = answers, records, verdicts[0], slow, compared, request, evidence, settings.criteria
    remarks = [*limits_in_words(draws), *remarks]
    if settings.in_service is None or answers[0].posterior is None:
        return Estimated(*own, remarks)
    generator = settings.laws.streams("in_service")
    service = updated_rates(answers[0].posterior, settings.in_service, records, generator)
    return Estimated(*own, remarks, settings.in_service, service)


def _verdict(records: Records, name: str, law: str, accepted: Sequence[str]) -> Verdict:
    """Return the verdict on the records, or that of a law file which does not name its records.

    Raises InputError if a check has the verdict ``stop`` that ``accepted`` does not name.
    """
    if law.endswith(FILE) and Path(law).is_file() and not names_records(law):
        return read_verdict(law, accepted)
    return verdict_on(records, name, accepted)


def reference_answer(
    problem: Problem,
    draws: Draws,
    records: FittedRecords,
    simulations: int,
    grid: Grid | None,
    generator: np.random.Generator,
) -> Answer:
    """Return the answer of a fast vehicle: from its crash map if there is a grid, or from simulations."""
    way: Way = Simulations(simulations)
    if grid is not None:
        way = Map(map_crashes(problem.vehicle, grid, [problem.event], generator), records)
    return evaluate(problem, draws, way, generator=generator)


@contextmanager
def _remarks() -> Iterator[list[str]]:
    """Yield a list, which contains the warnings of the library afterwards, so that the answer states them."""
    remarks: list[str] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        yield remarks
    for each in caught:
        if each.category is UserWarning:
            remarks += [str(each.message)] if str(each.message) not in remarks else []
        else:
            warnings.warn_explicit(each.message, each.category, each.filename, each.lineno)


@contextmanager
def _progress() -> Iterator[tuple[Callable[[str], None], Shown]]:
    """Yield two functions: one shows what begins, the other the progress of the simulations.

    The second one also says if the estimate begins again. On a terminal both write to one line; elsewhere
    nothing else is printed.
    """
    was_known = False
    with tqdm(unit="", disable=None, bar_format="{desc}", leave=False) as bar:

        def begin(step: str) -> None:
            bar.set_description_str(f"{step} ...")

        def show(estimate: Any, posterior: Any) -> None:  # noqa: ANN401
            nonlocal was_known
            is_known = (estimate.low, estimate.high) != (0.0, 1.0)
            if was_known and not is_known:
                tqdm.write(f"after {estimate.simulations:,} simulations: {estimate.reason}", file=sys.stderr)
            was_known = is_known
            bar.bar_format, bar.desc = None, "simulations"
            bar.n = estimate.simulations
            text = f"{estimate.events} events, sampling alone {estimate.low:.2g} to {estimate.high:.2g}"
            if posterior is not None:
                low, high = posterior.whole.interval(LEVEL)
                text = f"{low:.2g} to {high:.2g} with {', '.join(posterior.sources)}, {text}"
            bar.set_postfix_str(text)

        yield begin, show
