"""Tables that a crash map allows: calibration, thresholds, and shares of the crashes by size."""

from collections.abc import Mapping
from dataclasses import dataclass

import pandas as pd

from accelerated_evaluation.answer.candidates.calibration import (
    DIVISIONS,
    TENTHS,
    counts_by_fold,
    fold_row,
    near_miss_counts,
    recorded_by_fold,
    recorded_counts,
    with_poisson_limits,
)
from accelerated_evaluation.answer.candidates.law_study import LawStudy
from accelerated_evaluation.answer.candidates.law_table import KNOT, PAPER, TOGETHER, papers_law
from accelerated_evaluation.answer.candidates.scores import HeldOut
from accelerated_evaluation.answer.ways.answer import Answer
from accelerated_evaluation.answer.ways.by_map import thinned_lines
from accelerated_evaluation.answer.ways.near_misses import near_miss_table
from accelerated_evaluation.answer.ways.variants import Streams, threshold_table
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.crash_map.maps import CrashMap
from accelerated_evaluation.laws.smooth.family import Member
from accelerated_evaluation.vehicles.protocol import CRASH

SHOWN = (Member(), *(Member(KNOT, shape) for shape in ("exponential", "generalised", "two kinds")))


@dataclass(frozen=True)
class NearMisses:
    """Crashes and near misses of the replayed records."""

    # Number of distinct records that end in each event if the vehicle replays them.
    recorded: Mapping[str, int]
    # Probability of each event, by its name, under each law.
    probabilities: Mapping[str, Mapping[str, float]]
    # Probability of each event, by its name, averaged over the draws of the answer.
    together: Mapping[str, float]


def shown_members(study: LawStudy) -> tuple[Member, ...]:
    """Return the smooth laws that tables list individually, if there were enough records to fit them."""
    return tuple(member for member in SHOWN if member in study.smooth.members)


def calibration_table(study: LawStudy, near: NearMisses | None = None) -> pd.DataFrame:
    """Compare recorded and expected numbers for the weighted mean of the smooth laws and for some of them.

    The numbers are those of cut-ins in cells, of range and closing speed or of lead speed and host speed. The
    expected numbers are those under laws that were fitted without the block of the records; only those of
    near misses are under laws that were fitted to all records, and for the weighted mean those of the answer,
    which averages over draws of the parameters. The table has a row for each law and cell, and
    for each event of ``near``, which is None if the records are not replayed: the cell ``where``, the speed
    that divides the cells (``counted``), and the columns of `with_poisson_limits`.
    """
    smooth, records = study.smooth, study.smooth.records
    recorded = recorded_counts(records)

    def near_misses(probability: Mapping[str, float]) -> list[pd.DataFrame]:
        return [] if near is None else [near_miss_counts(near.recorded, probability, records.size)]

    by_event = {} if near is None else near.probabilities
    by_member = dict(zip(smooth.names, smooth.expected[TENTHS].sum(axis=1), strict=True))
    mean = near_misses({} if near is None else near.together)
    tables = {TOGETHER: [recorded.assign(expected=study.without_added.mean(by_member)), *mean]}
    for member in shown_members(study):
        of_member = {name: values[member.name] for name, values in by_event.items()}
        of_cells = recorded.assign(expected=by_member[member.name])
        tables[member.name] = [of_cells, *near_misses(of_member)]
    independent = HeldOut.of_law(papers_law, records)
    tables[PAPER] = [recorded.assign(expected=counts_by_fold(independent)[0].sum(axis=0))]
    rows = [
        with_poisson_limits(pd.concat(parts, ignore_index=True)).assign(law=law)
        for law, parts in tables.items()
    ]
    return pd.concat(rows, ignore_index=True)


def fold_calibration(study: LawStudy) -> pd.DataFrame:
    """Compare recorded and expected numbers of the cells of the cut-ins by fold, for each way to divide them.

    There is a row for each ``law`` of `calibration_table` and each ``division`` of the records (`DIVISIONS`),
    with the columns of `fold_row`.
    """
    smooth, records = study.smooth, study.smooth.records
    rows = []
    for division, divide in DIVISIONS.items():
        folds = divide(records.size)
        recorded = recorded_by_fold(records, folds)
        by_member = dict(zip(smooth.names, smooth.expected[division], strict=True))
        expected = {TOGETHER: study.without_added.mean(by_member)}
        expected |= {member.name: by_member[member.name] for member in shown_members(study)}
        expected[PAPER] = counts_by_fold(HeldOut.of_law(papers_law, records, folds))[0]
        rows += [
            {"law": law, "division": division} | fold_row(recorded, own) for law, own in expected.items()
        ]
    return pd.DataFrame(rows)


def map_tables(
    own: Answer, study: LawStudy, crash_map: CrashMap, streams: Streams
) -> dict[str, pd.DataFrame]:
    """Return the tables of an answer by a crash map, by name.

    They are `threshold_table`, `calibration_table` with critical cut-ins, `fold_calibration`, and
    `near_miss_table`, whose intervals allow for clusters of critical records.
    """
    smooth, problem, posteriors = study.smooth, own.problem, own.posteriors
    records = smooth.records
    outcomes = problem.vehicle.simulate(*records.x.T)
    names = {event: problem.scenario.event_in_words(event) for event in posteriors}
    happened = {event: event.happens(outcomes) for event in posteriors}
    lines = {
        event: CrashLines.of(crash_map, records.lead_speed, event, records.support)
        for event in sorted({CRASH, *posteriors})
    }
    fitted = {
        event: dict(zip(smooth.names, lines[event].masses(smooth.fitted).sum(axis=1), strict=True))
        for event in posteriors
    }
    near = NearMisses(
        {names[event]: int(happened[event].sum()) for event in sorted(posteriors)},
        {names[event]: probabilities for event, probabilities in fitted.items()},
        {names[event]: posterior.probabilities.mean() for event, posterior in posteriors.items()},
    )
    own_lines = thinned_lines(lines[CRASH], problem.vehicle, own.draws, streams("answer"))
    return {
        "answer_thresholds": threshold_table(study, own_lines, streams),
        "calibration": calibration_table(study, near),
        "fold_calibration": fold_calibration(study),
        "near_misses": near_miss_table(
            {names[event]: posterior for event, posterior in posteriors.items()},
            {names[event]: each for event, each in happened.items()},
            smooth.resampled,
            streams("near misses"),
        ),
    }
