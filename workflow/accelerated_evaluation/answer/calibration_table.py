"""The table ``calibration``: recorded numbers of critical cut-ins, and expected numbers under the laws."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import pandas as pd

from accelerated_evaluation.answer.calibration import cell_counts, near_miss_counts, with_limits
from accelerated_evaluation.answer.law_study import LawStudy
from accelerated_evaluation.answer.law_table import KNOT, PAPER, TOGETHER
from accelerated_evaluation.answer.scores import GivenLaw
from accelerated_evaluation.laws.smooth.conditional import Places
from accelerated_evaluation.laws.smooth.family import Member
from accelerated_evaluation.laws.smooth.rivals import IndependentTail
from accelerated_evaluation.laws.smooth.shapes import Exponential

SHOWN = (Member(), *(Member(KNOT, shape) for shape in ("exponential", "generalised", "two kinds")))


@dataclass(frozen=True)
class NearMisses:
    """Crashes and near misses of the replayed records.

    Attributes
    ----------
    recorded
        Number of distinct records that end in each event if the vehicle replays them, by the name of the
        event.
    probabilities
        Probability of each event, by its name, under each law.
    """

    recorded: Mapping[str, int]
    probabilities: Mapping[str, Mapping[str, float]]


def shown_members(study: LawStudy) -> tuple[Member, ...]:
    """Return the smooth laws that tables list individually, if there were enough records to fit them."""
    return tuple(member for member in SHOWN if member in study.smooth.members)


def calibration_table(study: LawStudy, near: NearMisses | None = None) -> pd.DataFrame:
    """Compare recorded and expected numbers for the weighted mean of all laws and for some single laws.

    The numbers are those of cut-ins in cells, of range and closing speed or of lead speed and host speed.

    Parameters
    ----------
    study
        The laws with their weights.
    near
        Crashes and near misses of the replayed records, each of which is a further row; None if the records
        are not replayed.

    Returns
    -------
    pandas.DataFrame
        One row for each law and cell: ``law``; the cell ``where``; the speed that divides the cells,
        ``counted``; the numbers ``recorded`` and ``expected``; the 5 and 95 % Poisson quantiles ``low`` and
        ``high``; ``within``, whether the recorded number is between these; and its mid-p value ``p_value``.
    """
    smooth = study.smooth
    records, family = smooth.records, smooth.family

    def given(places: Places) -> Iterator[GivenLaw]:
        below = places.body(family.body)  # all laws have the same body
        return (family.law(member).given(places, below) for member in smooth.members)

    def near_misses(probability: Mapping[str, float]) -> list[pd.DataFrame]:
        return [] if near is None else [near_miss_counts(near.recorded, probability, records.size)]

    by_event = {} if near is None else near.probabilities
    by_member = dict(zip(smooth.names, cell_counts(records, given), strict=True))
    together = by_member[SHOWN[0].name].assign(
        expected=study.mean({name: counts["expected"] for name, counts in by_member.items()})
    )
    mean = {name: study.mean(values) for name, values in by_event.items()}
    tables = {TOGETHER: [together, *near_misses(mean)]}
    for member in shown_members(study):
        of_member = {name: values[member.name] for name, values in by_event.items()}
        tables[member.name] = [by_member[member.name], *near_misses(of_member)]
    independent = IndependentTail.fit(records, KNOT, Exponential())
    tables[PAPER] = cell_counts(records, lambda places: [independent.given(places)])
    rows = [with_limits(pd.concat(parts, ignore_index=True)).assign(law=law) for law, parts in tables.items()]
    return pd.concat(rows, ignore_index=True)
