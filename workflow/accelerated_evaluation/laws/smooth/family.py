"""The family of laws that the answer combines by posterior weights.

All laws have the same body. They differ in the shape of the tail of the closing speed and in the threshold
above which the tail begins.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from accelerated_evaluation.base.arrays import Array, Chosen
from accelerated_evaluation.laws.smooth.conditional import Places, SpeedLaw, Threshold, range_grid, speed_grid
from accelerated_evaluation.laws.smooth.excess import Excess, fit_excess
from accelerated_evaluation.laws.smooth.far_tail import FarPosterior, FarPrior, FarTail, levels_of
from accelerated_evaluation.laws.smooth.shapes import SHAPES
from accelerated_evaluation.laws.smooth.smooth_hazard import Binned, HazardGrid, SmoothHazard, fit_hazard
from accelerated_evaluation.laws.smooth.support import SUPPORT, Support

# Cumulative hazard below the first level of a far tail, from which on records are kept. Draws of a law move
# hardly any record farther than this.
MARGIN = 1.5
FAR_PRIOR = FarPrior()
LEVELS = (0.9, 0.925, 0.95, 0.97, 0.98, 0.99, 0.995)  # probabilities of closing speeds below the thresholds
FEWEST = 10  # least number of records above a threshold for which tails are fitted


@dataclass(frozen=True)
class FarRecords:
    """Records with a large cumulative hazard."""

    places: Places
    closing_speed: Array  # m/s, (n,)
    size: int  # number of all records
    lowest: float  # cumulative hazard at the lowest threshold, the smallest level of a far tail
    support: Support = SUPPORT  # limits of the records, which define the splines of the places

    @property
    def levels(self) -> Array:
        """Cumulative hazards at which the layers of the far tail begin, (layers,)."""
        return levels_of(self.size, self.lowest)

    def posterior(self, law: SpeedLaw, prior: FarPrior = FAR_PRIOR) -> FarPosterior:
        """Return the posterior of the factors of the far tail, given a law without far tail."""
        cumulative = law.given(self.places).cumulative(self.closing_speed)
        return prior.posterior(cumulative, self.places.splines, self.support.bases, self.levels)

    def reduced(self, largest: Array) -> Self:
        """Return the records that reach a far tail under some draw of a law.

        ``largest`` is the largest cumulative hazard of each record under the fitted laws, shape (n,).
        """
        return self.only(largest > self.levels[0] - MARGIN)

    def only(self, chosen: Chosen) -> Self:
        """Return the records that a mask selects; the levels stay those of all records."""
        return replace(self, places=self.places.only(chosen), closing_speed=self.closing_speed[chosen])


@dataclass(frozen=True)
class Member:
    """Identifier of one law of the family."""

    # Probability of closing speeds below the threshold; None for the law that is the body alone.
    level: float | None = None
    shape: str = ""  # name of the shape of the excess; empty for the law that is the body alone

    @property
    def name(self) -> str:
        """The name of the law in tables, such as ``exponential 0.95``; ``hazard`` for the body alone."""
        return "hazard" if self.level is None else f"{self.shape} {self.level:g}"


def members_at(levels: Sequence[float] = LEVELS) -> tuple[Member, ...]:
    """Return the members of a family: the body alone, and each shape of tail above each threshold.

    A level is the probability that a closing speed is below the threshold, for example 0.95.
    """
    return (Member(), *(Member(level, shape) for shape in SHAPES for level in levels))


@dataclass(frozen=True)
class DistinctRecords:
    """Distinct recorded cut-ins within the limits ``support``."""

    lead_speed: Array  # m/s, (n,)
    range_: Array  # m, (n,)
    closing_speed: Array  # m/s, (n,)
    support: Support = SUPPORT

    @classmethod
    def of(cls, encounters: pd.DataFrame, support: Support = SUPPORT) -> "DistinctRecords":
        """Return the cut-ins of an encounter table, without rows that are equal to the row before."""
        rows = encounters[["lead_speed", "range", "closing_speed"]]
        distinct = rows[(rows != rows.shift()).any(axis=1)]
        return cls(*(distinct[name].to_numpy(dtype=float) for name in rows), support)

    @property
    def size(self) -> int:
        """Number of records."""
        return self.lead_speed.size

    @property
    def x(self) -> Array:
        """Lead speed [m/s], range [m] and closing speed [m/s] as columns, shape (n, 3)."""
        return np.column_stack([self.lead_speed, self.range_, self.closing_speed])

    @property
    def places(self) -> Places:
        """The lead speeds and ranges of the records, at which laws of the closing speed are evaluated."""
        return Places.of(self.lead_speed, self.range_, self.support)

    def only(self, chosen: Chosen) -> "DistinctRecords":
        """Return the records selected by an index array or a mask."""
        parts = (getattr(self, name)[chosen] for name in ("lead_speed", "range_", "closing_speed"))
        return DistinctRecords(*parts, self.support)


@dataclass(frozen=True)
class Exceedances:
    """The m records above a threshold."""

    index: NDArray[np.intp]  # indices of the records, (m,)
    excess: Array  # closing speed minus threshold [m/s], (m,)
    splines: Array  # of the lead speeds and ranges of the records, (m, p)

    @classmethod
    def of(cls, records: DistinctRecords, threshold: Threshold) -> "Exceedances":
        """Return the records whose closing speed exceeds the threshold."""
        excess = records.closing_speed - threshold(records.lead_speed, records.range_)
        index = np.flatnonzero(excess > 0)
        return cls(index, excess[index], records.only(index).places.splines)


@dataclass(frozen=True)
class LawFamily:
    """Laws of the closing speed with the same body, and the distribution of the range, fitted to records."""

    ranges: SmoothHazard  # of log(R_max / R) given the lead speed
    body: SmoothHazard  # of the closing speed given lead speed and range
    thresholds: dict[float, Threshold]  # by level
    exceedances: dict[float, Exceedances]  # the records above each threshold, by level
    tails: dict[Member, Excess]  # distribution of the excess, by member
    # Factors of the hazard where only a few records are; empty if there are too few records.
    far: dict[Member, FarTail]
    far_records: FarRecords | None = None  # records from which the factors follow; None if there are too few
    prior: FarPrior = FAR_PRIOR  # of the factors in draws

    def law(self, member: Member) -> SpeedLaw:
        """Return the distribution of the closing speed of one member of the family."""
        threshold, tail = self.thresholds.get(member.level), self.tails.get(member)
        return SpeedLaw(self.body, threshold, tail, self.far.get(member))

    def without_far_tail(self, member: Member) -> SpeedLaw:
        """Return the distribution of the closing speed of one member without factors of the far tail."""
        return replace(self.law(member), far=None)

    def drawn(
        self, member: Member, generator: np.random.Generator, body: SmoothHazard | None = None
    ) -> SpeedLaw:
        """Return the law of one member with parameters drawn from their posterior.

        Body and tail are drawn first, and then the factors of the far tail, given the drawn law. A body that
        has already been drawn may be given.
        """
        law = self.without_far_tail(member).drawn(generator, body)
        if self.far_records is None:
            return law
        return replace(law, far=self.far_records.posterior(law, self.prior).drawn(generator))

    def with_mean_far_tail(self, law: SpeedLaw) -> SpeedLaw:
        """Return a drawn law with the posterior means of the factors of the far tail, given the rest of it.

        The family must have records from which the factors follow.
        """
        law = replace(law, far=None)
        return replace(law, far=self.far_records.posterior(law, self.prior).mean())


@dataclass(frozen=True)
class Fitter:
    """Fits the family of laws to distinct records, and keeps the data that several fits need."""

    records: DistinctRecords  # in the order of the record
    members: tuple[Member, ...] = field(default_factory=members_at)
    grids: tuple[HazardGrid, HazardGrid] = field(init=False)  # of the range and of the closing speed
    binned: tuple[Binned, Binned] = field(init=False)  # the records in the bins of the two grids

    def __post_init__(self) -> None:
        support = self.records.support
        object.__setattr__(self, "grids", (range_grid(support), speed_grid(support)))
        logarithms = np.log(support.range_max / self.records.range_)
        ranges = self.grids[0].count(self.records.lead_speed, np.zeros(self.records.size), logarithms)
        object.__setattr__(self, "binned", (ranges, self.count_speeds(self.records)))

    def fit(self, start: LawFamily | None = None) -> LawFamily:
        """Return the family of laws fitted to all records.

        No tails are fitted above a threshold that fewer than `FEWEST` records exceed. A fit to similar
        records as ``start`` supplies starting values and the smoothing parameters, which are not estimated
        again.
        """
        before = (start.ranges, start.body) if start else (None, None)
        ranges, body = (
            fit_hazard(grid, data, start=fit)
            for grid, data, fit in zip(self.grids, self.binned, before, strict=True)
        )
        return self.family_of(ranges, body, start=start)

    def family_of(
        self,
        ranges: SmoothHazard,
        body: SmoothHazard,
        tails: dict[Member, Excess] | None = None,
        start: LawFamily | None = None,
    ) -> LawFamily:
        """Return the family with given laws of the range and of the body; tails are fitted if none are given.

        Thresholds and far tails follow from these.
        """
        levels = sorted({member.level for member in self.members if member.level is not None})
        thresholds = {level: Threshold.of(body, level, self.records.support) for level in levels}
        above = {level: Exceedances.of(self.records, threshold) for level, threshold in thresholds.items()}
        above = {level: those for level, those in above.items() if those.index.size >= FEWEST}
        every = np.ones(self.records.size, dtype=bool)
        tails = self._tails(above, every, start) if tails is None else tails
        return self._with_far_tails(LawFamily(ranges, body, thresholds, above, tails, {}), every)

    def refit(self, family: LawFamily, left_out: Chosen) -> LawFamily:
        """Return the family with laws of the closing speed fitted without some of the records.

        Thresholds and smoothing parameters are those of the fit to all records.
        """
        data = self.binned[1] - self.count_speeds(self.records.only(left_out))
        kept = np.ones(self.records.size, dtype=bool)
        kept[left_out] = False
        body = fit_hazard(self.grids[1], data, start=family.body)
        tails = self._tails(family.exceedances, kept, family)
        return self._with_far_tails(replace(family, body=body, tails=tails, far={}), kept)

    def count_speeds(self, records: DistinctRecords) -> Binned:
        """Return numbers of records in bins of lead speed, square root of the range, and closing speed."""
        return self.grids[1].count(records.lead_speed, np.sqrt(records.range_), records.closing_speed)

    def _with_far_tails(self, family: LawFamily, kept: NDArray[np.bool_]) -> LawFamily:
        """Return a family with the far tails that follow from the kept records."""
        if not family.exceedances:
            return family
        level = min(family.exceedances)
        index, lowest = family.exceedances[level].index, -float(np.log1p(-level))
        records, size = self.records.only(index[kept[index]]), int(kept.sum())
        places = records.places
        below = places.body(family.body)
        laws = {
            member: family.law(member)
            for member in self.members
            if member.level is None or member in family.tails
        }
        hazards = [law.given(places, below).cumulative(records.closing_speed) for law in laws.values()]
        every = FarRecords(places, records.closing_speed, size, lowest, self.records.support)
        few = every.reduced(np.max(hazards, axis=0))
        far = {member: few.posterior(law).mean() for member, law in laws.items()}
        return replace(family, far=far, far_records=few)

    def _tails(
        self, above: dict[float, Exceedances], kept: NDArray[np.bool_], start: LawFamily | None
    ) -> dict[Member, Excess]:
        tails = {}
        for level, all_above in above.items():
            used = kept[all_above.index]
            excess, splines = all_above.excess[used], all_above.splines[used]
            gram = splines.T @ splines
            for member in (member for member in self.members if member.level == level):
                before = start.tails[member] if start else None
                tails[member] = fit_excess(
                    excess,
                    splines,
                    self.records.support.penalty,
                    SHAPES[member.shape],
                    start=before,
                    gram=gram,
                )
        return tails
