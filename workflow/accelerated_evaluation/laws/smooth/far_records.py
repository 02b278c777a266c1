"""The records from which the factors of far tails follow, for any law of the closing speed."""

from dataclasses import dataclass
from typing import Self

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.smooth.conditional import Places, SpeedLaw
from accelerated_evaluation.laws.smooth.far_tail import PRIOR, FarTail, levels_of

# Cumulative hazard below the first level of a far tail, from which on records are kept. Draws of a law move
# hardly any record farther than this.
MARGIN = 1.5


@dataclass(frozen=True)
class FarRecords:
    """Records with a large cumulative hazard."""

    places: Places
    closing_speed: Array  # m/s, (n,)
    size: int  # number of all records
    lowest: float  # cumulative hazard at the lowest threshold, the smallest level of a far tail

    def tail(self, law: SpeedLaw, prior: float = PRIOR) -> FarTail:
        """Return the posterior of the factors of the far tail, given a law without far tail."""
        cumulative = law.given(self.places).cumulative(self.closing_speed)
        return FarTail.of(cumulative, self.size, self.lowest, prior)

    def reduced(self, largest: Array) -> Self:
        """Return the records that reach a far tail under some draw of a law.

        ``largest`` is the largest cumulative hazard of each record under the fitted laws, shape (n,).
        """
        kept = largest > levels_of(self.size, self.lowest)[0] - MARGIN
        return FarRecords(self.places.only(kept), self.closing_speed[kept], self.size, self.lowest)
