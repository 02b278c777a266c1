"""Draws of the law itself, which show events far from all runs, such as thin stripes."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from scipy.special import bdtrc, betaincinv

from fewruns.arrays import Array, Flags
from fewruns.constants import AGREEMENT, CONTRADICTION


@dataclass(frozen=True)
class LawDraws:
    """Outcomes of the draws of the law so far."""

    z: Annotated[Array, "draws", "dimension"]
    happened: Annotated[Flags, "draws"]

    @classmethod
    def none(cls, dimension: int) -> "LawDraws":
        """Return an empty set of draws in ``dimension`` normal scores."""
        return cls(np.empty((0, dimension)), np.empty(0, bool))

    def __len__(self) -> int:
        """Return the number of draws."""
        return len(self.happened)

    @property
    def events(self) -> int:
        """Number of draws that ended in the event."""
        return int(np.count_nonzero(self.happened))

    @property
    def share(self) -> float:
        """Share of the draws that ended in the event."""
        return self.events / len(self)

    def extended(self, z: Array, happened: Flags) -> "LawDraws":
        """Return these draws, followed by further ones, shape (n, d), and their flags, shape (n,)."""
        return LawDraws(np.vstack([self.z, z]), np.append(self.happened, happened))

    def interval(self, alpha: float) -> tuple[float, float]:
        """Return the ends of the interval of Clopper and Pearson for P(event), of level 100 (1 - alpha) %."""
        events, others = self.events, len(self) - self.events
        low = float(betaincinv(events, others + 1, alpha / 2)) if events else 0.0
        return low, float(betaincinv(events + 1, others, 1 - alpha / 2)) if others else 1.0

    def contradict(self, probability: float) -> bool:
        """Return whether the events are improbable even if the estimate is too low by `AGREEMENT`."""
        events, allowed = self.events, min(AGREEMENT * probability, 1.0)
        return events > 0 and bool(bdtrc(events - 1, len(self), allowed) < CONTRADICTION)
