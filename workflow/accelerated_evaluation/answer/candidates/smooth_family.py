"""The smooth laws of cut-ins as candidates: fitted together, and scored on held-out records."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from accelerated_evaluation.answer.candidates.calibration import DIVISIONS, TENTHS, counts_by_fold
from accelerated_evaluation.answer.candidates.scores import BLOCKS, HeldOut, contiguous_folds
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.smooth.conditional import SpeedLaw
from accelerated_evaluation.laws.smooth.draws import SmoothDraws
from accelerated_evaluation.laws.smooth.family import DistinctRecords, Fitter, LawFamily, Member, members_at
from accelerated_evaluation.laws.smooth.mean import MeanLaw

# [1/s], inverse time to collision above which laws are scored. In the study, the region contains the crash
# set and about 600 records.
REGION = 0.25
REGION_SHARE = 0.003  # smallest share of the records in the region, for records of less critical traffic


def named() -> dict[str, Member]:
    """Return all members of the family by name, also those whose tails users have added."""
    return {member.name: member for member in members_at()}


@dataclass(frozen=True)
class SmoothFamily:
    """The fitted members of the family of smooth laws, with their log scores on held-out records."""

    fitter: Fitter  # the records, with the bases of the splines
    family: LawFamily
    scores: Array  # held-out log score of each member on each distinct record, shape (M, n)
    # Held-out number of records of each fold in each cell of `calibration.strips`, shape (M, folds, cells),
    # by the names of `calibration.DIVISIONS`; empty if not calibrated.
    expected: Mapping[str, Array]
    encounters: pd.DataFrame | None = None  # encounter table, from which laws take their lead speeds
    closing_speed_max: float = math.inf  # cap on the closing speed of laws [m/s]

    @classmethod
    def of(
        cls,
        records: DistinctRecords,
        members: tuple[Member, ...] | None = None,
        blocks: int = BLOCKS,
        start: LawFamily | None = None,
        calibrated: bool = False,
    ) -> Self:
        """Fit the members that have enough records, and score them on contiguous blocks of records.

        Members are by default those of `members_at`. The fit begins from ``start``, a fit to similar
        records. The numbers of records that the tables of the calibration compare, which take longer than the
        scores, are computed only if ``calibrated``, and then on `BLOCKS` blocks.
        """
        members = members_at() if members is None else members
        fitter = Fitter(records, members)
        family, boundary = fitter.fit(start), region(records) * records.range_
        fitted = tuple(member for member in members if member.level is None or member in family.tails)
        if fitted != members:
            fitter = Fitter(records, fitted)
        held_out = HeldOut.of_family(fitter, family, contiguous_folds(records.size, blocks))
        scores = held_out.scores({"region": boundary})["region"]
        if not calibrated:
            return cls(fitter, family, scores, {})
        others = {name: divide(records.size) for name, divide in DIVISIONS.items() if name != TENTHS}
        divided = {TENTHS: held_out}
        divided |= {name: HeldOut.of_family(fitter, family, folds) for name, folds in others.items()}
        expected = {name: counts_by_fold(divided[name]) for name in DIVISIONS}
        return cls(fitter, family, scores, expected)

    @property
    def records(self) -> DistinctRecords:
        """The distinct records to which the laws are fitted."""
        return self.fitter.records

    @property
    def members(self) -> tuple[Member, ...]:
        """The M members."""
        return self.fitter.members

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the members, of length M."""
        return tuple(member.name for member in self.members)

    @property
    def resampled(self) -> NDArray[np.bool_]:
        """Flags of the records in the region of critical cut-ins, whose scores the bootstrap resamples."""
        return self.records.closing_speed > region(self.records) * self.records.range_

    def draws(self, chosen: NDArray[np.intp], generator: np.random.Generator) -> MeanLaw:
        """Draw the parameters of the chosen members, shape (K,), from their posteriors."""
        drawn = SmoothDraws.of(
            self.family, [self.members[k] for k in chosen], self.records.support, generator
        )
        names = sorted(set(drawn.names))
        whose = names[0] if len(names) == 1 else "all laws"
        description = f"mean of {drawn.size} draws of {whose}"
        if self.encounters is None:  # only probabilities of crash maps can be computed
            return MeanLaw(description, {}, drawn, {}, self.closing_speed_max)
        return MeanLaw.fitted(drawn, self.encounters, description, self.closing_speed_max)

    @property
    def fitted(self) -> SmoothDraws:
        """The fitted members as M draws."""
        laws = [self.family.law(member) for member in self.members]
        return SmoothDraws.of_laws(self.family.ranges, laws, self.records.support)

    def speeds(self, name: str) -> SpeedLaw:
        """Return the distribution of the closing speed of a member, given by its name."""
        return self.family.law(named()[name])

    def law(self, name: str) -> MeanLaw:
        """Return a member, without the uncertainty of its parameters."""
        alone = SmoothDraws.of_laws(self.family.ranges, [self.speeds(name)], self.records.support)
        return MeanLaw.fitted(replace(alone, names=(name,)), self.encounters, name)


def region(records: DistinctRecords) -> float:
    """Return the inverse time to collision [1/s] above which the laws are scored.

    It is `REGION`, or smaller if fewer than a share `REGION_SHARE` of the records exceed this.
    """
    return min(REGION, float(np.quantile(records.closing_speed / records.range_, 1 - REGION_SHARE)))
