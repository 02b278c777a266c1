"""The table ``calibration``: recorded numbers of critical cut-ins, and expected numbers under the laws."""

from collections.abc import Mapping
from dataclasses import dataclass

import pandas as pd

from accelerated_evaluation.answer.calibration import (
    held_out_counts,
    near_miss_counts,
    recorded_counts,
    with_limits,
)
from accelerated_evaluation.answer.law_study import LawStudy
from accelerated_evaluation.answer.law_table import KNOT, PAPER, TOGETHER, papers_law
from accelerated_evaluation.answer.scores import HeldOut
from accelerated_evaluation.laws.smooth.family import Member

SHOWN = (Member(), *(Member(KNOT, shape) for shape in ("exponential", "generalised", "two kinds")))


@dataclass(frozen=True)
class NearMisses:
    """Crashes and near misses of the replayed records."""

    # Number of distinct records that end in each event if the vehicle replays them.
    recorded: Mapping[str, int]
    # Probability of each event, by its name, under each law.
    probabilities: Mapping[str, Mapping[str, float]]


def shown_members(study: LawStudy) -> tuple[Member, ...]:
    """Return the smooth laws that tables list individually, if there were enough records to fit them."""
    return tuple(member for member in SHOWN if member in study.smooth.members)


def calibration_table(study: LawStudy, near: NearMisses | None = None) -> pd.DataFrame:
    """Compare recorded and expected numbers for the weighted mean of all laws and for some single laws.

    The numbers are those of cut-ins in cells, of range and closing speed or of lead speed and host speed. The
    expected numbers are those under laws that were fitted without the block of the records; only those of
    near misses are under laws that were fitted to all records. The table has a row for each law and cell, and
    for each event of ``near``, which is None if the records are not replayed: the cell ``where``, the speed
    that divides the cells (``counted``), and the columns of `with_limits`.
    """
    smooth, records = study.smooth, study.smooth.records
    recorded = recorded_counts(records)

    def near_misses(probability: Mapping[str, float]) -> list[pd.DataFrame]:
        return [] if near is None else [near_miss_counts(near.recorded, probability, records.size)]

    by_event = {} if near is None else near.probabilities
    by_member = dict(zip(smooth.names, smooth.expected, strict=True))
    mean = {name: study.mean(values) for name, values in by_event.items()}
    tables = {TOGETHER: [recorded.assign(expected=study.mean(by_member)), *near_misses(mean)]}
    for member in shown_members(study):
        of_member = {name: values[member.name] for name, values in by_event.items()}
        of_cells = recorded.assign(expected=by_member[member.name])
        tables[member.name] = [of_cells, *near_misses(of_member)]
    independent = HeldOut.of_law(papers_law, records)
    tables[PAPER] = [recorded.assign(expected=held_out_counts(independent)[0])]
    rows = [with_limits(pd.concat(parts, ignore_index=True)).assign(law=law) for law, parts in tables.items()]
    return pd.concat(rows, ignore_index=True)
