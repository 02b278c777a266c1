"""The family of laws, fitted to the records, with its scores on held-out records."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from accelerated_evaluation.answer.calibration import held_out_counts
from accelerated_evaluation.answer.scores import BLOCKS, HeldOut
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.smooth.family import MEMBERS, DistinctRecords, Fitter, LawFamily, Member

# [1/s], inverse time to collision above which laws are scored. In the study, the region contains the crash
# set and about 600 records.
REGION = 0.25
REGION_SHARE = 0.003  # smallest share of the records in the region, for records of less critical traffic


@dataclass(frozen=True)
class ScoredFamily:
    """A family of laws that was fitted to records, with its scores on held-out records.

    It contains no random numbers, and can be stored in a file by `family_file`.

    Attributes
    ----------
    fitter, family
        The records with the grids on which the laws are fitted, and the fit to all records.
    log_scores
        Held-out log scores, censored to inverse times to collision above that of `region`, shape (members,
        records).
    expected
        Expected number of records in each cell under the laws that were fitted without their block, shape
        (members, cells); see `calibration.held_out_counts`.
    """

    fitter: Fitter
    family: LawFamily
    log_scores: Array
    expected: Array

    @property
    def records(self) -> DistinctRecords:
        """The distinct recorded cut-ins."""
        return self.fitter.records

    @property
    def critical(self) -> NDArray[np.bool_]:
        """Whether each record is inside the region in which laws are scored, shape (records,)."""
        records = self.records
        return records.closing_speed > region(records) * records.range_

    @property
    def members(self) -> tuple[Member, ...]:
        """The laws of the family that were fitted."""
        return self.fitter.members


def region(records: DistinctRecords) -> float:
    """Return the inverse time to collision [1/s] above which laws are scored.

    The value is `REGION`, or a smaller one if fewer than the share `REGION_SHARE` of the records exceed
    `REGION`. The smaller value is exceeded by this share of the records.

    Parameters
    ----------
    records
        Distinct recorded cut-ins.
    """
    return min(REGION, float(np.quantile(records.closing_speed / records.range_, 1 - REGION_SHARE)))


def score_family(
    records: DistinctRecords,
    members: tuple[Member, ...] = MEMBERS,
    blocks: int = BLOCKS,
    start: LawFamily | None = None,
) -> ScoredFamily:
    """Fit the family to all records, and score it by cross-validation over contiguous blocks of records.

    Parameters
    ----------
    records
        Distinct cut-ins, in the order of the records.
    members
        The laws. Laws with a threshold that too few records exceed are left out.
    blocks
        Number of contiguous blocks, each of which is held out once.
    start
        An earlier fit to similar records, whose smoothing parameters are used again.

    Returns
    -------
    ScoredFamily
        The fit to all records, and the held-out log scores of each law, shape (members, records).
    """
    fitter = Fitter(records, members)
    family, boundary = fitter.fit(start), region(records) * records.range_
    fitted = tuple(member for member in members if member.level is None or member in family.tails)
    if fitted != members:
        fitter = Fitter(records, fitted)
    held_out = HeldOut.of_family(fitter, family, blocks)
    scores = held_out.scores({"region": boundary})["region"]
    return ScoredFamily(fitter, family, scores, held_out_counts(held_out))
