"""Draws of the law itself, which show whether the event also happens where no run of the sampler was.

The runs of the sampler are near the event that it knows. If a vehicle also crashes in thin stripes everywhere
else, hardly any of these runs meets a stripe, and repeats of runs end in the same way. Draws of the law can
show such events: if none of n draws is an event, the probability of all events together is below
log(1 / alpha) / n with confidence 1 - alpha, whatever their shape.
"""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from scipy.special import bdtrc

from fewruns.arrays import Array, Flags
from fewruns.constants import AGREEMENT, CONTRADICTION


@dataclass(frozen=True)
class LawDraws:
    """Outcomes of the draws of the law so far.

    Attributes
    ----------
    z
        Normal scores, shape (n, d).
    happened
        Whether the event happened, shape (n,).
    """

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

    def extended(self, z: Array, happened: Flags) -> "LawDraws":
        """Return these draws, followed by further ones, shape (n, d), and their flags, shape (n,)."""
        return LawDraws(np.vstack([self.z, z]), np.append(self.happened, happened))

    def contradict(self, probability: float) -> bool:
        """Return whether the number of draws that ended in the event contradicts an estimated probability.

        The estimate may be too low by the factor `AGREEMENT`. It is contradicted if, even then, the
        probability of at least the observed number of events is below `CONTRADICTION`.

        Parameters
        ----------
        probability
            Estimated probability of the event.
        """
        events, allowed = self.events, min(AGREEMENT * probability, 1.0)
        return events > 0 and bool(bdtrc(events - 1, len(self), allowed) < CONTRADICTION)
