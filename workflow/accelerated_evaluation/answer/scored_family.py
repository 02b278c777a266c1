"""The family of laws, fitted to the records, with its scores on held-out records."""

from dataclasses import dataclass

import numpy as np

from accelerated_evaluation.answer.scores import BLOCKS, HeldOut
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.smooth.family import MEMBERS, DistinctRecords, Fitter, LawFamily, Member

REGION = 0.25  # [1/s], TTC^-1 above which laws are weighted; contains the crash set and some 600 records
REGION_SHARE = 0.003  # of the records that the region holds at least, where traffic is calmer


@dataclass(frozen=True)
class ScoredFamily:
    """A family fitted to records, with its scores on held-out records: what `family_file` keeps.

    No random number is needed to make it.

    Attributes
    ----------
    fitter, family
        The records, and the fit to all of them.
    log_scores
        Held-out log scores censored to TTC^-1 above that of `region`, shape (members, records).
    """

    fitter: Fitter
    family: LawFamily
    log_scores: Array

    @property
    def records(self) -> DistinctRecords:
        """The distinct cut-ins."""
        return self.fitter.records

    @property
    def members(self) -> tuple[Member, ...]:
        """The laws."""
        return self.fitter.members


def region(records: DistinctRecords) -> float:
    """Return the TTC^-1 [1/s] above which laws are weighted.

    It is `REGION`, or less if there are few records above `REGION`.
    """
    return min(REGION, float(np.quantile(records.closing_speed / records.range_, 1 - REGION_SHARE)))


def score_family(
    records: DistinctRecords,
    members: tuple[Member, ...] = MEMBERS,
    blocks: int = BLOCKS,
    start: LawFamily | None = None,
) -> ScoredFamily:
    """Fit the family to all records, and score it on each block of records by a fit to the other blocks.

    Parameters
    ----------
    records
        Distinct cut-ins in the order of the record.
    members
        The laws; those above thresholds that hardly any event exceeds are left out.
    blocks
        Number of contiguous blocks that are held out in turn.
    start
        An earlier fit to similar records, whose smoothing parameters are kept.
    """
    fitter = Fitter(records, members)
    family, boundary = fitter.fit(start), region(records) * records.range_
    fitted = tuple(member for member in members if member.level is None or member in family.tails)
    if fitted != members:
        fitter = Fitter(records, fitted)
    held_out = HeldOut.of_family(fitter, family, blocks)
    return ScoredFamily(fitter, family, held_out.scores({"region": boundary})["region"])
