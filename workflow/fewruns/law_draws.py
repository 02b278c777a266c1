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
        counts = np.array([self.events, len(self) - self.events])
        missed, high = upper_limit(counts[::-1], len(self), alpha / 2)
        return 1 - float(missed), float(high)

    def contradict(self, probability: float) -> bool:
        """Return whether the events are improbable even if the estimate is too low by `AGREEMENT`."""
        events, allowed = self.events, min(AGREEMENT * probability, 1.0)
        return events > 0 and bool(bdtrc(events - 1, len(self), allowed) < CONTRADICTION)


def upper_limit(events: Array, count: Array | int, alpha: float) -> Array:
    """Return one-sided upper limits (Clopper and Pearson) of k probabilities, from events and trials."""
    return np.where(events < count, betaincinv(events + 1, np.maximum(count - events, 1), 1 - alpha), 1.0)
