"""The table ``calibration``: recorded numbers of critical cut-ins, and expected numbers under the laws."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import pandas as pd

from accelerated_evaluation.answer.calibration import cell_counts, near_miss_counts, with_limits
from accelerated_evaluation.answer.law_table import KNOT, PAPER, TOGETHER, papers_law
from accelerated_evaluation.answer.scores import GivenLaw
from accelerated_evaluation.answer.weighted_family import WeightedLaws
from accelerated_evaluation.laws.smooth.conditional import Places
from accelerated_evaluation.laws.smooth.family import Member

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
    probabilities: Mapping[str, Mapping[Member, float]]


def shown_members(weighted: WeightedLaws) -> tuple[Member, ...]:
    """Return the laws that tables list individually, if there were enough records to fit them.

    The weighted mean in these tables includes all laws.

    Parameters
    ----------
    weighted
        The laws with their weights.
    """
    return tuple(member for member in SHOWN if member in weighted.members)


def calibration_table(weighted: WeightedLaws, near: NearMisses | None = None) -> pd.DataFrame:
    """Compare recorded and expected numbers for the weighted mean of all laws and for some single laws.

    The numbers are those of cut-ins in cells, of range and closing speed or of lead speed and host speed.

    Parameters
    ----------
    weighted
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
    records, family = weighted.records, weighted.family

    def given(places: Places) -> Iterator[GivenLaw]:
        below = places.body(family.body)  # all laws have the same body
        return (family.law(member).given(places, below) for member in weighted.members)

    def near_misses(probability: Mapping[str, float]) -> list[pd.DataFrame]:
        return [] if near is None else [near_miss_counts(near.recorded, probability, records.size)]

    by_event = {} if near is None else near.probabilities
    by_member = dict(zip(weighted.members, cell_counts(records, given), strict=True))
    together = by_member[SHOWN[0]].assign(
        expected=weighted.mean({member: counts["expected"] for member, counts in by_member.items()})
    )
    mean = {name: weighted.mean(values) for name, values in by_event.items()}
    tables = {TOGETHER: [together, *near_misses(mean)]}
    for member in shown_members(weighted):
        of_member = {name: values[member] for name, values in by_event.items()}
        tables[member.name] = [by_member[member], *near_misses(of_member)]
    independent = papers_law(records)
    tables[PAPER] = cell_counts(records, lambda places: [independent.given(places)])
    rows = [with_limits(pd.concat(parts, ignore_index=True)).assign(law=law) for law, parts in tables.items()]
    return pd.concat(rows, ignore_index=True)
